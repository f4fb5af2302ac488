// What is simulated: a case of the paper and what differs from it. Settings choose the parts, values are their numbers.
//
// An experiment is {case, settings: {key: choice}, values: {key: number}}; it holds differences from the case alone.

export const SEED = "simulation.seed";

// What the catalogue says of the seed, which is no number of the compiled loop.
export const ABOUT_SEED = {unit: "1", meaning: "seed of every random signal of the run", kind: "integer", low: 0, high: 2 ** 32, default: 0,
  slider: [0, 100], scale: "linear", optional: false, tunable: false};

export function blank(catalogue, id) {
  const known = (wanted) => catalogue.cases.find((each) => each.id === wanted);
  return {case: (known(id) ?? known("case-4")).id, settings: {}, values: {}};
}

export function caseOf(catalogue, experiment) {
  return catalogue.cases.find((known) => known.id === experiment.case);
}

function structureById(catalogue, id) {
  return catalogue.structures.find((structure) => structure.id === id);
}

// The structure an experiment runs on: of its case's machine, and of those that agree with the most recent choice, the
// one nearest to all others.
export function structureOf(catalogue, experiment, last = null) {
  const base = structureById(catalogue, caseOf(catalogue, experiment).structure);
  const wanted = {...base.settings, ...experiment.settings};
  const score = (structure) => Object.entries(wanted).reduce(
    (sum, [key, choice]) => sum + (structure.settings[key] === choice ? (key === last ? 1000 : key === "controller.kind" ? 100 : 1) : 0), 0);
  const offered = catalogue.structures.filter(({machine}) => machine === base.machine);
  return offered.reduce((best, structure) => (score(structure) > score(best) ? structure : best), base);
}

// The choices there are: key → its options among all structures, where there is more than one.
export function choices(catalogue) {
  const found = new Map();
  for (const structure of catalogue.structures) {
    for (const [key, choice] of Object.entries(structure.settings)) {
      if (!found.has(key)) found.set(key, new Set());
      found.get(key).add(choice);
    }
  }
  return new Map([...found].filter(([, options]) => options.size > 1).map(([key, options]) => [key, [...options]]));
}

// The number of a key where nobody has changed it.
export function baseValue(catalogue, experiment, key) {
  return caseOf(catalogue, experiment).values[key] ?? structureOf(catalogue, experiment).defaults?.[key] ?? catalogue.keys[key].default ?? null;
}

export function valueOf(catalogue, experiment, key) {
  return key in experiment.values ? experiment.values[key] : baseValue(catalogue, experiment, key);
}

// A new experiment with a number changed; the case's own number is no difference.
export function withValue(catalogue, experiment, key, value) {
  const values = {...experiment.values, [key]: value};
  if (value === baseValue(catalogue, experiment, key)) delete values[key];
  return {...experiment, values};
}

// A new experiment with the case's own number.
export function withoutValue(experiment, key) {
  const {[key]: _, ...values} = experiment.values;
  return {...experiment, values};
}

// A new experiment with another part, whose own settings follow where a structure has no other.
export function withSetting(catalogue, experiment, key, choice) {
  const wanted = {...experiment, settings: {...experiment.settings, [key]: choice}};
  return withStructure(catalogue, wanted, structureOf(catalogue, wanted, key));
}

function withStructure(catalogue, experiment, structure) {
  const base = structureById(catalogue, caseOf(catalogue, experiment).structure).settings;
  const settings = Object.fromEntries(Object.entries(structure.settings).filter(([key, choice]) => base[key] !== choice));
  return {...experiment, settings};
}

// The same controller on another case.
export function withCase(catalogue, experiment, id) {
  return withStructure(catalogue, {...experiment, case: id}, structureOf(catalogue, {...experiment, case: id}));
}

// What an engine runs: numbers that the structure knows, those of the case among them.
export function request(catalogue, experiment) {
  const structure = structureOf(catalogue, experiment);
  const known = new Set(structure.parameters);
  const all = {...caseOf(catalogue, experiment).values, ...experiment.values};
  const values = Object.fromEntries(Object.entries(all).filter(([key]) => known.has(key)));
  return {structure: structure.id, values, seed: valueOf(catalogue, experiment, SEED)};
}

// The gains of the law and its estimator.
export function tunables(catalogue, experiment) {
  const {parameters} = structureOf(catalogue, experiment);
  return parameters.filter((key) => /^controller\.(?!coordination\.|winch_)/.test(key) && catalogue.keys[key].tunable);
}

// Everything that differs from the defaults of a file: what the case sets, then what was changed.
export function differences(catalogue, experiment) {
  return {...settingsOf(catalogue, experiment), ...experiment.values};
}

function settingsOf(catalogue, experiment) {
  const fixed = structureById(catalogue, caseOf(catalogue, experiment).structure).settings;
  return Object.fromEntries(Object.entries(experiment.settings).filter(([key, choice]) => fixed[key] !== choice));
}
