"""How long ``tune`` prepares a search of which nothing is compiled yet.

``uv run python -m benchmarks.compile`` builds what a search calls, each ensemble in a process of its own with an empty
cache, and prints a table; ``--write FILE`` puts it between the file's two marks. Another machine is ``--machine CONFIG
ENSEMBLE``, two files. Times are those of the processor, so that they hardly depend on what else the machine does: of
this process, which builds expressions and writes C, and of the compilers. On two cores the searched loop is built
beside the rest.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.document import markdown, put
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.codegen.drivers.batch import compile_batch
from dualwinch.simulation.batch.rollout import ParameterScenarioGrid
from dualwinch.tuning.scoring.training_set import controlled_as, training_scenarios
from dualwinch.tuning.tuning_problem import tuning_problem

ENSEMBLES = ("sea", "rig", "site")
HEADINGS = ("ensemble", "draws", "searched loop", "baseline's loop", "stability margins", "in all", "of it compilers")


def compiler_seconds() -> float:
    """Processor time in s of the compilers that this process has run."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


def row(ensemble: str, config: str | None) -> list[str]:
    """Processor times of the parts of a search's preparation, of all of them, and of the compilers among it."""
    problem, times = tuning_problem(config=config, ensemble=ensemble), list[float]()
    keys, gains = problem.space.keys, problem.space.parameters(problem.start)

    def measured(build: Callable[[], Any]) -> Any:
        before = time.process_time() + compiler_seconds()
        result = build()
        times.append(time.process_time() + compiler_seconds() - before)
        return result

    def loop(keys: Sequence[str], values: Sequence[float], scenarios: Sequence[Any]) -> None:
        compile_batch(ParameterScenarioGrid(keys, [values], scenarios).loop)

    scenarios, hard = measured(partial(training_scenarios, problem))
    measured(partial(loop, keys, gains, [*scenarios, *hard]))
    measured(partial(loop, (), (), controlled_as(problem.paper_experiment, scenarios)))
    measured(MarginSurvey([problem.experiment], amplitudes=problem.margin_amplitudes).compile)
    return [f"{seconds:.1f} s" for seconds in (*times, sum(times), compiler_seconds())]


def row_in_an_empty_cache(ensemble: str, config: str | None, march: str | None) -> list[str]:
    """`row` from a process of its own."""
    command = [sys.executable, "-m", "benchmarks.compile", "--child", json.dumps([ensemble, config])]
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"DUALWINCH_CACHE_DIR": folder}
        if march:
            environment["DUALWINCH_CC"] = f"gcc -march={march}"
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def main() -> None:
    """Measure, print and optionally write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ensembles", nargs="*", default=list(ENSEMBLES), help="built-in ensembles")
    parser.add_argument("--machine", nargs=2, action="append", default=[], metavar=("CONFIG", "ENSEMBLE"))
    parser.add_argument("--march", help="build for another processor, such as haswell")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document with the marks of the table")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        print(json.dumps(row(*json.loads(options.child))))
        return
    machines = [(f"`{name}`", name, None) for name in options.ensembles]
    machines += [(Path(config).stem, ensemble, config) for config, ensemble in options.machine]
    rows = [[label, *row_in_an_empty_cache(ensemble, config, options.march)] for label, ensemble, config in machines]
    table = markdown(HEADINGS, rows)
    print(table)
    if options.write:
        put(options.write, "cold compile", table)


if __name__ == "__main__":
    main()
