"""``dualwinch tune``: words into a tuning problem and its budget, a study into files and a few printed lines."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from dualwinch import __version__
from dualwinch.codegen.text import one_line
from dualwinch.commands.doctor import versions
from dualwinch.commands.output import check_folder, made_folder, styled, terminal
from dualwinch.commands.progress import ProgressLine, StatusLine
from dualwinch.commands.stress_run import write_stress
from dualwinch.config.experiment_file import to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.threads import cores
from dualwinch.tuning.optimisers import check_method, default_method
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.record import write_best, write_study
from dualwinch.tuning.result import (
    TuningResult,
    advice,
    authority,
    contenders,
    controller_in_words,
    endings,
    headline,
    margin_places,
    statistics_table,
    worth,
)
from dualwinch.tuning.robustness.stress import check_stress, stress_tuned
from dualwinch.tuning.scoring.ranking import pareto_front
from dualwinch.tuning.storage.connection import shown
from dualwinch.tuning.storage.noted_parts import PartRecord, in_words, part_records
from dualwinch.tuning.storage.opening import check_storage, is_database, kept_definition, open_store
from dualwinch.tuning.storage.recall import recall
from dualwinch.tuning.storage.store import SearchBudget
from dualwinch.tuning.tune import tune as run
from dualwinch.tuning.tuning_problem import configuration, definition_of

REPORT_SECONDS = 2.0
"""Time in s that the files take, report and figures among them."""

PREPARING_SECONDS = 600.0
"""Time in s after which workers give a study up whose first process has not begun to search."""

LONGEST_TIME = 1e7
"""Largest number of a time."""

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
        seconds: wall time of the search in s; ``None``: no limit.
        rollouts: number of rollouts of the search; ``None``: no limit.
        storage: file or URL; ``None``: ``study.journal`` in `out`.
        study: the study's name.
        workers: processes on this machine.
        resume: whether a study with trials may be gone on with.
        out: folder of the results.
        stress: whether it is found out what breaks the best first.
    """

    method: str | None = None
    trials: int | None = None
    seconds: float | None = None
    rollouts: int | None = None
    storage: str | Path | None = None
    study: str = "tuning"
    workers: int = 1
    resume: bool = False
    out: str | Path = "tuning-results"
    stress: bool = False


def seconds_from(text: str, option: str = "--time") -> float:
    """A time such as ``60s``, ``5min``, ``2h`` or ``90`` in s.

    Raises:
        ConfigurationError: it is none.
    """
    parts = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|m|h|)\s*", text)
    if not parts or not 0 < float(parts[1]) <= LONGEST_TIME:
        raise ConfigurationError(f"{option} {text}: must be a time such as 60s, 5min or 2h")
    return float(parts[1]) * {"s": 1, "": 1, "m": 60, "min": 60, "h": 3600}[parts[2]]


def recall_parts(options: Options) -> None:
    """Have the parts registered that the study to go on with was begun with.

    Raises:
        ConfigurationError: a part is not there, or another one than it was.
        DualwinchError: the storage cannot be used.
    """
    if options.resume:
        definition = kept_definition(_storage(options), options.study)
        recall(options.study, (definition or {}).get("parts", []))


def _storage(options: Options) -> str:
    return str(options.storage or Path(options.out) / "study.journal")


def tune(problem: TuningProblem, options: Options, status: StatusLine) -> TuningResult:
    """Search, choose, score, write and print. What can be wrong with words and files is found before the search.

    Raises:
        KeyboardInterrupt: interrupted; the best so far is written.
    """
    method = options.method or default_method(len(problem.objectives))
    budgets = options.trials, options.seconds, options.rollouts
    trials = TRIALS if budgets == (None, None, None) else options.trials
    check_options(options)
    if options.stress:
        check_stress(problem)
    check_method(method, len(problem.objectives))
    out = Path(options.out)
    with made_folder(out):
        return _tune(problem, options, status, method, trials)


