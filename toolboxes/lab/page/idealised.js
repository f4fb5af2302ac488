// The plant's idealisations in one line: the catalogue's brief texts for the checks that are beyond their limits.

import {digits} from "./numbers.js";

// structure: of the run; checks: value and limit of each of its idealisations, in turn; tension: the controller's smallest
// command in N, at which they are evaluated.
export function idealised(structure, checks, tension) {
  const parts = new Map(), told = new Set();
  (checks ? structure.idealised : []).forEach(({part, atLeast, brief}, index) => {
    const [value, limit] = checks.slice(2 * index, 2 * index + 2);
    if (!(atLeast ? value < limit : value > limit)) return;
    const family = part + (brief.includes("without") ? "without" : "");
    if (told.has(family)) return;
    told.add(family);
    const words = brief.replace(/\{(\w+):(?:\.(\d))?g\}/g, (_, name, count = 6) => digits({value, limit, tension}[name], Number(count)));
    parts.set(words, [...(parts.get(words) ?? []), part]);
  });
  const both = {winch_1: "winches", rope_1: "ropes"};
  const briefs = [...parts].map(([words, of]) => `${of.length > 1 ? both[of[0]] : of[0].replace("_", " ")} ${words}`);
  return briefs.length ? `Idealised: ${briefs.join(", ")}. For real machines see docs/site.md.` : "";
}
