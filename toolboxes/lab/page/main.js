// The page: one experiment, its run, the pinned run, and the views of them.

import {Controls} from "./controls.js";
import {Ensemble} from "./ensemble.js";
import {ABOUT_SEED, blank, caseOf, request, SEED, structureOf, valueOf, withCase, withoutValue, withSetting, withValue} from "./experiment.js";
import {connectHeader, IN_HEADER} from "./header.js";
import {Machine} from "./machine.js";
import {follow} from "./live.js";
import {connectMenu} from "./menu.js";
import {idealised} from "./idealised.js";
import {claims, showMerits} from "./merits.js";
import {Notice, waysToRun} from "./notice.js";
import {digits} from "./numbers.js";
import {finished, openFile} from "./open.js";
import {Playback} from "./playback.js";
import {Plots} from "./plots.js";
import {Questions} from "./questions.js";
import {latest, Runner} from "./runner.js";
import {commandLine, csvOf, download, fromFile, fromHash, hashOf, tomlOf} from "./share.js";
import {connectTheme} from "./theme.js";
import {connectTransport} from "./transport.js";
import {Tuning} from "./tuning.js";

const element = (id) => document.getElementById(id);
const content = (id) => JSON.parse(element(id).textContent);

const catalogue = withSeed(content("catalogue")), modules = content("modules"), ownRun = content("own-run");
function withSeed(read) {
  return {...read, keys: {...read.keys, [SEED]: ABOUT_SEED}};
}

const notice = new Notice(element("notice"), () => element("menu").querySelector("summary").focus());
let experiment = location.hash.length > 1 ? ofLink() : blank(catalogue, "case-4");
let run = null, pinned = null;

const COMPENSATION = "controller.kalman.compensation";

const newRunner = () => new Runner(element("worker").textContent, catalogue, modules);
const runner = newRunner();
let spare = null;
const background = () => (spare ??= newRunner());

const playback = new Playback(showMoment);
const machine = new Machine(element("machine"));
const plots = new Plots(element("plots"), playback);
const controls = new Controls(element("controls"), catalogue, {
  onValue: (key, value) => change(withValue(catalogue, experiment, key, value)),
  onSetting: choose,
  onReset: (key) => change(withoutValue(experiment, key)),
});
const showHeader = connectHeader(element("choices"), catalogue, {onCase: (id) => change(withCase(catalogue, experiment, id)), onSetting: choose});
const questions = new Questions(element("questions"), catalogue, background, (begun) => { unpin(); change(begun); });
new Ensemble(element("ensemble"), catalogue, background, () => experiment);
new Tuning(element("tuning"), catalogue, background, () => experiment, (found) => { pin(); change(found); });

// ---- changes and their effects ----

const simulate = latest(async (wanted) => {
  busy(true);
  try {
    const result = await runner.run(request(catalogue, wanted));
    showRun({...result, label: "this run", experiment: wanted});
  } catch (error) {
    say(error.message, true);
  }
  busy(wanted !== experiment);
});

function busy(is) {
  document.documentElement.dataset.busy = String(is);
  element("plots").setAttribute("aria-busy", String(is));
}

function change(next) {
  experiment = next;
  controls.show(experiment, IN_HEADER);
  showHeader(experiment);
  try { history.replaceState(null, "", hashOf(catalogue, experiment)); } catch { /* too many calls for the browser: the next change writes it */ }
  simulate(experiment);
}

// Choose another part; not all combinations exist.
function choose(key, choice) {
  const before = structureOf(catalogue, experiment).settings, next = withSetting(catalogue, experiment, key, choice);
  const structure = structureOf(catalogue, next);
  const others = Object.keys(before).filter((other) => other !== key && structure.settings[other] !== before[other]);
  change(next);
  if (structure.settings[key] !== choice) say("The lab offers this machine with the paper’s law only; dualwinch simulate runs it with any.");
  else if (others.length) say(`The lab offers this choice only with ${structure.label}.`);
}

function showRun(result) {
  const firstRun = run === null;
  run = withLargest(result);
  playback.setWhole(run.t.length ? run.t.at(-1) : 1);
  if (firstRun && !ownRun?.live) playback.seek(0.46 * playback.whole[1]);
  refresh();
  questions.check(run, run.experiment);
  element("timing").textContent = `${digits(run.t.length, 3)} samples in ${digits(run.seconds * 1e3, 2)} ms.`;
  document.documentElement.dataset.ready = String(Number(document.documentElement.dataset.ready ?? 0) + 1);
}

