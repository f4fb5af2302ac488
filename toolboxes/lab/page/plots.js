// Linked plots of a run, with one cursor and one time range, and a pinned run in the background.

import {moment} from "./moment.js";
import {digits, steady, unitText} from "./numbers.js";
import {colour} from "./theme.js";

// Content of each plot: columns, and constant lines from the plant and its limits.
const PANELS = [
  {title: "Position error", unit: "m", curves: [["e", "e", "blue"]], limits: () => []},
  {title: "Rope tensions", unit: "N", limits: (plant) => [plant.tensionMin, plant.tensionMax],
    curves: [["F1", "F₁", "rope1"], ["F1_cmd", "command", "rope1", "dash"], ["F2", "F₂", "rope2"], ["F2_cmd", "command", "rope2", "dash"]]},
  {title: "Motor torques", unit: "N m", limits: (plant) => plant.torqueLimits,
    curves: [["tau_1", "τ₁", "rope1"], ["tau_2", "τ₂", "rope2"]]},
  {title: "Disturbance, true and estimated", unit: "m/s^2", limits: () => [],
    curves: [["d_true", "true", "ink"], ["d_total", "estimated", "vermilion"], ["d_law", "by the law alone", "vermilion", "dash"]]},
  {title: "", unit: "1", limits: () => [], curves: []},
];

export class Plots {
  // playback: time and time range shown.
  constructor(holder, playback) {
    this.holder = holder;
    this.playback = playback;
    this.panels = PANELS.map((panel) => this.#panel(panel));
    new ResizeObserver(() => this.resize()).observe(holder);
  }

  #panel(panel) {
    const element = document.createElement("section");
    element.className = "panel";
    element.innerHTML = `<header><h3>${panel.title}</h3><dl></dl></header><div class="plot" tabindex="0" role="img"></div>`;
    this.holder.append(element);
    const frame = element.querySelector(".plot");
    frame.setAttribute("aria-label", `${panel.title} over time. Arrow keys move the time, plus and minus zoom, 0 shows all.`);
    frame.addEventListener("keydown", (event) => this.#key(event));
    return {...panel, element, frame, legend: element.querySelector("dl"), plot: null, shape: "", play: null};
  }

  // Show a column in the last plot; undefined hides that plot.
  choose(column) {
    const panel = this.panels.at(-1);
    panel.curves = column ? [[column.name, column.name, "green"]] : [];
    panel.unit = column?.unit ?? "1";
    panel.element.querySelector("h3").textContent = column ? sentence(column.label) : "";
    panel.element.hidden = !column;
    this.show(this.run, this.pinned, this.plant);
  }

  // plant: as in Machine.draw, with tensionMin and torqueLimits; pinned: another run or null.
  show(run, pinned, plant) {
    Object.assign(this, {run, pinned, plant});
    const times = pinned && pinned.t.length > run.t.length ? pinned.t : run.t;
    for (const panel of this.panels) {
      const curves = panel.curves.filter(([name]) => run.columns[name] || pinned?.columns[name]);
      panel.factor = panel.unit === "m" && Math.max(run.largestError, pinned?.largestError ?? 0) < 0.5 ? 1e3 : 1;
      panel.shownUnit = panel.factor === 1e3 ? "mm" : unitText(panel.unit);
      panel.drawn = [
        ...(pinned ? curves.filter(([, , , dash]) => !dash).map((curve) => ({curve, of: pinned, behind: true})) : []),
        ...curves.map((curve) => ({curve, of: run, behind: false})),
      ].filter(({curve, of}) => of.columns[curve[0]]);
      const data = [times, ...panel.drawn.map(({curve, of}) => aligned(of.columns[curve[0]], of.t, times, panel.factor))];
      panel.element.hidden = panel.drawn.length === 0;
      if (panel.element.hidden) continue;
      const shape = panel.drawn.map(({curve, behind}) => curve[0] + behind).join() + panel.shownUnit;
      if (shape !== panel.shape) this.#create(panel, data);
      else this.#refill(panel, data);
      this.#legend(panel);
      panel.shape = shape;
    }
    this.showMoment();
  }

  #refill(panel, data) {
    this.quiet = true;
    panel.plot.setData(data, false);
    this.#range(panel);
    this.quiet = false;
  }

