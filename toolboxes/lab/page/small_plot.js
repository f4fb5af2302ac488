// A small figure in the side column.

import {digits} from "./numbers.js";
import {colour} from "./theme.js";

export function smallPlot(holder, {title, series, bands, xLabel, log = false, values}) {
  const axis = (more) => ({stroke: () => colour("ink-soft"), grid: {stroke: () => colour("line"), width: 1}, ticks: {show: false},
    font: '11px "Source Sans 3", "Segoe UI", system-ui, sans-serif', labelFont: '11px "Source Sans 3", "Segoe UI", system-ui, sans-serif', ...more});
  holder.replaceChildren();
  holder.setAttribute("role", "img");
  holder.setAttribute("aria-label", title);
  return new uPlot({
    width: Math.max(holder.clientWidth, 180), height: 140, legend: {show: false}, padding: [6, 14, 0, 0], cursor: {show: false}, bands,
    scales: {x: {time: false}, y: log ? {distr: 3} : {}},
    axes: [axis({size: 22, gap: 3, values: (_, ticks) => ticks.map((tick) => digits(tick, 3) + (tick === ticks.at(-1) ? xLabel : ""))}),
      axis({size: 46, gap: 4, values: values ?? ((_, ticks) => ticks.map((tick) => (tick === null ? "" : digits(tick, 2))))})],
    series: [{}, ...series.map(({tint, width = 1, dash, points = false, fill}) => ({
      stroke: () => colour(tint), width, dash, fill: fill && (() => colour(fill)), points: {show: points, size: 3, fill: () => colour(tint)}}))],
  }, [[0], ...series.map(() => [null])], holder);
}