function withLargest(result) {
  const largest = (name) => (result.columns[name] ?? []).reduce((high, value) => Math.max(high, Math.abs(value) || 0), 0);
  return {...result, columns: {...result.columns, ...estimates(result)}, simulated: result.columns, largestError: largest("e"),
    largestDisturbance: largest("d_true"), largestSag: Math.max(largest("sag_1"), largest("sag_2"))};
}

// Columns of the disturbance that the controller compensates: in all, and the law's own part if a filter's is added to it.
// Of a run from a file the filter's share is unknown.
function estimates({columns: {d_hat: own, d_est: filtered}, experiment: of, compensation}) {
  if (!filtered) return own ? {d_total: own} : {};
  const share = compensation ?? (of && valueOf(catalogue, of, COMPENSATION));
  if (!Number.isFinite(share)) return own ? {d_law: own} : {};
  if (share === 0) return own ? {d_total: own} : {};
  return {d_total: filtered.map((value, row) => share * value + (own?.[row] ?? 0)), ...(own && {d_law: own})};
}

function refresh() {
  plots.show(run, pinned, plant());
  const ended = {completed: "", diverged: `The run diverged at ${digits(run.until)} s.`, left_track: `The vehicle left the rail at ${digits(run.until)} s.`}[run.outcome] ?? "";
  element("outcome").textContent = ended;
  element("glance").innerHTML = glance();
  element("claims").innerHTML = claims(catalogue, experiment, run);
  element("idealised").textContent = idealised(structureOf(catalogue, run.experiment), run.checks,
    valueOf(catalogue, run.experiment, "controller.coordination.tension_min"));
  showSignals();
  showMerits(element("merits"), catalogue, run, pinned, paperMetrics());
  showMoment();
}

function showMoment() {
  if (!run) return;
  machine.draw(run, Math.min(playback.time, run.t.at(-1)), plant(), pinned);
  plots.showMoment();
  transport.show(run.columns.x ? `${digits(playback.time, 4)} s` : "");
}

// Figures of merit of the law with the paper's gains, or of the paper's own law if the paper does not have this one.
function paperMetrics() {
  const known = catalogue.paper[experiment.case] ?? {}, law = structureOf(catalogue, experiment).settings["controller.kind"];
  return known[law] ?? known["fando-nftsm"] ?? null;
}

// The run in one line, for small screens on which the plots are not visible beside the controls.
function glance() {
  const {mae, max_abs_error: largest, peak_tension: peak, slack_share: slack} = run.metrics;
  if (!Number.isFinite(mae)) return run.outcome;
  return [`mean |e| ${digits(mae * 1e3, 3)} mm`, `largest ${digits(largest * 1e3, 3)} mm`, `peak ${digits(peak)} N`, slack > 0 ? `slack ${digits(100 * slack, 2)} %` : "no slack"].map((text) => `<span>${text}</span>`).join(" ");
}

// Lengths and limits of the machine, for drawing.
function plant() {
  const of = (key, otherwise) => (catalogue.keys[key] && valueOf(catalogue, experiment, key)) ?? otherwise;
  const limits = ["tension_min", "tension_max"].map((name) => of(`controller.coordination.${name}`, NaN));
  const radius = of("plant.winch_1.drum_radius", 0.8), gear = of("plant.winch_1.gear_ratio", 36);
  return {length: of("plant.track.length", 50), spacing: of("plant.track.roller_spacing", 0), offset: of("plant.track.rope_offset", 0.5), radius, diameter: of("plant.vehicle.diameter", 2),
    height: of("plant.vehicle.height", 3), tensionMin: limits[0], tensionMax: limits[1], torqueLimits: limits.map((limit) => limit * radius / gear)};
}

// Options of the plot for any other column.
function showSignals() {
  const {id, columns} = structureOf(catalogue, experiment), select = element("signal"), chosen = select.value;
  if (select.dataset.structure === id) return;
  select.dataset.structure = id;
  select.replaceChildren(new Option("none", ""), ...columns.filter(({name}) => name !== "t").map(({name, label}) => new Option(`${name}: ${label}`, name)));
  select.value = columns.some(({name}) => name === chosen) ? chosen : "";
}

