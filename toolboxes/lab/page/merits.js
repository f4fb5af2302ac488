// Table of figures of merit: this run beside the pinned one, or beside the paper's gains in the same case.

import {change, digits, scaleFor} from "./numbers.js";

export function showMerits(table, catalogue, run, pinned, paper) {
  const columns = [["this run", run.metrics], ...(pinned ? [["A", pinned.metrics]] : []), ...(paper && !pinned ? [["paper’s gains", paper]] : [])];
  const against = columns[1]?.[1];
  const head = `<thead><tr><th scope="col">figure of merit</th>${columns.map(([name]) => `<th scope="col">${name}</th>`).join("")}${against ? `<th scope="col">${pinned ? "from A" : "change"}</th>` : ""}</tr></thead>`;
  const rows = catalogue.metrics.map((metric) => row(metric, columns.map(([, metrics]) => metrics?.[metric.name]), Boolean(against)));
  table.innerHTML = `${head}<tbody>${rows.join("")}</tbody>`;
}

function row(metric, values, compared) {
  const share = metric.unit === "1" && metric.name.endsWith("share");
  const {unit, factor} = share ? {unit: "%", factor: 100} : scaleFor(metric.unit, values.map((value) => value ?? NaN));
  const cells = values.map((value) => `<td>${digits(value == null ? NaN : value * factor, 4)}</td>`);
  const last = compared ? `<td class="change">${change((values[1] ?? NaN) * factor, (values[0] ?? NaN) * factor)}</td>` : "";
  return `<tr><th scope="row" title="${metric.meaning}">${metric.label}<small>${unit}</small></th>${cells.join("")}${last}</tr>`;
}

// The paper's reductions by its observer beside those of this run; only for the paper's controller on its machine.
export function claims(catalogue, experiment, run) {
  const {case: id, without, with: law, change: said} = catalogue.claims, changed = [...Object.keys(experiment.values), ...Object.keys(experiment.settings)];
  if (experiment.case !== id || run.outcome !== "completed" || changed.some((key) => !/^controller\.(observer|nftsm|auxiliary)\./.test(key))) return "";
  const before = catalogue.paper[id][without], labels = Object.fromEntries(catalogue.metrics.map((metric) => [metric.name, metric.label]));
  const words = Object.entries(said).map(([name, share]) => `${labels[name]} ${percent(run.metrics[name] / before[name] - 1)} (${percent(share)})`);
  return `Effect of the observer, compared with ${without} (in brackets the paper’s values for ${law}): ${words.join(", ")}.`;
}

function percent(share) {
  return `${share < 0 ? "−" : "+"}${Math.abs(100 * share).toFixed(1)}\u202f%`;
}
