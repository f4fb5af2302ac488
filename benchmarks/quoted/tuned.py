"""What tuned gains come to on machines that no search has seen, and what breaks them: searches of minutes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

import dualwinch as dw
from benchmarks.document import markdown
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.ensembles.comparison import Comparison
from dualwinch.toolboxes.stress.result import ImperfectionResult

SCENARIOS, SEED = 200, 7
"""Of the comparisons."""

IN_THE_SEA = Path("tests/toolboxes/stress/tuned_in_the_sea.toml")
"""Gains of a search on exact drums that docs/stress.md breaks."""

RARE: dict[str, Any] = {"sensors.outage_length": 0.5, "sensors.outage_period": 5.0}
"""Longer and more frequent outages."""


@dataclass(frozen=True)
class Errors:
    """Mean square errors in mm² where the reference is feasible, of the paper's gains and of tuned ones."""

    paper: float
    tuned: float


@cache
def best(ensemble: str, rollouts: int = 15_000, estimator: str = "") -> dw.Experiment:
    """What `dualwinch tune --seed 1` finds, with the default constraints, margins included."""
    settings = [f"controller.estimator={estimator}"] if estimator else []
    found = dw.tune(dw.tuning_problem(ensemble=ensemble, seed=1, settings=settings), rollouts=rollouts)
    return replace(dw.load_ensemble(ensemble).experiment, controller=found.best.controller)


def compared(
    tuned: dw.Experiment,
    ensemble: str,
    settings: Mapping[str, Any] | None = None,
    paper: dw.Controller | None = None,
) -> Comparison:
    """The paper's gains and tuned ones in the same scenarios."""
    drawn = dw.load_ensemble(ensemble)
    drawn = replace(drawn, experiment=dw.override(drawn.experiment, dict(settings or {})))
    return dw.compare({"paper": paper or paper_controller(), "tuned": tuned.controller}, drawn, SCENARIOS, SEED)


def errors(found: Comparison) -> Errors:
    """Their mean square errors."""
    return Errors(*(1e6 * found.mean_mse_within_authority(name) for name in ("paper", "tuned")))


@cache
def on_the_rig() -> dict[str, Comparison]:
    """Gains tuned in `rig` and the paper's, on rigs with the ensemble's outages and with others."""
    conditions: dict[str, dict[str, Any]] = {
        "as drawn": {},
        "no outages": {"sensors.outage_length": 0.0},
        "long outages": RARE,
        "reported": RARE | {"sensors.outage": "missing"},
    }
    return {words: compared(best("rig"), "rig", settings) for words, settings in conditions.items()}


def _row(found: dw.StressResult, label: str) -> ImperfectionResult:
    """What a stress test says of one imperfection."""
    return next(row for row in found.ranking if row.imperfection.label == label)


@cache
def all_at_once() -> tuple[float, float, str]:
    """The largest size of all imperfections that gains tuned in `rig` bear, the next one, and what that breaks."""
    found = dw.stress(best("rig"))
    failed = next(
        row for row in found.ranking if len(row.imperfection.keys) > 1 and row.imperfection.label == "all together"
    )
    first = failed.margins["given"]
    return first.held, first.size or np.inf, first.violated[0].words if first.violated else ""


def tuning() -> str:
    """The third result of the README."""
    tuned = best("site", 4_000)
    comparison = compared(tuned, "site", paper=paper_controller(tuned.controller))
    drawn, metrics = errors(comparison), {name: each.metrics for name, each in comparison.contenders.items()}
    slack = {name: int(np.sum(each["slack_share"] > 0)) for name, each in metrics.items()}
    load = np.nanmean(metrics["tuned"]["continuous_load"]) / np.nanmean(metrics["paper"]["continuous_load"])
    paper, gains = (f"{sqrt(error):.{digits}f}" for error, digits in ((drawn.paper, 1), (drawn.tuned, 2)))
    return f"""\
- **What tuning gains.** On {SCENARIOS} simulated machines with heavy ropes and winches that the search never saw, the
  root mean square error, where the force suffices, falls from {paper} to {gains} mm and slack ropes from
  {slack["paper"]} to {slack["tuned"]}, for {load:.2f} times the motors' load. [Where that holds](docs/site.md)."""


