// The simulated experiment: a case of the paper and differences from it. Settings choose the parts, values are numbers.
//
// An experiment is {case, settings: {key: choice}, values: {key: number}}, with differences from the case only.

export const SEED = "simulation.seed";

// The seed's entry, missing from the catalogue because the seed is no parameter of the compiled loop.
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

// The structure of an experiment: of those for its case's machine, the one that agrees with most choices, above all with
// the most recent one, then with the law.
export function structureOf(catalogue, experiment, last = null) {
  const base = structureById(catalogue, caseOf(catalogue, experiment).structure);
  const wanted = {...base.settings, ...experiment.settings};
  const score = (structure) => Object.entries(wanted).reduce(
    (sum, [key, choice]) => sum + (structure.settings[key] === choice ? (key === last ? 1000 : key === "controller.kind" ? 100 : 1) : 0), 0);
  const offered = catalogue.structures.filter(({machine}) => machine === base.machine);
  return offered.reduce((best, structure) => (score(structure) > score(best) ? structure : best), base);
}

// Map from key to options, for every choice with more than one option among all structures.
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

// The number of a key unless it is changed: of the case, the structure or the catalogue.
export function baseValue(catalogue, experiment, key) {
  return caseOf(catalogue, experiment).values[key] ?? structureOf(catalogue, experiment).defaults?.[key] ?? catalogue.keys[key].default ?? null;
}

export function valueOf(catalogue, experiment, key) {
  return key in experiment.values ? experiment.values[key] : baseValue(catalogue, experiment, key);
}

// A new experiment with a number changed; the case's own number is not stored.
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

// A new experiment with another part; other choices follow if no structure combines them.
export function withSetting(catalogue, experiment, key, choice) {
  const wanted = {...experiment, settings: {...experiment.settings, [key]: choice}};
  return withStructure(catalogue, wanted, structureOf(catalogue, wanted, key));
}

// A new experiment with several parts at once, the law first where no structure combines them.
export function withSettings(catalogue, experiment, settings) {
  const wanted = {...experiment, settings: {...experiment.settings, ...settings}};
  return withStructure(catalogue, wanted, structureOf(catalogue, wanted));
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

// The engine's request: structure, numbers that it has (the case's included), and seed.
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

// Everything that differs from the case: settings and values.
export function differences(catalogue, experiment) {
  return {...settingsOf(catalogue, experiment), ...experiment.values};
}

function settingsOf(catalogue, experiment) {
  const fixed = structureById(catalogue, caseOf(catalogue, experiment).structure).settings;
  return Object.fromEntries(Object.entries(experiment.settings).filter(([key, choice]) => fixed[key] !== choice));
}
