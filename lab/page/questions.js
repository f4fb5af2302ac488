// Questions to play with, which notice when they are answered.

import {blank, request, structureOf, valueOf, withSetting, withValue} from "./experiment.js";
import {digits} from "./numbers.js";

// start: the experiment to begin with; answer(run, experiment, helper): {now: what is so, solved: why, or null}.
export const QUESTIONS = [
  {
    title: "Make rope 2 go slack",
    ask: "Ropes cannot push. Two winches pull against each other, so that neither rope goes slack. When does rope 2 do so nevertheless?",
    hint: "What keeps it taut is the preload. Or ask for more than the motors have: a step in speed (Case 1).",
    start: (catalogue) => blank(catalogue, "case-4"),
    answer: ({run}) => {
      const lowest = run.columns.F2 ? run.columns.F2.reduce((low, force) => Math.min(low, force), Infinity) : NaN;
      return {now: `lowest tension of rope 2: ${digits(lowest, 3)} N`,
        solved: lowest <= 0 ? "Slack. The vehicle is pulled by one rope alone, and when the other one is taut again, it jerks. Press play in slow motion there." : null};
    },
  },
  {
    title: "Find L₀ for −76 %",
    ask: "The paper says that its observer takes 76 % off the steady-state error of Case 4, and does not say with which L₀. Which one does it take?",
    hint: "More L₀ follows a disturbance faster. The change is counted against the same law without the observer (nftsm).",
    start: (catalogue) => blank(catalogue, "case-4"),
    compare: (catalogue, experiment) => experiment.case === "case-4" ? request(catalogue, withSetting(catalogue, experiment, "controller.kind", "nftsm")) : null,
    answer: ({run, compared, kind, caseId}) => {
      if (caseId !== "case-4" || kind !== "fando-nftsm") return {now: "needs Case 4 and fando-nftsm", solved: null};
      const share = compared ? run.metrics.steady_mae / compared.metrics.steady_mae - 1 : NaN;
      return {now: `steady mean |e|: ${Number.isFinite(share) ? `${share < 0 ? "−" : "+"}${Math.abs(100 * share).toFixed(1)} %` : "–"}`,
        solved: Math.abs(share + 0.76) < 0.003 ? "That is it, and it shows what the figure rests on: an L₀ that the paper does not print. With 50 it would be more than 99 %." : null};
    },
  },
  {
    title: "Add delay until it oscillates",
    ask: "With L₀ = 50 the observer takes more than 99 % off the error. But a fieldbus, a filter, a drive: the torque comes late. How many milliseconds does it bear?",
    hint: "Delay and sampling › delay samples, tens of them. Then see how much more the paper’s L₀ = 5 bears.",
    start: (catalogue) => withValue(catalogue, blank(catalogue, "case-4"), "controller.observer.l0", 50),
    answer: ({run, value}) => {
      const late = (value("simulation.delay_samples") ?? 0) * (value("simulation.sample_time") ?? 1e-3) * 1e3;
      const wild = run.outcome !== "completed" || run.metrics.torque_rate > 100;
      return {now: `delay ${digits(late, 3)} ms; torques change by ${digits(run.metrics.torque_rate, 3)} N m/s`,
        solved: late > 0 && wild ? `It oscillates at ${digits(late, 3)} ms: what a gain is worth depends on what comes between law and motor.` : null};
    },
  },
  {
    title: "Start Case 1 without the kick",
    ask: "Case 1 asks for 1.5 m/s at once. Motors saturate, the error grows to 2.3 m. Keep the largest error below 10 cm without touching the controller.",
    hint: "Nobody can follow a step in speed. A reference with a bound on its jerk asks for what a machine can do.",
    start: (catalogue) => blank(catalogue, "case-1"),
    answer: ({run, caseId}) => ({now: `largest |e|: ${digits(run.metrics.max_abs_error, 3)} m`,
      solved: caseId === "case-1" && run.metrics.max_abs_error < 0.1 ? "The reference was the problem, not the law." : null}),
  },
  {
    title: "Find the cheapest preload",
    ask: "Two winches that pull against each other warm their motors. How little preload can Case 4 do with, before a rope goes slack?",
    hint: "Watch the slack share and the lowest tension. It is the kick at the start that decides.",
    start: (catalogue) => blank(catalogue, "case-4"),
    answer: ({run, value, caseId}) => {
      const preload = value("controller.coordination.preload"), {slack_share: slack, continuous_load: load} = run.metrics;
      return {now: `preload ${digits(preload)} N, slack ${digits(100 * slack, 2)} % of the time, continuous load ${digits(load)} N m`,
        solved: caseId === "case-4" && slack === 0 && preload <= 1800 ? `${digits(preload)} N. It saves little: most of the load is what moves the vehicle.` : null};
    },
  },
];

export class Questions {
  // begin(experiment): show it; runner(): a worker for runs that are compared with.
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

  // What a run says to the question that is open; only a run that comes while it is open answers it.
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
