// Heading and label of each key.

const SECTIONS = [
  ["Gains", (key, about) => key.startsWith("controller.") && about.tunable && !key.startsWith("controller.coordination.") && !WINCHES.test(key)],
  ["Preload and coordination", (key) => key.startsWith("controller.coordination.")],
  ["Vehicle and rail", (key) => /^plant\.(vehicle|track)\.|^plant\.rope_slack$/.test(key)],
  ["Reference", (key) => key.startsWith("reference.")],
  ["Sea", (key) => key.startsWith("disturbance.")],
  ["Sensors", (key) => /^sensors\.|\.seed$/.test(key)],
  ["Delay and sampling", (key) => /^(simulation|actuator)\./.test(key)],
  ["Ropes and drums", (key) => key.startsWith("plant.")],
  ["Winch control", (key) => WINCHES.test(key)],
  ["Nominal plant of the controller", (key) => key.startsWith("controller.nominal.")],
  ["More of the controller", () => true],
];

const WINCHES = /^controller\.winch_/;

export const OPEN = new Set(["Gains", "Preload and coordination"]);

// [heading, keys] in the order of the page.
export function sections(keys, catalogue) {
  const found = SECTIONS.map(([heading]) => [heading, []]);
  for (const key of keys) {
    const index = SECTIONS.findIndex(([, holds]) => holds(key, catalogue.keys[key] ?? {}));
    found[index][1].push(key);
  }
  return found.filter(([, held]) => held.length);
}

const SYMBOLS = {
  "controller.observer.l0": "L₀", "controller.observer.kf": "K_f", "controller.nftsm.beta": "β", "controller.nftsm.eta": "η",
  "controller.nftsm.phi": "φ", "controller.auxiliary.gamma": "γ", "controller.auxiliary.gamma_force": "γ of forces",
  "controller.auxiliary.k_a": "k_a",
};

// The last part of a key as words, with the number of its winch or rope.
export function label(key) {
  if (SYMBOLS[key]) return SYMBOLS[key];
  const parts = key.split("."), name = parts.at(-1).replaceAll("_", " ");
  const twin = /_([12])$/.exec(parts.at(-2) ?? "");
  return twin ? `${name} ${twin[1]}` : name;
}