  #range(panel) {
    const [min, max] = this.playback.window;
    panel.plot.setScale("x", {min, max});
    panel.plot.redraw(true, true);
  }

  #create(panel, data) {
    panel.plot?.destroy();
    const axis = (more) => ({stroke: () => colour("ink-soft"), grid: {stroke: () => colour("line"), width: 1}, ticks: {show: false},
      font: '11px "Source Sans 3", "Segoe UI", system-ui, sans-serif', ...more});
    const options = {
      ...this.#size(panel), legend: {show: false}, padding: [6, 22, 0, 0], pxAlign: true,
      cursor: {sync: {key: "lab", setSeries: false}, drag: {x: true, y: false, setScale: true}, y: false, focus: {prox: -1},
        points: {size: 6}, bind: {dblclick: () => () => { this.playback.setWindow(...this.playback.whole); return null; }}},
      scales: {x: {time: false}, y: {range: (_, low, high) => padded(low, high)}},
      axes: [axis({size: 22, gap: 3, values: (plot, ticks) => ticks.map((tick) => (tick === ticks.at(-1) ? `${digits(tick, 5)} s` : digits(tick, 5)))}), axis({size: 54, gap: 4, space: 24, values: (_, ticks) => ticks.map((tick) => digits(tick, 3))})],
      series: [{}, ...panel.drawn.map(({curve, behind}) => ({
        stroke: () => behind ? colour("pinned") : colour(curve[2]), points: {show: false},
        width: behind || curve[3] ? 1.1 : 1.5, dash: behind ? [4, 3] : curve[3] ? [6, 4] : undefined}))],
      hooks: {
        drawAxes: [(plot) => this.#limits(plot, panel)],
        setScale: [(plot, key) => { if (key === "x" && !this.quiet) this.#zoomed(plot); }],
        setCursor: [(plot) => { if (plot.cursor.event) this.#hover(plot); }],
      },
    };
    this.quiet = true;
    panel.plot = new uPlot(options, data, panel.frame);
    this.#overlay(panel.plot, panel);
    this.#range(panel);
    this.quiet = false;
  }

  // An entry for each curve, which includes the pinned run's value.
  #legend(panel) {
    const front = panel.drawn.filter(({behind}) => !behind);
    panel.legend.replaceChildren(...(front.length ? front : panel.drawn).map(({curve: [name, label, tint, dash]}) => {
      const entry = document.createElement("div");
      entry.innerHTML = `<dt><i class="swatch ${dash ? "dashed" : ""}" style="--tint: var(--${tint})"></i>${label}</dt>`;
      for (const drawn of panel.drawn.filter(({curve}) => curve[0] === name).reverse()) {
        drawn.shown = entry.appendChild(document.createElement("dd"));
        drawn.shown.className = drawn.behind ? "behind" : "";
      }
      return entry;
    }));
  }

  #overlay(plot, panel) {
    panel.play = document.createElement("div");
    panel.play.className = "playhead";
    plot.over.append(panel.play);
    plot.over.addEventListener("click", (event) => {
      this.playback.seek(plot.posToVal(event.clientX - plot.over.getBoundingClientRect().left, "x"));
    });
    plot.over.addEventListener("mouseleave", () => { this.hovered = null; this.showMoment(); });
  }

  #limits(plot, panel) {
    const {ctx, bbox} = plot, {min, max} = plot.scales.y;
    ctx.save();
    ctx.strokeStyle = colour("ink-soft");
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
    for (const limit of [...panel.limits(this.plant), 0].filter((level) => level > min && level < max)) {
      const y = Math.round(plot.valToPos(limit, "y", true));
      if (limit === 0) ctx.setLineDash([]);
      ctx.beginPath();
      ctx.moveTo(bbox.left, y);
      ctx.lineTo(bbox.left + bbox.width, y);
      ctx.stroke();
    }
    ctx.restore();
  }

  #zoomed(plot) {
    const {min, max} = plot.scales.x;
    if (this.quiet || min == null || (min === this.playback.window[0] && max === this.playback.window[1])) return;
    queueMicrotask(() => this.playback.setWindow(min, max));
  }

  #hover(plot) {
    this.hovered = plot.cursor.idx == null ? null : plot.data[0][plot.cursor.idx];
    this.#values();
  }

  // Update after a change of the time or the time range.
  showMoment() {
    for (const panel of this.panels) {
      if (!panel.plot || panel.element.hidden) continue;
      const {min, max} = panel.plot.scales.x, [low, high] = this.playback.window;
      if (min !== low || max !== high) {
        this.quiet = true;
        panel.plot.setScale("x", {min: low, max: high});
        this.quiet = false;
      }
      panel.play.style.left = `${100 * (this.playback.time - low) / (high - low)}%`;
    }
    this.#values();
  }

  #values() {
    const time = this.hovered ?? this.playback.time;
    for (const panel of this.panels) {
      if (!panel.plot || panel.element.hidden) continue;
      const {min, max} = panel.plot.scales.y;
      panel.drawn.forEach(({curve, of, behind, shown}) => {
        if (!shown) return;
        const value = steady(moment(of, time)(curve[0]) * panel.factor, Math.max(Math.abs(min), Math.abs(max)));
        shown.textContent = behind ? `A ${value}` : `${value} ${panel.shownUnit}`;
      });
    }
  }

  #key(event) {
    const {window: [low, high], whole, time} = this.playback, step = (high - low) / 100;
    const zoom = (factor) => this.playback.setWindow(Math.max(time - (time - low) * factor, whole[0]), Math.min(time + (high - time) * factor, whole[1]));
    const actions = {
      ArrowLeft: () => this.playback.seek(time - step), ArrowRight: () => this.playback.seek(time + step),
      Home: () => this.playback.seek(low), End: () => this.playback.seek(high),
      "+": () => zoom(0.5), "=": () => zoom(0.5), "-": () => zoom(2), 0: () => this.playback.setWindow(...whole),
    };
    if (!actions[event.key] || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    actions[event.key]();
  }

  #size(panel) {
    return {width: Math.max(this.holder.clientWidth, 200), height: panel.frame.clientHeight || 150};
  }

  resize() {
    for (const panel of this.panels) if (!panel.element.hidden) panel.plot?.setSize(this.#size(panel));
    if (this.run) this.showMoment();
  }

  redraw() {
    for (const panel of this.panels) panel.plot?.redraw(true, true);
  }
}

function sentence(text) {
  return text[0].toUpperCase() + text.slice(1);
}

// A column resampled at the times of another run; null where it has no value.
function aligned(column, t, times, factor) {
  const values = new Array(times.length).fill(null);
  const rows = Math.min(column.length, times.length);
  const same = t.length < 2 || times.length < 2 || Math.abs((t[1] - t[0]) / (times[1] - times[0]) - 1) < 1e-9;
  if (same) {
    for (let row = 0; row < rows; row++) values[row] = Number.isFinite(column[row]) ? column[row] * factor : null;
    return values;
  }
  const step = (t.at(-1) - t[0]) / (t.length - 1);
  for (let row = 0; row < times.length; row++) {
    const nearest = Math.round((times[row] - t[0]) / step);
    if (nearest >= 0 && nearest < column.length && Number.isFinite(column[nearest])) values[row] = column[nearest] * factor;
  }
  return values;
}

function padded(low, high) {
  if (low == null || high == null) return [0, 1];
  if (low === high) return [low - Math.max(Math.abs(low), 1e-3), high + Math.max(Math.abs(high), 1e-3)];
  const margin = 0.07 * (high - low);
  return [low - margin, high + margin];
}
