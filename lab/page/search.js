// A (1+1) evolution strategy with the one-fifth rule of success (Rechenberg, 1973), in the unit cube.

import {normal, random} from "./random.js";

const SUCCESS = Math.exp(0.6), FAILURE = SUCCESS ** -0.25;

// Asks and is told: `ask()` gives the next point, `tell(cost)` what it costs; the best so far is `best`.
export class Search {
  constructor(start, seed, size = 0.1) {
    this.uniform = random(seed);
    this.size = size;
    this.best = {point: start.slice(), cost: Infinity};
    this.next = start.slice();
    this.trials = 0;
  }

  ask() {
    if (this.trials > 0) this.next = this.best.point.map((value) => mirrored(value + this.size * normal(this.uniform)));
    return this.next;
  }

  // Whether it is the best so far.
  tell(cost) {
    const better = cost <= this.best.cost || this.trials === 0;
    if (this.trials > 0) this.size = Math.min(Math.max(this.size * (better ? SUCCESS : FAILURE), 1e-4), 0.5);
    if (better) this.best = {point: this.next, cost};
    this.trials += 1;
    return better;
  }
}

// Back into the unit interval at its ends.
function mirrored(value) {
  const turned = Math.abs(value % 2);
  return turned > 1 ? 2 - turned : turned;
}
