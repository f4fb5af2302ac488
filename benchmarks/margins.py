"""What stability margins as default constraints take of a search, and how its rate compares with the batch kernel's.

``uv run --group benchmarks python -m benchmarks.margins`` searches in each ensemble with its default constraints and
prints a table; ``--write FILE`` puts it between the file's two marks. Each search runs once as compiled for this
processor and once as compiled for one that has AVX2 and no more (``haswell``), in a process of its own. Times are those
of the processor, so that they hardly depend on what else the machine does. The kernel's rate is that of the search's
own rollouts.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.document import markdown, put
from dualwinch.analysis.margin_survey import MarginSurvey
from dualwinch.tuning.optimisers import optimiser
from dualwinch.tuning.options import default_method
from dualwinch.tuning.scoring import scorer
from dualwinch.tuning.scoring.evaluation import Evaluator
from dualwinch.tuning.scoring.training_set import prepare
from dualwinch.tuning.storage.store import MemoryStorage
from dualwinch.tuning.study import Search, SearchBudget
from dualwinch.tuning.tuning_problem import tuning_problem

CANDIDATES, SEED = 8, 1
SPREAD = 0.08
"""Standard deviation of candidates about the start, in shares of each range."""


@contextmanager
def timed(place: Any, name: str) -> Iterator[Callable[[], float]]:
    """Processor time in s that a function takes within the context."""
    spent, function = [0.0], getattr(place, name)

    def measured(*arguments: Any, **options: Any) -> Any:
        began = time.process_time()
        try:
            return function(*arguments, **options)
        finally:
            spent[0] += time.process_time() - began

    setattr(place, name, measured)
    try:
        yield lambda: spent[0]
    finally:
        setattr(place, name, function)


def row(name: str, rollouts: int) -> list[str]:
    """An ensemble: its rates, and what margins take of the search and of a candidate."""
    problem = tuning_problem(ensemble=name, seed=SEED)
    training, method = prepare(problem), default_method(1)
    evaluator, proposer = Evaluator(training), optimiser(method, training, SEED)
    with (
        timed(scorer, "run_pairs") as of_rollouts,
        timed(MarginSurvey, "_least") as of_margins,
    ):
        began = time.process_time()
        Search(method, proposer, MemoryStorage(), evaluator).run(SearchBudget(rollouts=rollouts))
        whole = time.process_time() - began
        kernel = evaluator.rollouts / of_rollouts()
        share = of_rollouts() / whole
        margins = of_margins() / whole
    words = [f"{kernel:.0f}", f"{kernel * share:.0f}", f"{100 * share:.0f} %", f"{100 * margins:.0f} %"]
    return [
        str(evaluator.rollouts),
        *words,
        *(f"{1e3 * each:.1f} ms" for each in of_a_candidate(evaluator)),
    ]


def of_a_candidate(evaluator: Evaluator) -> tuple[float, float]:
    """Processor time in s that the margins of a candidate take: in the active loops, and in all."""
    problem, surveyed = evaluator.problem, evaluator.cutting.survey
    if surveyed is None:
        return 0.0, 0.0
    start, random = problem.space.encoded(problem.start), np.random.default_rng(SEED)
    shares = np.clip(start + SPREAD * random.normal(size=(CANDIDATES, len(start))), 0, 1)
    values = [problem.space.parameters(problem.space.decoded(each)) for each in shares]
    spent = []
    for loops in (evaluator.cutting.active, None):
        began = time.process_time()
        surveyed.worst(values, [statistic.margin for statistic in problem.margins], loops)
        spent.append((time.process_time() - began) / CANDIDATES)
    return spent[0], spent[1]


def rows_of(march: str, names: Sequence[str], rollouts: int) -> list[list[str]]:
    """Rows of a build for a processor, from a process of its own."""
    command = [
        sys.executable,
        "-m",
        "benchmarks.margins",
        "--child",
        "--ensembles",
        *names,
        "--rollouts",
        str(rollouts),
    ]
    environment = os.environ | {"DUALWINCH_CC": f"gcc -march={march}"}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def table(marches: Sequence[str], names: Sequence[str], rollouts: int) -> str:
    """A row for each ensemble and processor."""
    headings = [
        "ensemble",
        "compiled for",
        "rollouts",
        "kernel (1/s)",
        "search (1/s)",
        "of the kernel's",
        "margins",
        "active loops",
        "all loops",
    ]
    builds = [rows_of(march, names, rollouts) for march in marches]
    rows = [
        [f"`{name}`", march, *found[index]]
        for index, name in enumerate(names)
        for march, found in zip(marches, builds, strict=True)
    ]
    return (
        f"{markdown(headings, rows)}\n\n"
        "*Rollouts a second of the processor, one core; share of the search's time for margins; margins of a candidate "
        "in the active loops and in all.*"
    )


def main() -> None:
    """Search, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ensembles", nargs="+", default=["sea", "rig", "site"], metavar="NAME")
    parser.add_argument("--rollouts", type=int, default=6000, metavar="N")
    parser.add_argument("--march", nargs="+", default=["native", "haswell"], metavar="NAME", help="as gcc names them")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.child:
        print(json.dumps([row(name, chosen.rollouts) for name in chosen.ensembles]))
        return
    text = table(chosen.march, chosen.ensembles, chosen.rollouts)
    print(text)
    if chosen.write:
        put(chosen.write, "margins", text)


if __name__ == "__main__":
    main()
