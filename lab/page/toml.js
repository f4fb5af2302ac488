// The subset of TOML that dualwinch writes for numbers, switches and words.

// {dotted key: value}; arrays and other values that are no scalars are left out.
export function readToml(text) {
  const found = {};
  let table = "";
  for (const raw of text.split(/\r?\n/)) {
    const line = raw.trim();
    const header = /^\[\s*([\w.\-"]+)\s*\]/.exec(line);
    if (header) {
      table = `${header[1].replaceAll('"', "")}.`;
      continue;
    }
    const entry = /^"?([\w.\-]+)"?\s*=\s*(.+)$/.exec(line);
    if (!entry) continue;
    const value = scalar(entry[2]);
    if (value !== undefined) found[table + entry[1]] = value;
  }
  return found;
}

function scalar(text) {
  const quoted = /^"((?:[^"\\]|\\.)*)"/.exec(text) ?? /^'([^']*)'/.exec(text);
  if (quoted) return text[0] === '"' ? JSON.parse(`"${quoted[1]}"`) : quoted[1];
  const word = text.replace(/\s*#.*$/, "").trim();
  if (word === "true" || word === "false") return word === "true";
  if (/^[+-]?inf$/.test(word)) return word[0] === "-" ? -Infinity : Infinity;
  return /^[+-]?[\d_]+(\.[\d_]+)?(e[+-]?\d+)?$/i.test(word) ? Number(word.replaceAll("_", "")) : undefined;
}

// A TOML file from dotted keys, grouped by table, with comment lines at its head.
export function writeToml(values, comments = []) {
  const tables = new Map();
  for (const [key, value] of Object.entries(values)) {
    const [, table, name] = /^(?:(.*)\.)?([^.]+)$/.exec(key);
    tables.set(table ?? "", [...(tables.get(table ?? "") ?? []), `${name} = ${literal(value)}`]);
  }
  const blocks = [...tables].sort(([a], [b]) => (a < b ? -1 : 1)).map(([table, lines]) => (table ? [`[${table}]`, ...lines] : lines).join("\n"));
  return [comments.map((line) => `# ${line}`).join("\n"), ...blocks].filter(Boolean).join("\n\n") + "\n";
}

export function literal(value) {
  if (typeof value === "string") return JSON.stringify(value);
  if (value === Infinity || value === -Infinity) return value > 0 ? "inf" : "-inf";
  return String(value);
}
