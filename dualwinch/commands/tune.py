"""``dualwinch tune``: search for gains, choose the best, score it in scenarios nobody saw, and write it down."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from dualwinch import __version__
from dualwinch.commands.doctor import versions
from dualwinch.commands.folders import check_folder, make_folder
from dualwinch.commands.tuning_progress import Watch
from dualwinch.commands.tuning_setup import configuration, definition_of
from dualwinch.config.experiment_file import to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.reports.tuning import write_tuning_report
from dualwinch.simulation.batch.cores import cores
from dualwinch.tuning.optimisers import default_method, optimiser
from dualwinch.tuning.problem import Problem
from dualwinch.tuning.result import write_best, write_study
from dualwinch.tuning.scoring.evaluate import Evaluator
from dualwinch.tuning.scoring.evaluation import Evaluation
from dualwinch.tuning.scoring.ranking import pareto_front
from dualwinch.tuning.scoring.selection import Verdict, improvement, improvement_within_reach, judge, rollouts_needed
from dualwinch.tuning.scoring.statistic import statistic_from
from dualwinch.tuning.storage.connection import shown
from dualwinch.tuning.storage.store import Budget, is_database, open_store
from dualwinch.tuning.study import Progress, search

HELD_OUT_SCENARIOS = 200
"""Scenarios that score the result."""

REPORT_SECONDS = 4.0
"""Time in s left for the report where the budget is one of time; of short ones a tenth."""

TRIALS = 1000
"""Trials where no budget is given."""

STORAGE_VARIABLE = "DUALWINCH_STORAGE"
"""Environment variable with the URL of a storage, so that a password need not stand on a command line."""


@dataclass(frozen=True)
class Options:
    """How to search.

    Attributes:
        method: name of the optimiser; ``None``: the default for the number of objectives.
        trials: number of trials; ``None``: no limit.
        seconds: wall time in s, choice, score and report of the best included; ``None``: no limit.
        storage: file or URL; ``None``: ``study.journal`` in `out`.
        study: the study's name.
        workers: processes on this machine.
        resume: whether a study with trials may be gone on with.
        out: folder of the results.
    """

    method: str | None
    trials: int | None
    seconds: float | None
    storage: str | None
    study: str
    workers: int
    resume: bool
    out: Path


def seconds_from(text: str) -> float:
    """A time such as ``60s``, ``5min``, ``2h`` or ``90`` in s.

    Raises:
        ConfigurationError: it is none.
    """
    parts = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|m|h|)\s*", text)
    if not parts or not float(parts[1]):
        raise ConfigurationError(f"--time {text}: must be a time such as 60s, 5min or 2h")
    return float(parts[1]) * {"s": 1, "": 1, "m": 60, "min": 60, "h": 3600}[parts[2]]


def tune(problem: Problem, options: Options) -> None:
    """Search, choose, score, write. What can be wrong with words and files is found before the search.

    Raises:
        KeyboardInterrupt: interrupted; the best so far is written.
    """
    began = time.time()
    method = options.method or default_method(len(problem.objectives))
    trials = TRIALS if options.trials is None and options.seconds is None else options.trials
    seconds = options.seconds
    until = None if seconds is None else began + seconds - min(REPORT_SECONDS, seconds / 10)
    budget = Budget(trials, until)
    _check(options, trials)
    make_folder(options.out)
    storage = options.storage or str(options.out / "study.journal")
    console = Console(stderr=True)
    with ExitStack() as stack:
        store = open_store(
            storage, options.study, problem, definition_of(problem, method), budget, resume=options.resume
        )
        stack.callback(store.close)
        known = store.count()
        proposer = optimiser(method, problem, problem.seed + known)
        evaluator = Evaluator(problem, threads=max(1, cores() // options.workers))
        _announce(console, problem, method, storage, known)
        stack.callback(_end, [_worker(storage, options.study) for _ in range(options.workers - 1)])
        reserve = rollouts_needed(problem, HELD_OUT_SCENARIOS)
        interrupted = False
        with Watch(console, problem, budget) as watch:
            try:
                search(problem, method, proposer, store, evaluator, watch.show, reserve=reserve)
            except KeyboardInterrupt:
                interrupted = True
            progress = watch.progress
        if interrupted:
            console.print("interrupted; choosing and scoring the best so far (Ctrl-C again: leave it)")
        store.set_budget(Budget(store.count(), began))
        finished = store.finished()
        if not finished:
            raise KeyboardInterrupt
        with console.status("choosing and scoring the best"):
            verdict = judge(problem, finished, evaluator, HELD_OUT_SCENARIOS)
        cost = _cost(progress, evaluator, len(finished), time.time() - began)
    report(problem, finished, verdict, cost)
    write(problem, finished, verdict, method, storage, options, cost)
    console.print(f"wrote best.toml, study.json and report.html in {options.out}", soft_wrap=True)
    if interrupted:
        raise KeyboardInterrupt


def write(
    problem: Problem,
    finished: Sequence[Evaluation],
    verdict: Verdict,
    method: str,
    storage: str,
    options: Options,
    cost: dict[str, float],
) -> None:
    """Write ``best.toml``, ``study.json`` and ``report.html``."""
    facts: dict[str, Any] = {
        "code version": f"dualwinch {__version__}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seed": problem.seed,
        "ensemble": problem.ensemble.name if problem.ensemble else "none",
        "study": options.study,
        "storage": shown(storage) if is_database(storage) else storage,
        "method": method,
    }
    check_folder(options.out)
    best = to_toml(problem.tuned(verdict.best.point))
    write_best(options.out / "best.toml", problem, verdict, best, facts)
    named = {name.replace(" ", "_"): value for name, value in facts.items()} | {"versions": versions()}
    write_study(options.out / "study.json", problem, finished, verdict, named, configuration(problem), cost)
    shown_cost = {name.replace("_", " "): f"{value:.6g}" for name, value in cost.items()}
    with Console(stderr=True).status("drawing the report"):
        write_tuning_report(
            options.out / "report.html", problem, finished, verdict, {**facts, **versions(), **shown_cost}, best
        )


def report(problem: Problem, finished: Sequence[Evaluation], verdict: Verdict, cost: dict[str, float]) -> None:
    """Print what was found."""
    console = Console()
    scored = verdict.held_out or verdict.best
    where = f"{scored.scenarios} held-out scenarios" if verdict.held_out else "the tuned experiment"
    console.print(f"[bold]trial {verdict.best.number}[/bold] of {len(finished)}, in {where}:")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    for heading in ("best", "paper's gains", "ratio"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("")
    for name, value in scored.statistics.items():
        theirs, unit = verdict.paper[name], statistic_from(name).unit.replace("^2", "²")
        ratio = f"{value / theirs:.3g}" if theirs else ""
        table.add_row(name, f"{value:.4g}", f"{theirs:.4g}", ratio, "" if unit == "1" else unit)
    console.print(table)
    for one in problem.bounded:
        kept = scored.violations[one.label] <= 0
        console.print(f"{'kept    ' if kept else '[red]violated[/red]'}  {one.label}", highlight=False, soft_wrap=True)
    ended = ", ".join(f"{count} {outcome}" for outcome, count in scored.outcomes.items())
    times = improvement(verdict, problem.minimised[0].name)
    console.print(
        f"outcomes: {ended}; {problem.minimised[0].name} is {times:.4g} times below the paper's", soft_wrap=True
    )
    if out_of_reach := int((~verdict.within_reach).sum()):
        within = improvement_within_reach(verdict)
        console.print(
            f"out of reach, as they take more force than the motors can give: {out_of_reach} of the scenarios; in the "
            f"others the mean MSE is {within:.4g} times below the paper's",
            soft_wrap=True,
        )
    if len(problem.objectives) > 1:
        console.print(f"Pareto front: {len(pareto_front(finished))} trials, in study.json")
    console.print(
        f"{cost['rollouts']:.0f} rollouts in {cost['seconds']:.1f} s, {cost['rollouts_per_second']:.0f} a second; "
        f"{100 * cost['overhead']:.0f} % of the search was not spent in rollouts",
        soft_wrap=True,
    )


def _check(options: Options, trials: int | None) -> None:
    if trials is not None and trials < 1:
        raise ConfigurationError(f"--trials {trials}: must be a whole number >= 1")
    if options.workers < 1:
        raise ConfigurationError(f"--workers {options.workers}: must be a whole number >= 1")
    if options.workers > 1 and not (options.storage and is_database(options.storage)):
        raise ConfigurationError("--workers: needs a database, --storage postgresql+psycopg://USER@HOST/DATABASE")


def _announce(console: Console, problem: Problem, method: str, storage: str, known: int) -> None:
    controller = problem.experiment.controller
    where = f"{problem.scenarios} scenarios of '{problem.ensemble.name}'" if problem.ensemble else "one experiment"
    console.print(
        f"tuning {len(problem.space.dimensions)} gains of {controller.law.kind} "
        f"(estimator {controller.estimator.kind}) by {method} in {where}, seed {problem.seed}",
        highlight=False,
        soft_wrap=True,
    )
    constraints = "; ".join(one.label for one in problem.bounded) or "nothing"
    console.print(f"minimise {', '.join(problem.objectives)} subject to {constraints}", highlight=False, soft_wrap=True)
    kept = shown(storage) if is_database(storage) else storage
    console.print(f"kept in {kept}" + (f", which has {known} trials" if known else ""), highlight=False, soft_wrap=True)


def _worker(storage: str, study: str) -> "subprocess.Popen[bytes]":
    words = [sys.executable, "-m", "dualwinch", "worker", "--study", study]
    environment = os.environ | {STORAGE_VARIABLE: storage}
    return subprocess.Popen(words, env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)


def _end(workers: Sequence["subprocess.Popen[bytes]"]) -> None:
    for one in workers:
        try:
            one.wait(timeout=10)
        except subprocess.TimeoutExpired:
            one.terminate()


def _cost(progress: Progress, evaluator: Evaluator, trials: int, seconds: float) -> dict[str, float]:
    return {
        "trials": trials,
        "rollouts": evaluator.rollouts,
        "seconds": seconds,
        "rollout_seconds": evaluator.seconds,
        "rollouts_per_second": evaluator.rollouts / evaluator.seconds if evaluator.seconds else 0.0,
        "search_seconds": progress.seconds,
        "overhead": progress.overhead,
    }
