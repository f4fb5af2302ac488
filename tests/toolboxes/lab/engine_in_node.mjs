// Runs the engine on requests from standard input; writes a line of JSON for each, columns in base64 as they are.
import {readFileSync, writeSync} from "node:fs";

const [engine, content] = process.argv.slice(2);
const {Engine} = await import(`data:text/javascript;base64,${readFileSync(engine).toString("base64")}`);
const {catalogue, modules} = JSON.parse(readFileSync(content, "utf8"));
const runner = await Engine.load(catalogue, modules);
const answer = (content) => writeSync(1, `${JSON.stringify(content)}\n`);
for (const {keep, repeat = 1, ...request} of JSON.parse(readFileSync(0, "utf8"))) {
  try {
    let result;
    let seconds = Infinity;
    for (let count = 0; count < repeat; ++count) {
      result = await runner.run(request);
      seconds = Math.min(seconds, result.seconds);
    }
    const {outcome, until, metrics, columns} = result;
    const kept = keep ?? Object.keys(columns);
    const bytes = (name) => Buffer.from(columns[name].buffer).toString("base64");
    const told = Object.entries(metrics).map(([name, value]) => [name, Number.isNaN(value) ? null : value]);
    answer({
      outcome, until, seconds,
      metrics: Object.fromEntries(told),
      columns: Object.fromEntries(kept.map((name) => [name, bytes(name)])),
    });
  } catch (error) {
    answer({error: error.message});
  }
}
