// Experiments as TOML: read in whole, as TOML 1.0 has it, and written for numbers, switches and words.

// {dotted key: value} of a text; tables become dotted keys, arrays stay arrays. Integers beyond 2⁵³ are BigInt, dates text.
export function readToml(text) {
  return Object.fromEntries(flattened(new Reader(text).document()));
}

function flattened(table, prefix = "") {
  return Object.entries(table).flatMap(([name, value]) => (isTable(value) ? flattened(value, `${prefix}${name}.`) : [[prefix + name, value]]));
}

function isTable(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

const ESCAPES = {b: "\b", t: "\t", n: "\n", f: "\f", r: "\r", '"': '"', "\\": "\\"};

// A recursive-descent parser; `at` is the index of the next character.
class Reader {
  constructor(text) {
    this.text = text.replace(/^\uFEFF/, "").replaceAll("\r\n", "\n");
    this.at = 0;
  }

  document() {
    const root = Object.create(null);
    let table = root;
    for (this.#blank(); this.at < this.text.length; this.#blank()) {
      if (this.#take("[[")) table = this.#entered(root, this.#keyUntil("]]"), true);
      else if (this.#take("[")) table = this.#entered(root, this.#keyUntil("]"), false);
      else this.#pair(table);
      this.#match(/[ \t]*(#[^\n]*)?/y);
      if (this.at < this.text.length && !this.#take("\n")) this.#fail("must end the line");
    }
    return root;
  }

  // The table of a header: a new last one of an array of tables, or the only one.
  #entered(root, key, several) {
    const name = key.at(-1), parent = this.#below(root, key.slice(0, -1));
    if (!several) return this.#below(parent, [name]);
    parent[name] ??= [];
    if (!Array.isArray(parent[name])) this.#fail(`'${key.join(".")}' is given twice`);
    parent[name].push(Object.create(null));
    return parent[name].at(-1);
  }

  #below(table, names) {
    for (const name of names) {
      table[name] ??= Object.create(null);
      table = Array.isArray(table[name]) ? table[name].at(-1) : table[name];
      if (!isTable(table)) this.#fail(`'${name}' is no table`);
    }
    return table;
  }

  #pair(table) {
    const key = this.#keyUntil("="), name = key.at(-1), holder = this.#below(table, key.slice(0, -1));
    if (name in holder) this.#fail(`'${key.join(".")}' is given twice`);
    this.#match(/[ \t]*/y);
    holder[name] = this.#value();
  }

  #keyUntil(end) {
    const names = [];
    do {
      this.#match(/[ \t]*/y);
      const quote = this.text[this.at];
      names.push(quote === '"' || quote === "'" ? this.#string() : this.#match(/[\w-]+/y) ?? this.#fail("must be a key"));
      this.#match(/[ \t]*/y);
    } while (this.#take("."));
    if (!this.#take(end)) this.#fail(`must have '${end}' after '${names.join(".")}'`);
    return names;
  }

  #value() {
    const first = this.text[this.at];
    if (first === '"' || first === "'") return this.#string();
    if (this.#take("[")) return this.#items("]", (found) => found.push(this.#value()), []);
    if (this.#take("{")) return this.#items("}", (found) => this.#pair(found), Object.create(null));
    return this.#scalar(this.#match(/\d{4}-\d\d-\d\d[Tt ]\d[\d:.]*(Z|[+-]\d\d:\d\d)?|[\w+\-.:]+/y) ?? this.#fail("must be a value"));
  }

  #items(end, item, found) {
    for (this.#blank(); !this.#take(end); this.#blank()) {
      item(found);
      this.#blank();
      if (this.#take(",")) continue;
      if (!this.#take(end)) this.#fail(`must be ',' or '${end}'`);
      break;
    }
    return found;
  }

  #scalar(word) {
    if (word === "true" || word === "false") return word === "true";
    if (/^[+-]?(inf|nan)$/.test(word)) return word.endsWith("nan") ? NaN : word[0] === "-" ? -Infinity : Infinity;
    const plain = word.replaceAll("_", "");
    if (/^([+-]?\d+|0x[\da-f]+|0o[0-7]+|0b[01]+)$/i.test(plain)) return Number.isSafeInteger(Number(plain)) ? Number(plain) : BigInt(plain.replace("+", ""));
    if (/^[+-]?\d+(\.\d+)?(e[+-]?\d+)?$/i.test(plain)) return Number(plain);
    return /^\d\d(\d\d-|:)\d\d/.test(word) ? word : this.#fail(`'${word}' is no value`);
  }

  #string() {
    const quote = this.text[this.at], triple = quote.repeat(3), end = this.text.startsWith(triple, this.at) ? triple : quote;
    this.at += end.length;
    if (end === triple) this.#take("\n");
    let found = "";
    for (;;) {
      // a multi-line string may end in up to two quotes of its own
      if (this.text.startsWith(end, this.at) && !(end === triple && this.text[this.at + 3] === quote)) break;
      if (this.at >= this.text.length || (end === quote && this.text[this.at] === "\n")) this.#fail("a string must end");
      found += quote === '"' && this.#take("\\") ? this.#escaped() : this.text[this.at++];
    }
    this.at += end.length;
    return found;
  }

  #escaped() {
    if (this.#match(/[ \t]*\n\s*/y) !== null) return "";
    const code = this.#match(/u[\da-f]{4}|U[\da-f]{8}/iy), letter = code ?? this.text[this.at++];
    return code ? String.fromCodePoint(parseInt(code.slice(1), 16)) : ESCAPES[letter] ?? this.#fail(`'\\${letter}' is no escape`);
  }

  // Skip white space, line breaks and comments.
  #blank() {
    this.#match(/([ \t\n]|#[^\n]*)*/y);
  }

  #take(word) {
    const found = this.text.startsWith(word, this.at);
    if (found) this.at += word.length;
    return found;
  }

  #match(pattern) {
    pattern.lastIndex = this.at;
    const found = pattern.exec(this.text);
    if (found) this.at = pattern.lastIndex;
    return found?.[0] ?? null;
  }

  #fail(complaint) {
    throw new Error(`line ${this.text.slice(0, this.at).split("\n").length}: ${complaint}`);
  }
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
