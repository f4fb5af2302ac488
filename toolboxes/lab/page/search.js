// A (1+1) evolution strategy with the one-fifth success rule (Rechenberg, 1973), in the unit cube.

import {normal, random} from "./random.js";

const SUCCESS = Math.exp(0.6), FAILURE = SUCCESS ** -0.25;

// Ask-and-tell interface: `ask()` returns the next point, `tell(cost)` takes its cost; `best` is the best so far.
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

  // Returns whether the point is the best so far.
  tell(cost) {
    const better = cost <= this.best.cost || this.trials === 0;
    if (this.trials > 0) this.size = Math.min(Math.max(this.size * (better ? SUCCESS : FAILURE), 1e-4), 0.5);
    if (better) this.best = {point: this.next, cost};
    this.trials += 1;
    return better;
  }
}

// Reflection at the ends of the unit interval.
function mirrored(value) {
  const turned = Math.abs(value % 2);
  return turned > 1 ? 2 - turned : turned;
}
