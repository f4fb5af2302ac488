// Experiments as TOML: read in whole by smol-toml (TOML 1.0), and written for numbers, switches and words.

// {dotted key: value} of a text; tables become dotted keys, arrays stay arrays. Integers beyond 2⁵³ are BigInt, dates text.
export function readToml(text) {
  try {
    return Object.fromEntries(flattened(smolToml.parse(text, {integersAsBigInt: "asNeeded"})));
  } catch (error) {
    if (error.line === undefined) throw error;
    const [complaint] = error.message.replace("Invalid TOML document: ", "").split("\n");
    throw new Error(`line ${error.line}: ${complaint}`);
  }
}

function flattened(table, prefix = "") {
  return Object.entries(table).flatMap(([name, value]) => {
    if (isTable(value)) return flattened(value, `${prefix}${name}.`);
    return [[prefix + name, value instanceof Date ? value.toISOString() : value]];
  });
}

function isTable(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value) && !(value instanceof Date);
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
