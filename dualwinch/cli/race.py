"""The command ``race``: progress, table, JSON, figures, report, and the gains of each entry as a configuration.

The module does not bear the command's name: that is the function ``dualwinch.race``, which does the work.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from dualwinch.cli.doctor import versions
from dualwinch.cli.options import COORDINATIONS, ESTIMATORS, LAWS, OWN, WHOLE, AssignmentsInBrief, Plugins, use_parts
from dualwinch.cli.output import terminal
from dualwinch.cli.progress import StatusLine

if TYPE_CHECKING:
    from dualwinch.tuning.benchmark.found import BenchmarkFindings
    from dualwinch.tuning.benchmark.result import BenchmarkResult
    from dualwinch.tuning.benchmark.scores import EntryResult

app = App(
    name="race",
    help_epilogue="""Examples:

    dualwinch race --ensemble rig --out race
    dualwinch race --ensemble sea --law fando-nftsm --law adrc --rollouts 5000
    dualwinch race --law fando-nftsm --estimator all --coordination all
    dualwinch race --ablations --searches 3 --rollouts 10000 --stress
    dualwinch race --plugin my_law.py --law my-law --law adrc
""",
)


@app.default
def race(
    *,
    ensemble: Annotated[str, Parameter(help="Ensemble of scenarios: `rig`, `sea`, or a TOML file.")] = "rig",
    law: Annotated[
        list[str] | None,
        Parameter(help=f"Position law: {LAWS}, {OWN}; may be repeated. Default: all.", negative=""),
    ] = None,
    estimator: Annotated[
        list[str] | None,
        Parameter(
            help=f"Estimator: {ESTIMATORS}, {OWN}, or all; may be repeated. Default: the ensemble's, as of "
            "`dualwinch tune`.",
            negative="",
        ),
    ] = None,
    coordination: Annotated[
        list[str] | None,
        Parameter(
            help=f"Coordination: {COORDINATIONS}, {OWN}, or all; may be repeated. Default: the paper's.", negative=""
        ),
    ] = None,
    ablations: Annotated[
        bool, Parameter(help="Include the paper's law without each of its parts.", negative="")
    ] = False,
    plugin: Plugins = None,
    rollouts: Annotated[int, WHOLE, Parameter(help="Rollouts of each search.")] = 30_000,
    searches: Annotated[
        int,
        WHOLE,
        Parameter(help="Searches per entry, each with its own seed: several show how much is luck."),
    ] = 1,
    scenarios: Annotated[int | None, WHOLE, Parameter(help="Scenarios a candidate is tuned on (default 12).")] = None,
    held_out: Annotated[int, WHOLE, Parameter(help="Held-out scenarios for the score.")] = 200,
    set_: AssignmentsInBrief = None,
    constraint: Annotated[
        list[str] | None,
        Parameter(help="As of `dualwinch tune`, for all; may be repeated; none: no constraint.", negative=""),
    ] = None,
    method: Annotated[str | None, Parameter(help="Optimiser, as of `dualwinch tune`.")] = None,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of all scenarios and searches.")] = 0,
    stress: Annotated[
        bool,
        Parameter(help="Also find which imperfection breaks the best of each first (`dualwinch stress`).", negative=""),
    ] = False,
    out: Annotated[Path, Parameter(help="Folder that keeps the race, to be continued.")] = Path("race"),
) -> None:
    """Tune every law with the same number of rollouts, and score all of them in the same held-out scenarios.

    Same seeds, constraints and scenarios for all; errors are compared scenario by scenario with those of the paper's
    gains, and a fixed rule decides which laws differ. Ctrl-C keeps finished entries: the same call
    continues with the rest, and a call with other laws adds them. The folder receives race.json, report.html, figures,
    and the gains of each entry as a configuration.
    """
    from dualwinch.config.folders import made_folder
    from dualwinch.tuning.benchmark.race import race

    use_parts(plugin)
    with made_folder(out), StatusLine("race") as status:
        status.phase("reading the problem")
        found = race(
            ensemble=ensemble,
            laws=law,
            estimators=estimator,
            coordinations=coordination,
            ablations=ablations,
            rollouts=rollouts,
            searches=searches,
            held_out=held_out,
            scenarios=scenarios,
            seed=seed,
            settings=set_ or [],
            constraints=constraint,
            method=method,
            stress=stress,
            out=out,
            progress=Clock(status),
        )
        status.phase("writing the report")
        written = write_race(out, found)
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    status.say(f"wrote {', '.join(written)} in {out}")
    if found.left:
        raise KeyboardInterrupt


GAINS = "gains"
"""Folder of the configurations."""


class Clock:
    """Says what is done and how long it will take, from the share that is done."""

    def __init__(self, status: StatusLine) -> None:
        self._status, self._began, self._entry = status, time.monotonic(), ""

    def __call__(self, share: float, words: str) -> None:
        """On a terminal at once; in a log where it is the next entry's turn."""
        entry = words.partition(":")[0]
        if self._status.console.is_terminal or entry != self._entry:
            self._entry = entry
            self._status.phase(f"{words}{self._left(share)}")

    def _left(self, share: float) -> str:
        """The time left, once enough is done to estimate it."""
        if share < 0.01:
            return ""
        left = (time.monotonic() - self._began) * (1 / share - 1)
        return f" · {left / 60:.0f} min left" if left >= 90 else f" · {left:.0f} s left"


def write_race(out: Path, found: BenchmarkResult) -> list[str]:
    """Write ``race.json``, ``race.svg``, ``fronts.svg``, ``report.html``, and the gains of each entry.

    Returns:
        Names of the files that were written.
    """
    from dualwinch.codegen.files import atomic
    from dualwinch.config.folders import make_folder
    from dualwinch.reports.race import write_race_report
    from dualwinch.simulation.plots import save
    from dualwinch.tuning.benchmark.summary import to_record

    facts = to_record(found) | {f"version_{name}": version for name, version in versions().items()}
    with atomic(out / "race.json") as unfinished:
        unfinished.write_text(json.dumps(facts, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    save(found.plot(), out / "race.svg")
    save(found.plot_fronts(), out / "fronts.svg")
    write_race_report(out / "report.html", found, versions())
    make_folder(out / GAINS)
    for scored in found.entries:
        text = configuration(found, scored)
        if text:
            with atomic(out / GAINS / f"{scored.entry.stem}.toml") as unfinished:
                unfinished.write_text(text, encoding="utf-8")
    return ["race.json", "race.svg", "fronts.svg", "report.html", f"{GAINS}/"]


def configuration(found: BenchmarkFindings, scored: EntryResult) -> str:
    """The best gains of an entry as TOML; empty where its parts are not known here, as those of an earlier call."""
    from dualwinch.config.ensemble_file import loads_ensemble
    from dualwinch.config.experiment_file import to_toml
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.settings import override

    nominal = loads_ensemble(found.terms.configuration, name="the race's ensemble").experiment
    try:
        best = override(nominal, {**scored.entry.values, **scored.gains})
    except ConfigurationError:
        return ""
    terms = found.terms
    words = f"{scored.entry.key}: the best of {terms.rollouts} rollouts in '{terms.ensemble}', seed {terms.seed}"
    return f"# {words}, by `dualwinch race`.\n\n{to_toml(best)}"
