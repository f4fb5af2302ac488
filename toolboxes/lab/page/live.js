// A run in progress in another process, from which new rows are requested at intervals.

import {finished} from "./open.js";

const INTERVAL = 500; // ms

// own: label, and address that answers with {run, columns, status}; decoded(answer): its columns as numbers.
export async function follow(own, decoded, show, say) {
  let run = null, columns = {};
  for (;;) {
    let answer;
    try {
      answer = await (await fetch(`${own.live}?run=${run ?? 0}&rows=${columns.t?.length ?? 0}`)).json();
    } catch {
      say("The served plant has ended.");
      return;
    }
    if (answer.run !== run) columns = {};
    run = answer.run;
    const further = decoded(answer);
    for (const [name, values] of Object.entries(further)) columns[name] = joined(columns[name], values);
    if (further.t?.length && columns.t.length > 1) show(finished(own.label, {...columns}, {}));
    if (answer.status) say(answer.status, true);
    await new Promise((resolve) => setTimeout(resolve, INTERVAL));
  }
}

function joined(before, after) {
  if (!before) return after;
  const both = new Float64Array(before.length + after.length);
  both.set(before);
  both.set(after, before.length);
  return both;
}
