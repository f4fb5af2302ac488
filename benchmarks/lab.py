"""The lab beside the native run: how fast in Node and in Chromium, how exact, how large.

``python -m benchmarks.lab`` prints the tables; ``--write FILE`` puts them between its two marks. Runs take turns,
so that a busy machine is busy for all of them; times are the least of all rounds.
"""

import argparse
import base64
import gzip
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import duration, markdown, put, times
from dualwinch import __version__
from dualwinch.codegen.drivers.rollout import compile_rollout
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.model.plant import Plant
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import absent_signals, closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of, zeros_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.lab.assemble import ENGINE, assemble
from dualwinch.toolboxes.lab.content import Content, content

ROUNDS, REPEATS = 10, 5
LOOP, SIMULATE = "compiled loop", "`simulate`"
"""The native run: the call of the compiled loop alone, and all of it."""

CHROMIUM = shutil.which("chromium")

RUNNING = """
async (requests) => {
  const runner = await Engine.load(CONTENT.catalogue, CONTENT.modules);
  const told = [];
  for (const { repeats, ...request } of requests) {
    let seconds = Infinity, result;
    for (let count = 0; count < repeats; ++count) {
      result = await runner.run(request);
      seconds = Math.min(seconds, result.seconds);
    }
    told.push({ seconds, x: Array.from(result.columns.x ?? []) });
  }
  return told;
}
"""
"""What both run: the least time of each request, and its positions."""

Told = list[dict[str, Any]]
Runner = Callable[[list[dict[str, Any]]], Told]


@dataclass(frozen=True)
class Asked:
    """A run, as both are asked for it."""

    label: str
    request: dict[str, Any]
    experiment: Experiment
    nominal: Plant | None = None

    def native(self) -> tuple[float, np.ndarray]:
        """Time in s of the native run with its rows, and its positions."""
        start = time.perf_counter()
        result = simulate(self.experiment, nominal=self.nominal)
        return time.perf_counter() - start, result["x"]

    @cached_property
    def prepared(self) -> Callable[[], Any]:
        """The compiled call of the native run alone: all that it receives has been drawn."""
        values, structure = parameters_of(self.experiment, self.nominal), structure_of(self.experiment)
        loop = closed_loop(structure, zeros_of(structure, values) | absent_signals(self.experiment))
        parameters, received = loop.vector(values), exogenous_signals(self.experiment)
        start, run = np.array(list(initial_state_of(self.experiment).values())), compile_rollout(loop)
        return lambda: run(parameters, received, start.copy(), 1)

    def loop(self) -> float:
        """Time in s of that call."""
        prepared, start = self.prepared, time.perf_counter()
        prepared()
        return time.perf_counter() - start


def asked(made: Content) -> list[Asked]:
    """The runs: Case 4, and the first machine of the rig."""
    catalogue, rig = made.catalogue, load_ensemble("rig")
    usual, drawn = catalogue["cases"][3], catalogue["rig"]
    machine = {key: numbers[0] for key, numbers in drawn["machines"].items()}
    nominal = {key: catalogue["keys"][key]["default"] for key in machine if key.startswith("plant.")}
    scenario = rig.scenario(0, drawn["seed"])
    request = {"structure": usual["structure"], "values": drawn["values"] | machine, "nominal": nominal}
    return [
        Asked("Case 4", {"structure": usual["structure"], "values": usual["values"]}, case(4)),
        Asked("a machine of `rig`", request | {"seed": drawn["seeds"][0]}, scenario.experiment, scenario.nominal),
    ]


def script(made: Content) -> str:
    """The engine and what it runs, as a script without modules."""
    packed = {name: base64.b64encode(gzip.compress(code)).decode() for name, code in made.modules.items()}
    engine = ENGINE.read_text(encoding="utf-8").replace("export class", "class")
    return f"{engine}\nconst CONTENT = {json.dumps({'catalogue': made.catalogue, 'modules': packed})};\n"


def in_node(text: str, folder: Path) -> Runner:
    """Runs requests in Node."""
    file = folder / "run.mjs"
    file.write_text(
        f'import {{ readFileSync }} from "node:fs";\n{text}const run = {RUNNING.strip()};\n'
        "process.stdout.write(JSON.stringify(await run(JSON.parse(readFileSync(0)))));\n"
    )

    def run(requests: list[dict[str, Any]]) -> Told:
        command = [shutil.which("node") or "node", str(file)]
        return json.loads(
            subprocess.run(command, input=json.dumps(requests), capture_output=True, text=True, check=True).stdout
        )

    return run


