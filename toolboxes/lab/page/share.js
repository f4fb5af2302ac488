// Export of an experiment as link, command line or file, and import from link or file.

import {blank, caseOf, choices, differences, structureOf, SEED, valueOf, withSettings, withValue} from "./experiment.js";
import {literal, writeToml} from "./toml.js";

const LAG = "actuator.motor.time_constant";

export function hashOf(catalogue, experiment) {
  const words = new URLSearchParams({case: experiment.case.replace("case-", "")});
  for (const [key, value] of Object.entries(differences(catalogue, experiment)).sort()) words.set(key, String(value));
  return `#${words}`;
}

// {experiment, unsupported} of a link.
export function fromHash(catalogue, hash) {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  const {case: id, ...texts} = Object.fromEntries(words);
  const entries = Object.fromEntries(Object.entries(texts).map(([key, text]) => [key, typed(text)]));
  let experiment = withOptions(catalogue, blank(catalogue, `case-${id}`), entries);
  for (const [key, value] of Object.entries(entries)) {
    const number = inLoop(value, catalogue.keys[key]);
    if (number !== undefined && isNumber(catalogue, experiment, key)) experiment = withValue(catalogue, experiment, key, number);
  }
  const written = Object.entries(entries).map(([key, value]) => [key, typeof value === "number" ? asFile(value, catalogue.keys[key]) : value]);
  return {experiment, unsupported: unsupported(catalogue, experiment, withActuator(Object.fromEntries(written)))};
}

function typed(text) {
  if (text === "true" || text === "false") return text === "true";
  return text !== "" && !Number.isNaN(Number(text)) ? Number(text) : text;
}

// {experiment, unsupported} of a file's entries by key; missing keys have their defaults. Of all cases it is the one that
// leaves the least unsupported, then the one that needs the fewest changes.
export function fromFile(catalogue, entries) {
  const whole = completed(catalogue, entries);
  const given = (key) => key in entries || key in catalogue.file.common;
  const wanted = Object.fromEntries(Object.entries(whole).filter(([key]) => given(key)));
  const changes = ({experiment: {settings, values}}) => Object.keys({...settings, ...values}).length;
  const found = catalogue.cases.map(({id}) => {
    const experiment = adopted(catalogue, blank(catalogue, id), whole);
    return {experiment, unsupported: unsupported(catalogue, experiment, wanted)};
  });
  return found.reduce((best, next) => ((next.unsupported.length - best.unsupported.length || changes(next) - changes(best)) < 0 ? next : best));
}

// An experiment with the parts and numbers of a whole file, as far as the page supports them.
function adopted(catalogue, start, whole) {
  let experiment = withOptions(catalogue, start, whole);
  for (const key of [...structureOf(catalogue, experiment).parameters, SEED]) {
    const about = catalogue.keys[key], usual = key === LAG ? 0 : catalogue.file.common[key];
    const number = inLoop(whole[key], about) ?? inLoop(usual, about);
    const outside = number !== null && (number < (about.low ?? -Infinity) || number > (about.high ?? Infinity));
    if (number !== undefined && !outside) experiment = withValue(catalogue, experiment, key, number);
  }
  return experiment;
}

function withOptions(catalogue, experiment, entries) {
  const known = [...choices(catalogue)].map(([key, options]) => [key, options.find((option) => String(option) === String(entries[key]))]);
  return withSettings(catalogue, experiment, Object.fromEntries(known.filter(([, option]) => option !== undefined)));
}

function isNumber(catalogue, experiment, key) {
  return key === SEED || structureOf(catalogue, experiment).parameters.includes(key);
}

// Entries of a file and the defaults of all other keys, without those of parts that it does not use and those that change
// how a run is computed, not the machine.
function completed(catalogue, entries) {
  const {common, parts, same} = catalogue.file;
  const used = Object.assign({...common}, ...Object.entries(parts).map(([choice, options]) => options[entries[choice] ?? common[choice]]));
  const ofParts = new Set(Object.values(parts).flatMap((options) => Object.values(options).flatMap(Object.keys)));
  const given = Object.entries(entries).filter(([key]) => !same.includes(key) && (key in used || !ofParts.has(key)));
  return {...used, ...Object.fromEntries(given)};
}