def _tune(
    problem: TuningProblem, options: Options, status: StatusLine, method: str, trials: int | None
) -> TuningResult:
    """The same, once everything is checked and there is a folder."""
    out, storage = Path(options.out), _storage(options)
    until = None if options.seconds is None else time.time() + options.seconds + PREPARING_SECONDS
    definition = definition_of(problem, method)
    if options.workers > 1:
        _check_sources(definition["parts"])
    store = open_store(
        storage,
        options.study,
        problem,
        definition,
        SearchBudget(trials, until, options.rollouts),
        resume=options.resume,
    )
    with closing(store), _workers(options, storage):
        _announce(status, problem, method, storage, store.count())
        tuned = run(
            problem,
            method=method,
            trials=trials,
            seconds=options.seconds,
            rollouts=options.rollouts,
            threads=max(1, cores() // options.workers),
            store=store,
            afterwards=REPORT_SECONDS,
            watch=status,
        )
    status.phase("writing best.toml, study.json and report.html")
    write(tuned, storage, options)
    status.stop()
    if tuned.interrupted:
        status.say("interrupted; this is the best so far")
    print_study(tuned)
    status.say(f"wrote best.toml, study.json and report.html in {out}")
    if tuned.interrupted:
        raise KeyboardInterrupt
    if options.stress:
        print_stress(tuned, out, status)
    return tuned


def write(tuned: TuningResult, storage: str, options: Options) -> None:
    """Write ``best.toml``, ``study.json`` and ``report.html``."""
    from dualwinch.reports.tuning import write_tuning_report

    problem, out = tuned.problem, Path(options.out)
    facts: dict[str, Any] = {
        "code version": f"dualwinch {__version__}",
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seed": problem.seed,
        "ensemble": one_line(problem.ensemble.name) if problem.ensemble else "none",
        "study": one_line(options.study),
        "storage": shown(storage) if is_database(storage) else one_line(storage),
        "method": tuned.method,
    }
    parts = part_records(problem)
    if parts:
        facts["parts"] = in_words(parts)
    check_folder(out)
    best = to_toml(tuned.best)
    write_best(out / "best.toml", tuned, best, facts)
    named = {name.replace(" ", "_"): value for name, value in facts.items()} | {"versions": versions()}
    write_study(out / "study.json", tuned, named, configuration(problem))
    write_tuning_report(out / "report.html", tuned, {**facts, **versions()}, best)


def check_options(options: Options) -> None:
    """Raise `ConfigurationError` where options alone are wrong, before anything is read."""
    for name, count in (("trials", options.trials), ("rollouts", options.rollouts)):
        if count is not None and count < 1:
            raise ConfigurationError(f"--{name} {count}: must be a whole number >= 1")
    if options.workers < 1:
        raise ConfigurationError(f"--workers {options.workers}: must be a whole number >= 1")
    if options.workers > 1 and not (options.storage and is_database(str(options.storage))):
        raise ConfigurationError("--workers: needs a database, --storage postgresql+psycopg://USER@HOST/DATABASE")
    check_storage(_storage(options))


def _check_sources(parts: Sequence[PartRecord]) -> None:
    for part in parts:
        if part["script"]:
            raise ConfigurationError(
                f"--workers: other processes cannot import the {part['what']} '{part['kind']}' of {part['source']}, "
                "a script; define it in a file of its own"
            )


def _announce(status: StatusLine, problem: TuningProblem, method: str, storage: str, known: int) -> None:
    controller = controller_in_words(problem.experiment.controller)
    where = f"{problem.scenarios} scenarios of '{problem.ensemble.name}'" if problem.ensemble else "one experiment"
    status.say(
        f"tuning {len(problem.space.dimensions)} gains of {controller} by {method} in {where}, seed {problem.seed}"
    )
    constraints = "; ".join(constraint.label for constraint in problem.constraints) or "nothing"
    status.say(f"minimise {', '.join(objective.name for objective in problem.objectives)} subject to {constraints}")
    kept = shown(storage) if is_database(storage) else storage
    status.say(f"kept in {kept}" + (f", which has {known} trials" if known else ""))
    status.objectives = problem.objectives


@contextmanager
def _workers(options: Options, storage: str) -> Iterator[None]:
    """Further processes on this machine that work on the study, ended at the end."""
    words = [sys.executable, "-m", "dualwinch", "worker", "--study", options.study]
    environment = os.environ | {STORAGE_VARIABLE: storage}
    started = [
        subprocess.Popen(words, env=environment, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        for _ in range(options.workers - 1)
    ]
    try:
        yield
    finally:
        for process in started:
            try:
                process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                process.terminate()


def print_study(tuned: TuningResult) -> None:
    """Print what was found, what it is worth, what would help and what it took."""
    console, verdict = terminal(), tuned.verdict

    def say(words: str | Text) -> None:
        console.print(words, highlight=False, soft_wrap=True)

    say(styled("bold", worth(tuned)))
    say(headline(tuned))
    console.print(_table(tuned))
    for words in contenders(tuned):
        say(words)
    for constraint in verdict.constraints:
        kept = verdict.scored.violations[constraint.label] <= 0
        say(styled("" if kept else "red", "kept    " if kept else "violated", f"  {constraint.label}"))
    for place in margin_places(tuned):
        say(place)
    say(endings(tuned))
    if beyond := authority(tuned):
        say(beyond)
    for number, sentence in enumerate(advice(tuned)):
        say(f"{'what would help: ' if not number else '                 '}{sentence}")
    if len(tuned.problem.objectives) > 1:
        say(f"Pareto front: {len(pareto_front(tuned.trials))} trials, in study.json")
    cost = tuned.cost
    margins = f"; {cost.margin_seconds:.1f} s of these for stability margins" if cost.margin_seconds else ""
    say(
        f"{cost.rollouts} rollouts; {cost.preparing:.1f} s preparing, {cost.searching:.1f} s searching "
        f"({100 * cost.overhead:.0f} % of it not in rollouts), {cost.judging:.1f} s choosing and scoring{margins}"
    )


def _table(tuned: TuningResult) -> Table:
    names, rows = statistics_table(tuned)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", style="bold", no_wrap=True)
    for name in names[1:]:
        table.add_column(name, justify="right" if name else "left")
    for row in rows:
        table.add_row(*row)
    return table


def print_stress(tuned: TuningResult, out: Path, status: StatusLine) -> None:
    """Find out, print, write, and have the report show it."""
    with ProgressLine("what breaks first") as progress:
        found = stress_tuned(tuned.problem, tuned.best, name="best.toml", progress=progress)
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    status.say(f"wrote {', '.join(write_stress(out, found))} in {out}")