element("signal").addEventListener("change", ({target}) => plots.choose(structureOf(catalogue, experiment).columns.find(({name}) => name === target.value)));

// ---- pin, share, open ----

function pin(other = run) {
  pinned = other ? withLargest({...other}) : null;
  const button = element("pin");
  button.setAttribute("aria-pressed", String(Boolean(pinned)));
  button.textContent = pinned ? "Unpin A" : "Pin as A";
  button.title = pinned ? `A: ${pinned.label}` : "Keep this run as A, to compare later runs with it";
  if (run) refresh();
}

function unpin() {
  if (pinned) pin(null);
}

element("pin").addEventListener("click", () => (pinned ? unpin() : pin()));

connectMenu({
  link: () => copied(location.href, "link"),
  command: () => copied(commandLine(catalogue, experiment), "command line"),
  toml: () => download("experiment.toml", tomlOf(catalogue, experiment)),
  csv: () => download("run.csv", csvOf({...run, columns: run.simulated})),
}, openAs);

async function copied(text, name) {
  try {
    await navigator.clipboard.writeText(text);
    say(`Copied the ${name}.`);
  } catch {
    window.prompt(`Copy the ${name}:`, text);
  }
}

async function openAs(file) {
  try {
    const opened = await openFile(catalogue, file);
    if (opened.run) pin(opened.run);
    else change(opened.experiment);
    if (!opened.run) notice.show(`This is not the machine of ${file.name}.`, opened.unsupported, waysToRun(file.name));
    if (!opened.unsupported?.length) say(opened.run ? `${file.name} is now A.` : `${file.name} is open.`);
  } catch (error) {
    say(error.message, true);
  }
}

function ofLink() {
  const linked = fromHash(catalogue, location.hash);
  notice.show("This is not the experiment of the link.", linked.unsupported);
  return linked.experiment;
}

let silence = null;
function say(text, wrong = false) {
  element("status").textContent = text;
  element("status").classList.toggle("wrong", wrong);
  clearTimeout(silence);
  if (!wrong) silence = setTimeout(() => { element("status").textContent = ""; }, 4000);
}

// ---- keys, theme, start ----

element("find").addEventListener("input", ({target}) => controls.filter(target.value));
element("reset").addEventListener("click", () => { notice.clear(); change(blank(catalogue, experiment.case)); });
window.addEventListener("hashchange", () => change(ofLink()));
window.addEventListener("keydown", (event) => {
  if (event.key !== " " || event.target.closest("input, select, button, summary, textarea, label")) return;
  event.preventDefault();
  playback.toggle();
});
new ResizeObserver(showMoment).observe(element("machine"));
new ResizeObserver(([{target}]) => document.documentElement.style.setProperty("--top", `${target.offsetHeight}px`)).observe(document.querySelector(".top"));

const transport = connectTransport(playback, () => (caseOf(catalogue, experiment).steady ?? [0.36 * playback.whole[1], 0.58 * playback.whole[1]]));
connectTheme(element("theme"), () => { plots.redraw(); showMoment(); });
if (ownRun) {
  if (ownRun.live) follow(ownRun, columnsOf, showLive, say);
  else pin(ofOwn(finished(ownRun.label, columnsOf(ownRun), ownRun.metrics)));
  if (location.hash.length < 2 && ownRun.settings) {
    const opened = fromFile(catalogue, ownRun.settings);
    experiment = opened.experiment;
    notice.show("The run beside A is not of A’s machine.", opened.unsupported);
  }
}
change(experiment);

// A live run is A; the time shown follows its end until the user moves it.
let followed = null;
function showLive(live) {
  pin(ofOwn(live));
  if (followed !== null && playback.time !== followed) return;
  playback.seek(live.t.at(-1));
  followed = playback.time;
}

// The page's own run with the filter's share of its own settings.
function ofOwn(result) {
  return {...result, compensation: ownRun.settings?.[COMPENSATION]};
}

function columnsOf({columns}) {
  return Object.fromEntries(Object.entries(columns).map(([name, values]) => [name, Array.isArray(values) ? Float64Array.from(values, (value) => value ?? NaN)
    : new Float64Array(Uint8Array.from(atob(values), (letter) => letter.charCodeAt(0)).buffer)]));
}
