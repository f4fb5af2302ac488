// Exercises that detect when they are answered.

import {blank, request, structureOf, valueOf, withSetting, withValue} from "./experiment.js";
import {digits} from "./numbers.js";

// start: the initial experiment; answer({run, compared, ...}): {now: present state, solved: explanation, or null}.
export const QUESTIONS = [
  {
    title: "Make rope 2 go slack",
    ask: "Ropes cannot push. Two winches pull against each other, so that neither rope goes slack. When does rope 2 go slack nevertheless?",
    hint: "The preload keeps it taut. Or demand more than the motors can deliver: a step in speed (Case 1).",
    start: (catalogue) => blank(catalogue, "case-4"),
    answer: ({run}) => {
      const lowest = run.columns.F2 ? run.columns.F2.reduce((low, force) => Math.min(low, force), Infinity) : NaN;
      return {now: `lowest tension of rope 2: ${digits(lowest, 3)} N`,
        solved: lowest <= 0 ? "Slack. One rope alone pulls the vehicle, and when the other becomes taut again, the vehicle jerks. Play that in slow motion." : null};
    },
  },
  {
    title: "Find L₀ for −76 %",
    ask: "The paper says that its observer reduces the steady-state error of Case 4 by 76 %, but not with which L₀. Which L₀ does that?",
    hint: "A larger L₀ follows a disturbance faster. The reduction is relative to the same law without the observer (nftsm).",
    start: (catalogue) => blank(catalogue, "case-4"),
    compare: (catalogue, experiment) => experiment.case === "case-4" ? request(catalogue, withSetting(catalogue, experiment, "controller.kind", "nftsm")) : null,
    answer: ({run, compared, kind, caseId}) => {
      if (caseId !== "case-4" || kind !== "fando-nftsm") return {now: "needs Case 4 and fando-nftsm", solved: null};
      const share = compared ? run.metrics.steady_mae / compared.metrics.steady_mae - 1 : NaN;
      return {now: `steady mean |e|: ${Number.isFinite(share) ? `${share < 0 ? "−" : "+"}${Math.abs(100 * share).toFixed(1)} %` : "–"}`,
        solved: Math.abs(share + 0.76) < 0.003 ? "That is it: the figure depends on an L₀ that the paper does not print. With 50 it would be more than 99 %." : null};
    },
  },
  {
    title: "Add delay until it oscillates",
    ask: "With L₀ = 50 the observer reduces the error by more than 99 %. But fieldbus, filters and drives delay the torque. How many milliseconds of delay does the loop tolerate?",
    hint: "Delay and sampling › delay samples, tens of them. Then see how much more the loop tolerates with the paper’s L₀ = 5.",
    start: (catalogue) => withValue(catalogue, blank(catalogue, "case-4"), "controller.observer.l0", 50),
    answer: ({run, value}) => {
      const late = (value("simulation.delay_samples") ?? 0) * (value("simulation.sample_time") ?? 1e-3) * 1e3;
      const wild = run.outcome !== "completed" || run.metrics.torque_rate > 100;
      return {now: `delay ${digits(late, 3)} ms; torques change by ${digits(run.metrics.torque_rate, 3)} N m/s`,
        solved: late > 0 && wild ? `It oscillates at ${digits(late, 3)} ms: the value of a gain depends on the delay between law and motor.` : null};
    },
  },
  {
    title: "Start Case 1 without the kick",
    ask: "Case 1 demands 1.5 m/s at once. The motors saturate, and the error grows to 2.3 m. Keep the largest error below 10 cm without changing the controller.",
    hint: "No machine can follow a step in speed. A reference with a jerk limit demands only what a machine can do.",
    start: (catalogue) => blank(catalogue, "case-1"),
    answer: ({run, caseId}) => ({now: `largest |e|: ${digits(run.metrics.max_abs_error, 3)} m`,
      solved: caseId === "case-1" && run.metrics.max_abs_error < 0.1 ? "The reference was the problem, not the law." : null}),
  },
  {
    title: "Find the cheapest preload",
    ask: "Two winches that pull against each other load their motors. How small can the preload of Case 4 be before a rope goes slack?",
    hint: "Watch the slack share and the lowest tension. The kick at the start is decisive.",
    start: (catalogue) => blank(catalogue, "case-4"),
    answer: ({run, value, caseId}) => {
      const preload = value("controller.coordination.preload"), {slack_share: slack, continuous_load: load} = run.metrics;
      return {now: `preload ${digits(preload)} N, slack ${digits(100 * slack, 2)} % of the time, continuous load ${digits(load)} N m`,
        solved: caseId === "case-4" && slack === 0 && preload <= 1800 ? `${digits(preload)} N. It saves little: most of the load moves the vehicle.` : null};
    },
  },
];

export class Questions {
  // begin(experiment): show it; runner(): a worker for runs to compare with.
  constructor(holder, catalogue, runner, begin) {
    Object.assign(this, {holder, catalogue, runner, begin, compared: new Map()});
    holder.replaceChildren(...QUESTIONS.map((question, index) => this.#entry(question, index)));
    this.entries = [...holder.children];
  }

  #entry(question, index) {
    const entry = document.createElement("details");
    entry.name = "question";
    entry.className = "question";
    entry.innerHTML = `<summary><span class="mark" aria-hidden="true">${index + 1}</span>${question.title}<span class="done"></span></summary>
      <p>${question.ask}</p><p class="now" aria-live="polite"></p><p class="solved" aria-live="polite"></p>
      <p class="buttons"><button type="button">Begin</button></p><details class="hint"><summary>Hint</summary><p>${question.hint}</p></details>`;
    entry.querySelector("button").addEventListener("click", () => this.begin(question.start(this.catalogue)));
    entry.addEventListener("toggle", () => this.last && this.check(...this.last, false));
    return entry;
  }

  // Check a run against the open question; with answers = false it only updates the present state.
  async check(run, experiment, answers = true) {
    this.last = [run, experiment];
    for (const [index, question] of QUESTIONS.entries()) {
      const entry = this.entries[index];
      if (!entry.open) continue;
      const compared = await this.#compare(question, experiment);
      if (this.last[0] !== run) return;
      const {settings} = structureOf(this.catalogue, experiment);
      const {now, solved} = question.answer({run, compared, caseId: experiment.case, kind: settings["controller.kind"],
        value: (key) => settings[key] ?? (this.catalogue.keys[key] ? valueOf(this.catalogue, experiment, key) : null)});
      entry.querySelector(".now").textContent = `Now: ${now}.`;
      if (!solved || !answers) continue;
      entry.classList.add("answered");
      entry.querySelector(".solved").textContent = solved;
      entry.querySelector(".done").textContent = " answered";
    }
  }

  async #compare(question, experiment) {
    const asked = question.compare?.(this.catalogue, experiment);
    if (!asked) return null;
    const name = JSON.stringify(asked);
    if (!this.compared.has(name)) this.compared.set(name, this.runner().run(asked, "none").catch(() => null));
    return this.compared.get(name);
  }
}
