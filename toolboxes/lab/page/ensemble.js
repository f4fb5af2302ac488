// Twenty machines that differ from the nominal one, under the same controller: a fan chart of their errors.

import {request, structureOf, valueOf} from "./experiment.js";
import {digits} from "./numbers.js";
import {smallPlot} from "./small_plot.js";

const POINTS = 300;

// The request of a machine: the rig's imperfections added to the experiment; the controller's nominal plant is unchanged.
export function drawn(catalogue, experiment, index) {
  const {rig, keys} = catalogue, asked = request(catalogue, experiment);
  const known = new Set(structureOf(catalogue, experiment).parameters), values = {...asked.values}, nominal = {};
  for (const [key, value] of Object.entries(rig.values)) {
    if (known.has(key) && !(key in experiment.values) && !key.startsWith("reference.")) values[key] = value;
  }
  for (const [key, machines] of Object.entries(rig.machines)) {
    if (!known.has(key)) continue;
    const usual = valueOf(catalogue, experiment, key);
    values[key] = rig.distributions[key].relative ? machines[index] / keys[key].default * usual : machines[index];
    if (key.startsWith("plant.")) nominal[key] = usual;
  }
  return {...asked, values, nominal, seed: rig.seeds[index]};
}

export class Ensemble {
  // runner(): the background worker; current(): the experiment.
  constructor(holder, catalogue, runner, current) {
    const count = catalogue.rig.seeds.length;
    Object.assign(this, {holder, catalogue, runner, current, count, stopped: true});
    holder.innerHTML = `<p>Draws ${count} machines within the tolerances of common parts, in a realistic sea, with realistic sensors (the <em>rig</em>), and runs this controller on each. Its model is the nominal machine.</p>
      <p class="buttons"><button type="button" class="go">Draw ${count}</button><progress max="${count}" value="0" aria-label="Machines run"></progress></p>
      <div class="fan" hidden></div><p class="summary" aria-live="polite"></p>`;
    this.button = holder.querySelector(".go");
    this.button.addEventListener("click", () => (this.stopped ? this.#run() : this.#stop()));
  }

  #stop() {
    this.stopped = true;
    this.button.textContent = `Draw ${this.count}`;
  }

  async #run() {
    const experiment = this.current(), runs = [];
    this.stopped = false;
    this.button.textContent = "Stop";
    this.holder.querySelector(".fan").hidden = false;
    const plot = this.#plot();
    try {
      for (let index = 0; index < this.count && !this.stopped; index++) {
        runs.push(await this.runner().run(drawn(this.catalogue, experiment, index), {names: ["e"], count: POINTS}));
        this.holder.querySelector("progress").value = runs.length;
        this.#show(plot, runs);
      }
    } catch (error) {
      this.holder.querySelector(".summary").textContent = error.message;
    }
    this.#stop();
  }

  #plot() {
    const edge = {tint: "fan", width: 0.5};
    return smallPlot(this.holder.querySelector(".fan"), {
      title: "Position error of all machines over time: range, middle half and median", xLabel: " s",
      series: [edge, edge, edge, edge, {tint: "blue", width: 1.5}],
      bands: [{series: [1, 2], fill: () => getComputedStyle(this.holder).getPropertyValue("--fan-outer")},
        {series: [3, 4], fill: () => getComputedStyle(this.holder).getPropertyValue("--fan-inner")}],
      values: (_, ticks) => ticks.map((tick) => `${digits(tick, 2)} mm`),
    });
  }

  #show(plot, runs) {
    const completed = runs.filter((run) => run.outcome === "completed");
    if (completed.length) {
      const times = completed[0].columns.t;
      const ordered = Array.from(times, (_, index) => completed.map((run) => run.columns.e[index] * 1e3).sort((a, b) => a - b));
      const quantile = (share) => ordered.map((values) => values[Math.round(share * (values.length - 1))]);
      plot.setData([Array.from(times), quantile(1), quantile(0), quantile(0.75), quantile(0.25), quantile(0.5)]);
    }
    const errors = completed.map((run) => run.metrics.mae * 1e3).sort((a, b) => a - b);
    const slack = completed.filter((run) => run.metrics.slack_share > 0).length;
    this.holder.querySelector(".summary").textContent = `${runs.length} of ${this.count}: mean |e| ${digits(median(errors), 3)} mm (median), `
      + `${digits(errors.at(-1), 3)} mm (worst)${slack ? `; a rope slack in ${slack}` : "; no rope slack"}${runs.length > completed.length ? `; ${runs.length - completed.length} not completed` : ""}.`;
  }
}

// ordered: numbers in ascending order.
function median(ordered) {
  const half = ordered.length / 2;
  return (ordered[Math.ceil(half) - 1] + ordered[Math.floor(half)]) / 2;
}
