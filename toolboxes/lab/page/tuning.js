// A minute of tuning: a search for the law's gains on the present experiment, as a demonstration of `dualwinch tune`.

import {baseValue, request, tunables, valueOf, withValue} from "./experiment.js";
import {change, digits, plain} from "./numbers.js";
import {SLIDER_STEPS, sliderRange, toPosition, toValue} from "./range.js";
import {Search} from "./search.js";
import {label} from "./sections.js";
import {smallPlot} from "./small_plot.js";

const SECONDS = 60;

// Cost of a trial relative to the first one: its error, with penalties for more slack or much more chatter.
export function cost(metrics, first) {
  if (!Number.isFinite(metrics.mae)) return Infinity;
  const chatter = Math.max(metrics.chatter / Math.max(2 * first.chatter, 1e-9), 1);
  const slack = Math.max(metrics.slack_share - first.slack_share, 0);
  return metrics.mae / first.mae * chatter * (1 + 1000 * slack);
}

export class Tuning {
  // accept(experiment): adopt its gains.
  constructor(holder, catalogue, runner, current, accept) {
    Object.assign(this, {holder, catalogue, runner, current, accept, stopped: true});
    holder.innerHTML = `<p>Searches for gains of the law for a minute, on the present experiment: minimises mean |e|, with no more slack and at most twice the chatter of the start. For real machines, which differ from the nominal one, use <code>dualwinch tune</code>.</p>
      <p class="buttons"><button type="button" class="go">Tune for a minute</button><button type="button" class="take" hidden>Take these gains</button></p>
      <div class="trace" hidden></div><p class="summary" aria-live="polite"></p><ul class="gains"></ul>`;
    this.button = holder.querySelector(".go");
    this.take = holder.querySelector(".take");
    this.button.addEventListener("click", () => (this.stopped ? this.#run() : this.#stop()));
    this.take.addEventListener("click", () => { this.take.hidden = true; this.accept(this.found); });
  }

  #stop() {
    this.stopped = true;
    this.button.textContent = "Tune for a minute";
  }

  async #run() {
    const {catalogue} = this, experiment = this.current(), gains = this.#gains(experiment);
    this.stopped = false;
    this.found = null;
    this.take.hidden = true;
    this.button.textContent = "Stop";
    this.holder.querySelector(".trace").hidden = false;
    const plot = smallPlot(this.holder.querySelector(".trace"), {title: "Cost of each trial and the best so far", xLabel: "", log: true,
      series: [{tint: "ink-soft", width: 0, points: true}, {tint: "blue", width: 1.5}]});
    const search = new Search(gains.map(({start}) => start), 1), trials = [], best = [], started = performance.now();
    let first = null, shown = 0;
    try {
      while (!this.stopped && performance.now() - started < SECONDS * 1000) {
        const tried = withGains(catalogue, experiment, gains, search.ask(), search.trials);
        const {metrics} = await this.runner().run(request(catalogue, tried), "none");
        first ??= metrics;
        const costs = cost(metrics, first);
        if (search.tell(costs)) {
          this.found = search.trials > 1 ? tried : null;
          this.metrics = metrics;
        }
        trials.push(Number.isFinite(costs) ? Math.min(costs, 10) : null);
        best.push(search.best.cost);
        if (performance.now() - shown > 150) {
          shown = performance.now();
          plot.setData([best.map((_, index) => index + 1), trials, best]);
          this.#summary(search, first, experiment, Math.round((shown - started) / 1000));
        }
      }
      plot.setData([best.map((_, index) => index + 1), trials, best]);
      this.#summary(search, first, experiment, null);
    } catch (error) {
      this.holder.querySelector(".summary").textContent = error.message;
    }
    this.take.hidden = !this.found;
    this.#stop();
  }

  #gains(experiment) {
    return tunables(this.catalogue, experiment).filter((key) => Number.isFinite(valueOf(this.catalogue, experiment, key))).map((key) => {
      const range = sliderRange(this.catalogue.keys[key], baseValue(this.catalogue, experiment, key));
      const start = Math.min(Math.max(toPosition(range, valueOf(this.catalogue, experiment, key)) / SLIDER_STEPS, 0), 1);
      return {key, range, start};
    });
  }

  #summary(search, first, experiment, seconds) {
    const better = this.metrics ?? first;
    this.holder.querySelector(".summary").textContent = `${seconds === null ? "" : `${seconds} s, `}${search.trials} rollouts: mean |e| ${digits(first.mae * 1e3, 3)} → ${digits(better.mae * 1e3, 3)} mm (${change(first.mae, better.mae)}).`;
    this.holder.querySelector(".gains").replaceChildren(...Object.entries(this.found?.values ?? {}).filter(([key, value]) => value !== experiment.values[key]).map(([key, value]) => {
      const item = document.createElement("li");
      item.textContent = `${label(key)} ${plain(valueOf(this.catalogue, experiment, key))} → ${plain(value)}`;
      item.title = key;
      return item;
    }));
  }
}

// The first trial is the start itself, even if it is outside the range of the search.
function withGains(catalogue, experiment, gains, point, trial) {
  if (trial === 0) return experiment;
  return gains.reduce((changed, {key, range}, index) => withValue(catalogue, changed, key, toValue(range, point[index] * SLIDER_STEPS)), experiment);
}
