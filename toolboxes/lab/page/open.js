// The user's files: runs as CSV or Parquet, experiments as TOML.

import {fromFile} from "./share.js";
import {readToml} from "./toml.js";

// {experiment, unsupported} from a TOML file, {run} from a file with rows.
export async function openFile(catalogue, file) {
  const kind = file.name.split(".").at(-1).toLowerCase();
  if (kind === "toml") return fromFile(catalogue, entriesOf(file.name, await file.text()));
  if (kind === "csv") return {run: finished(file.name, readCsv(await file.text()), {})};
  if (kind === "parquet") return {run: await readParquet(file)};
  throw new Error(`${file.name}: must be a .toml, .csv or .parquet file`);
}

function entriesOf(name, text) {
  let entries;
  try {
    entries = readToml(text);
  } catch (error) {
    throw new Error(`${name}, ${error.message}`);
  }
  if ("ensemble.name" in entries) throw new Error(`${name} is an ensemble, no experiment: run it with dualwinch simulate --ensemble ${name}`);
  return entries;
}

export function readCsv(text) {
  const lines = text.trimEnd().split(/\r?\n/), names = lines[0].split(",").map((name) => name.trim().replaceAll('"', ""));
  const columns = Object.fromEntries(names.map((name) => [name, new Float64Array(lines.length - 1)]));
  const ordered = names.map((name) => columns[name]);
  for (let row = 1; row < lines.length; row++) {
    const cells = lines[row].split(",");
    if (cells.length !== names.length) throw new Error(`line ${row + 1}: must have ${names.length} numbers, has ${cells.length}`);
    cells.forEach((cell, index) => { ordered[index][row - 1] = cell === "" ? NaN : Number(cell); });
  }
  return columns;
}

async function readParquet(file) {
  const buffer = await file.arrayBuffer();
  const metadata = hyparquet.parquetMetadata(buffer), columns = {};
  await hyparquet.parquetRead({
    file: buffer, metadata, compressors: {ZSTD: (input, length) => fzstd.decompress(input, new Uint8Array(length))},
    onChunk: ({columnName, columnData, rowStart, rowEnd}) => {
      columns[columnName] ??= new Float64Array(Number(metadata.num_rows)).fill(NaN);
      for (let row = rowStart; row < rowEnd; row++) columns[columnName][row] = columnData[row - rowStart] ?? NaN;
    },
  });
  const facts = Object.fromEntries((metadata.key_value_metadata ?? []).map(({key, value}) => [key, value]));
  return finished(file.name, columns, JSON.parse((facts["dualwinch.metrics"] ?? "{}").replaceAll("NaN", "null")));
}

// A run in the page's format, from columns of a file or a live run.
export function finished(name, columns, metrics) {
  if (!columns.t || columns.t.length < 2) throw new Error(`${name}: must have a column t with at least two times`);
  if (!columns.e && !columns.F1) throw new Error(`${name}: has none of the columns e, F1, F2, tau_1, d_true`);
  return {label: name, t: columns.t, columns, metrics, outcome: "opened", until: columns.t.at(-1)};
}