def rig() -> str:
    """Gains tuned in `rig`: the table of docs/rig.md and what follows from it."""
    found, rows = on_the_rig(), []
    words = {
        "as drawn": "MSE where the reference is feasible, mm²",
        "no outages": "the same without outages",
        "long outages": "the same with outages of 0.5 s every 5 s (`outage_length=0.5`, `outage_period=5`)",
        "reported": "the same, outages reported (`outage=missing`)",
    }
    for condition, comparison in found.items():
        both = errors(comparison)
        rows.append([words[condition], f"{both.paper:.3g}", f"{both.tuned:.5f}"])
        if not comparison.contenders["paper"].completed.all():
            rows[-1][1] = "lost"
    drawn = found["as drawn"]
    paper, tuned = (drawn.contenders[name].metrics for name in ("paper", "tuned"))
    rows.append(["chatter, N/sample", *(f"{np.nanmean(each['chatter']):.1f}" for each in (paper, tuned))])
    rows.append(["largest tension, N", *(f"{np.nanmax(each['peak_tension']):.0f}" for each in (paper, tuned))])
    rows.append(["runs with a slack rope", *(f"{np.sum(each['slack_share'] > 0)}" for each in (paper, tuned))])
    without = errors(found["no outages"])
    load = np.nanmean(tuned["continuous_load"]) / np.nanmean(paper["continuous_load"])
    held, breaks, by = all_at_once()
    median = 1e6 * np.nanmedian(tuned["mse"])
    return f"""\
{markdown([f"{SCENARIOS} machines that tuning never saw", "paper's gains", "tuned in `rig`"], rows)}

During an outage the paper's controller acts on the last reading; the fair comparison is the second row:
{without.paper / without.tuned:.0f} times, at {load:.2f} times the motors' load. The tuned gains, with
[`self-calibrating-kalman`](observability.md), still hold where all of the above are {held:.2g} times as large at once;
at {breaks:.2g} times they break a limit ({by}; `stress`). A few draws that ask for nearly all the force of the motors
raise the mean; the median is {median:.5f} mm²."""


def breakdown() -> str:
    """Sizes at which the imperfections of a rig break the paper's gains and those tuned on exact drums."""
    headings, rows = dw.stress(dw.load(IN_THE_SEA)).table()
    headings = [
        each.replace("paper breaks", "the paper's break").replace("given breaks", "those gains break")
        for each in headings
    ]
    return markdown(_without_amount(headings), [_without_amount(row) for row in rows]).replace("--:|", "---|")


def _without_amount(row: Sequence[str]) -> list[str]:
    """A row without its second cell, the amount in the ensemble."""
    return [row[0], *row[2:]]


def heavy_breakdown() -> str:
    """Sizes at which what `site` has beyond `rig` breaks gains that were tuned in `rig`, with the default margins."""
    found = dw.stress(best("rig"), ensemble="site", base="rig")
    rows = [
        (row[0], *row[-2:])
        for each, row in zip(found.ranking, found.table()[1], strict=True)
        if each.margins["given"].size is not None
    ]
    table = markdown(["imperfection", "gains tuned in rig break at", "by"], rows).replace("--:|", "---|")
    return f"{table}\n\n*{len(found.ranking) - len(rows)} further imperfections break them at no size.*"


def learnt() -> str:
    """Gains tuned in the sea with the filter that learns the drums, in the sea and on the rig."""
    experiment = best("sea", estimator="self-calibrating-kalman")
    sea, rig = (compared(experiment, name) for name in ("sea", "rig"))
    rows = []
    for name, words in (("paper", "paper's controller"), ("tuned", "`self-calibrating-kalman`, tuned in the sea")):
        metrics = [found.contenders[name].metrics for found in (sea, rig)]
        shares = [share for each in metrics for share in np.nanpercentile(1e12 * each["mse"], [50, 95])]
        slack = [int(np.sum(each["slack_share"] > 0)) for each in metrics]
        slacks = f"in {slack[0]}, in {slack[1]}" if any(slack) else "none"
        rows.append([words, *(f"{float(f'{share:.3g}'):,.0f}".replace(",", " ") for share in shares), slacks])
    headings = [
        "",
        "`sea`: median MSE (µm²)",
        "95 % below",
        "`rig`: median MSE (µm²)",
        "95 % below",
        "slack ropes in `sea`, in `rig`",
    ]
    completed = all(contender.completed.all() for found in (sea, rig) for contender in found.contenders.values())
    return f"{markdown(headings, rows)}\n\n*{SCENARIOS} scenarios each, {'all' if completed else 'not all'} completed.*"
