// What the page does not support of an opened experiment; the notice stays until it is dismissed.

const FIRST = 4; // entries shown before the rest, which opens on demand
const LONGEST = 60; // characters of a value

export class Notice {
  // onDismiss(): called after the user has dismissed it.
  constructor(holder, onDismiss) {
    this.holder = holder;
    this.onDismiss = onDismiss;
  }

  // title: first sentence; unsupported: [{key, wanted, used}]; ways: [[words, command line]] to the experiment's own run.
  show(title, unsupported, ways = []) {
    this.clear();
    if (!unsupported.length) return;
    const several = unsupported.length > 1;
    const lead = made("p", made("strong", title), several ? ` The lab does not support ${unsupported.length} of its values and uses others in their place:`
      : " The lab does not support one of its values and uses another in its place:");
    const rest = unsupported.slice(FIRST), more = made("details", made("summary", `${rest.length} more`), listed(rest));
    const dismiss = made("button", "×");
    dismiss.type = "button";
    dismiss.className = "icon";
    dismiss.setAttribute("aria-label", "Dismiss this notice");
    dismiss.addEventListener("click", () => { this.clear(); this.onDismiss(); });
    const runs = ways.map(([words, command]) => made("p", `${words} `, made("code", command)));
    this.holder.replaceChildren(made("div", lead, listed(unsupported.slice(0, FIRST)), ...(rest.length ? [more] : []), ...runs), dismiss);
  }

  clear() {
    this.holder.replaceChildren();
  }
}

// Command lines that run a file as it is.
export function waysToRun(name) {
  const file = /^[\w.-]+$/.test(name) ? name : `'${name.replaceAll("'", "'\\''")}'`, run = `uv run dualwinch simulate --config ${file}`;
  return [["Its own run as a figure:", `${run} --plot run.png`], ["Its own run for Share › Open, which shows it as A:", `${run} --out run.parquet`]];
}

function listed(entries) {
  return made("ul", ...entries.map(({key, wanted, used}) => made("li", made("code", key), `: ${text(wanted)} ${used === undefined ? "is left out" : `→ ${text(used)}`}`)));
}

function text(value) {
  const words = value === null ? "none" : Array.isArray(value) ? `[${value.map(text).join(", ")}]` : typeof value === "object" ? "{…}" : String(value);
  return words.length > LONGEST ? `${words.slice(0, LONGEST)}…` : words;
}

function made(name, ...content) {
  const element = document.createElement(name);
  element.append(...content);
  return element;
}
