// Export of an experiment as link, command line or file, and import from link or file.

import {blank, caseOf, choices, differences, structureOf, SEED, withSetting, withValue} from "./experiment.js";
import {literal, writeToml} from "./toml.js";

const LAG = "actuator.motor.time_constant";

export function hashOf(catalogue, experiment) {
  const words = new URLSearchParams({case: experiment.case.replace("case-", "")});
  for (const [key, value] of Object.entries(differences(catalogue, experiment)).sort()) words.set(key, String(value));
  return `#${words}`;
}

export function fromHash(catalogue, hash) {
  const words = new URLSearchParams(hash.replace(/^#/, ""));
  const {case: id, ...entries} = Object.fromEntries(words);
  return fromEntries(catalogue, blank(catalogue, `case-${id}`), Object.fromEntries(Object.entries(entries).map(([key, text]) => [key, typed(text)]))).experiment;
}

function typed(text) {
  if (text === "true" || text === "false") return text === "true";
  return text !== "" && !Number.isNaN(Number(text)) ? Number(text) : text;
}

// {experiment, unknown} from entries by key; `unknown` are keys that the page does not support.
export function fromEntries(catalogue, start, entries) {
  let experiment = start;
  const unknown = [], options = choices(catalogue);
  for (const [key, value] of Object.entries(entries)) {
    const option = options.get(key)?.find((known) => String(known) === String(value));
    if (option !== undefined) experiment = withSetting(catalogue, experiment, key, option);
  }
  for (const [key, value] of Object.entries(entries)) {
    const number = inLoop(value, catalogue.keys[key]);
    if (options.has(key) || key === "actuator.kind") continue;
    else if (number !== undefined && (key === SEED || structureOf(catalogue, experiment).parameters.includes(key))) experiment = withValue(catalogue, experiment, key, number);
    else unknown.push(key);
  }
  return {experiment, unknown};
}

// The experiment of a file, on the case that agrees with most of its values; missing keys have their defaults.
export function fromFile(catalogue, entries) {
  const keys = [...new Set(catalogue.cases.flatMap((known) => Object.keys(known.values)))];
  const given = (key) => inLoop(entries[key], catalogue.keys[key]) ?? catalogue.keys[key].default;
  const matches = (known) => keys.filter((key) => (known.values[key] ?? catalogue.keys[key].default) === given(key)).length;
  const nearest = catalogue.cases.reduce((best, known) => (matches(known) > matches(best) ? known : best));
  return fromEntries(catalogue, blank(catalogue, nearest.id), entries);
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
  if (value === "none" && about?.optional) return null;
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

