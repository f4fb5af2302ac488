// The engine in a worker thread: one message in, one run out.

import {Engine} from "../engine/engine.js";
import {extremes, samples} from "./thin.js";
import {unpack} from "./unpack.js";

let engine = null;

self.onmessage = async ({data}) => {
  if (data.catalogue) {
    engine = Engine.load(data.catalogue, unpack(data.modules));
    engine.catch(() => {});
    return;
  }
  try {
    const result = await (await engine).run({...data.request, stride: data.rows === "none" ? 0 : 1});
    const columns = columnsFor(result, data.rows);
    self.postMessage({id: data.id, result: {...result, t: columns.t, columns}}, Object.values(columns).map((column) => column.buffer));
  } catch (error) {
    self.postMessage({id: data.id, error: String(error?.message ?? error)});
  }
};

function columnsFor(result, rows) {
  if (rows === "none") return {};
  const all = {t: result.t, ...result.columns};
  if (rows === "all") return all;
  return {t: samples(all.t, rows.count), ...Object.fromEntries(rows.names.map((name) => [name, extremes(all[name], rows.count)]))};
}
