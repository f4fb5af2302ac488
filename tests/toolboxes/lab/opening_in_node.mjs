// Opens texts from standard input with the page's modules; writes a line of JSON for each.
import {readFileSync} from "node:fs";
import {pathToFileURL} from "node:url";
import {runInThisContext} from "node:vm";

const [page, library, content] = process.argv.slice(2);
runInThisContext(readFileSync(library, "utf8")); // a global, as in the page
const {readToml} = await import(pathToFileURL(`${page}/toml.js`));
const {fromFile, fromHash, tomlOf} = await import(pathToFileURL(`${page}/share.js`));
const {structureOf} = await import(pathToFileURL(`${page}/experiment.js`));
const catalogue = content ? JSON.parse(readFileSync(content, "utf8")) : null;

function opened(text) {
  const {experiment, unsupported} = text.startsWith("#case") ? fromHash(catalogue, text) : fromFile(catalogue, readToml(text));
  return {case: experiment.case, structure: structureOf(catalogue, experiment).id, toml: tomlOf(catalogue, experiment), unsupported};
}

for (const text of JSON.parse(readFileSync(0, "utf8"))) {
  let answer;
  try {
    answer = catalogue ? opened(text) : readToml(text);
  } catch (error) {
    answer = {error: error.message};
  }
  console.log(JSON.stringify(answer, (_, value) => (typeof value === "bigint" ? String(value) : value)));
}