def measure(runs: list[Asked], runners: dict[str, Runner]) -> dict[str, list[dict[str, float]]]:
    """Least times in s of each run, by who ran it, and the largest difference in m from the native positions."""
    found = {name: [{"seconds": np.inf, "apart": 0.0} for _ in runs] for name in (LOOP, SIMULATE, *runners)}
    for _ in range(ROUNDS):
        expected = []
        for run, best, alone in zip(runs, found[SIMULATE], found[LOOP], strict=True):
            alone["seconds"] = min(alone["seconds"], *(run.loop() for _ in range(REPEATS + 1)))
            native = [run.native() for _ in range(REPEATS)]
            best["seconds"] = min(best["seconds"], *(seconds for seconds, _ in native))
            expected.append(native[-1][1])
        for name, runner in runners.items():
            told = runner([run.request | {"repeats": REPEATS} for run in runs])
            for answer, best, positions in zip(told, found[name], expected, strict=True):
                best["seconds"] = min(best["seconds"], answer["seconds"])
                best["apart"] = max(best["apart"], float(np.abs(np.array(answer["x"]) - positions).max()))
    return found


def first_plot(page: str, folder: Path, browser: Any) -> tuple[float, str]:
    """Time in s from opening the page to its first run drawn, the least of three; and the browser's version."""
    file = folder / "lab.html"
    file.write_text(page, encoding="utf-8")
    seconds = []
    for _ in range(3):
        tab = browser.new_page()
        tab.goto(file.as_uri(), wait_until="commit")
        tab.wait_for_function("document.documentElement.dataset.ready >= 1", polling=5)
        seconds.append(tab.evaluate("performance.now()") / 1e3)
        tab.close()
    return min(seconds), browser.version


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help="file to put the tables into")
    file = parser.parse_args().write
    made = content(load_ensemble("rig"), __version__)
    page, runs = assemble(made.catalogue, made.modules), asked(made)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        text = tables(made, page, runs, folder)
    print(text)
    if file:
        put(file, "lab", text)


def tables(made: Content, page: str, runs: list[Asked], folder: Path) -> str:
    """Both tables, and a line on the first plot."""
    text = script(made)
    runners: dict[str, Runner] = {"Node": in_node(text, folder)}
    if CHROMIUM is None:
        return _tables(made, page, runs, measure(runs, runners), "")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        tab = browser.new_page()
        tab.add_script_tag(content=text)
        runners["Chromium"] = lambda requests: tab.evaluate(RUNNING, requests)
        found = measure(runs, runners)
        tab.close()
        seconds, version = first_plot(page, folder, browser)
        browser.close()
    return _tables(
        made,
        page,
        runs,
        found,
        f"\n\nFrom opening the file to the first plot: {duration(seconds)} (Chromium {version}).",
    )


def _tables(made: Content, page: str, runs: list[Asked], found: dict[str, list[dict[str, float]]], more: str) -> str:
    ours = list(found)[2:]
    headings = ["50 s at 1 kHz, all columns", *found, *(f"{name} / {LOOP}" for name in ours), "apart"]
    rows = []
    for index, run in enumerate(runs):
        by = {name: answers[index] for name, answers in found.items()}
        ratios = [times(by[name]["seconds"] / by[LOOP]["seconds"]) for name in ours]
        apart = max(answer["apart"] for answer in by.values())
        rows.append([run.label, *(duration(answer["seconds"]) for answer in by.values()), *ratios, f"{apart:.1e} m"])
    code, packed = sum(map(len, made.modules.values())), made.modules[runs[0].request["structure"]]
    sizes = [
        ["one structure's module", f"{len(packed) / 1e3:.0f} kB", f"{len(gzip.compress(packed)) / 1e3:.0f} kB"],
        [f"all {len(made.modules)} modules", f"{code / 1e3:.0f} kB", ""],
        [
            "the page with all of them",
            f"{len(page.encode()) / 1e3:.0f} kB",
            f"{len(gzip.compress(page.encode())) / 1e3:.0f} kB",
        ],
    ]
    return markdown(headings, rows) + more + "\n\n" + markdown(["size", "as it is", "gzipped"], sizes)


if __name__ == "__main__":
    main()