// [{key, wanted, used}] of the entries that are not the page's own, parts first; `used` is undefined if nothing is in their place.
function unsupported(catalogue, experiment, entries) {
  const structure = structureOf(catalogue, experiment);
  const numbers = Object.fromEntries([...structure.parameters, SEED].map((key) => [key, asFile(valueOf(catalogue, experiment, key), catalogue.keys[key])]));
  const own = completed(catalogue, {...structure.fixed, ...structure.settings, ...withActuator(numbers)});
  const found = Object.entries(entries).map(([key, wanted]) => ({key, wanted, used: own[key]})).filter(({wanted, used}) => !same(wanted, used));
  const matter = found.filter(({key}) => !structure.idle.includes(key));
  const plantDiffers = matter.some(({key}) => key.startsWith("plant."));
  const isPart = ({key, wanted}) => Number(typeof wanted === "string" || key in structure.settings);
  return (plantDiffers ? found : matter).sort((one, other) => isPart(other) - isPart(one));
}

function same(one, other) {
  if (Array.isArray(one) && Array.isArray(other)) return one.length === other.length && one.every((item, index) => same(item, other[index]));
  return one === other || (one ?? null) === (other ?? null);
}

export function commandLine(catalogue, experiment) {
  // another machine is written as the paper's Case 2 with other numbers
  const number = /^case-(\d)$/.exec(experiment.case)?.[1], own = number ? {} : caseOf(catalogue, experiment).values;
  const values = withActuator({...own, ...differences(catalogue, experiment)});
  const sets = Object.entries(values).map(([key, value]) => ` --set ${key}=${inShell(value, catalogue.keys[key])}`);
  return `uv run dualwinch simulate --case ${number ?? 2}${sets.join("")}`;
}

// In a file, a motor with lag is a separate part; without lag that part is absent.
function withActuator({[LAG]: lag, ...values}) {
  return lag > 0 ? {...values, "actuator.kind": "motor", [LAG]: lag} : values;
}

function inShell(value, about) {
  const written = asFile(value, about);
  return typeof written === "string" ? written : literal(written);
}

// Switches and choices are numbers in the compiled loop and words in a file.
function asFile(value, about) {
  if (about?.kind === "switch") return Boolean(value);
  return about?.kind === "choice" ? about.choices[value] : value;
}

// The inverse; undefined if the value is no number of the loop.
function inLoop(value, about) {
  if (about?.kind === "choice" && typeof value === "string") return about.choices.includes(value) ? about.choices.indexOf(value) : undefined;
  if ((value === "none" || value === null) && about?.optional) return null;
  return typeof value === "number" || typeof value === "boolean" ? Number(value) : undefined;
}

export function tomlOf(catalogue, experiment) {
  const known = caseOf(catalogue, experiment);
  const all = {...structureOf(catalogue, experiment).settings, ...known.values, ...differences(catalogue, experiment)};
  const entries = Object.entries(withActuator(all)).filter(([, value]) => value !== null).map(([key, value]) => [key, asFile(value, catalogue.keys[key])]);
  return writeToml(Object.fromEntries(entries), [`dualwinch experiment from the lab: ${known.label}`, "run it with: uv run dualwinch simulate --config FILE"]);
}

export function csvOf(run) {
  const names = ["t", ...Object.keys(run.columns).filter((name) => name !== "t")];
  const columns = names.map((name) => (name === "t" ? run.t : run.columns[name]));
  const lines = [names.join(",")];
  for (let row = 0; row < run.t.length; row++) lines.push(columns.map((column) => (Number.isNaN(column[row]) ? "" : column[row])).join(","));
  return `${lines.join("\n")}\n`;
}

export function download(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], {type: "text/plain"}));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

