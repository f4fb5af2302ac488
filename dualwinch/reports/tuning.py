"""The HTML report of ``dualwinch tune``, with a place for the robustness margins of ``dualwinch stress``."""

import math
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from dualwinch.analysis.idealisations import idealisations
from dualwinch.analysis.remarks import in_full
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.model.quantities.tree import leaves
from dualwinch.reports.page import data_uri, number_text, sentence, write_page
from dualwinch.simulation.metrics.metrics import in_words
from dualwinch.simulation.plots.style import prefixed_unit
from dualwinch.tuning.plots import (
    before_and_after,
    best_gains,
    distributions,
    front,
    history,
    importance,
)
from dualwinch.tuning.result import (
    TuningResult,
    advice,
    authority,
    contenders,
    headings,
    headline,
    margin_places,
    too_short,
    where,
    worth,
)

CAPTIONS = {
    "history": "Each dot is a candidate in all tuning scenarios. Pale ones violate a constraint or were abandoned "
    "after the first scenarios. A candidate that satisfies every constraint ranks above any that does not.",
    "importance": "Difference between a gain's values among the best tenth of all complete trials, constraints aside, "
    "and among the others (PED-ANOVA). An unimportant gain may stay at its default.",
    "gains": "One row per gain, from its lower to its upper bound, with a mark for each candidate. Where marks crowd, "
    "the gain is settled; where they spread, it matters little; where they end at a bound, a wider one may help.",
    "front": "The price of one figure of merit in terms of the other. Where a bound on the chatter touches the lower "
    "edge, it keeps the error from being smaller.",
    "before": "The same plant, sea and noise for both. Note the two scales of the error.",
    "distributions": "The same scenarios for both, seen neither by the search nor by the choice of the best.",
}


def write_tuning_report(
    path: str | Path,
    tuned: TuningResult,
    facts: Mapping[str, Any],
    configuration: str,
    plugins: Sequence[str] = (),
    following: str = "",
) -> None:
    """Write the report: one self-contained HTML file, which appears whole or not at all.

    Args:
        path: the file.
        tuned: the study.
        facts: provenance, name → value.
        configuration: the best as TOML.
        plugins: files with the user's own parts, for commands about the best gains.
        following: command that compares the best gains with the paper's in the ensemble, which may be a file; default:
            in the built-in ensemble of that name.

    Raises:
        OSError: the file cannot be written.
    """
    folder = Path(path).parent
    plugin_options = "".join(f" --plugin {shlex.quote(plugin)}" for plugin in plugins)
    noted = [
        in_full(words, f"--config {shlex.quote(str(folder / 'best.toml'))}{plugin_options}") for words in tuned.remarks
    ]
    bounds = "; ".join(constraint.label for constraint in tuned.training.constraints) or "nothing"
    write_page(
        Path(path),
        "tuning.html.j2",
        summary=_summary(tuned),
        gained=gained(tuned),
        idealised=[one.statement for one in idealisations(tuned.best)],
        costs=costs(tuned),
        steps=next_steps(tuned, folder, plugin_options, following),
        stress=_stress_command(folder, plugin_options),
        constraints=f"Constraints of the search: {bounds}.",
        contenders=" ".join(map(sentence, contenders(tuned))),
        authority=" ".join(filter(None, map(sentence, (*noted, authority(tuned), too_short(tuned))))),
        where=where(tuned),
        headings=list(headings(tuned).values()),
        scores=_scores(tuned),
        bounds=_bounds(tuned),
        other_bounds=other_bounds(tuned),
        margins=margin_places(tuned),
        pictures=_pictures(tuned),
        gains=_gains(tuned),
        facts={**facts, **_cost(tuned)},
        configuration=configuration.strip(),
    )


def _summary(tuned: TuningResult) -> str:
    feasible = sum(trial.feasible for trial in tuned.trials)
    verb = "satisfies" if tuned.verdict.scored.feasible else "does not satisfy"
    return (
        f"{worth(tuned)} {sentence(headline(tuned))} It {verb} every constraint {where(tuned)}. "
        f"Of {len(tuned.trials)} trials, {feasible} satisfied them in all tuning scenarios."
    )


def _scores(tuned: TuningResult) -> list[dict[str, Any]]:
    verdict, columns = tuned.verdict, list(headings(tuned))
    rows = []
    for name, value in verdict.scored.statistics.items():
        theirs = verdict.statistics("paper")[name]
        rows.append(
            {
                "name": in_words(name),
                "values": [number_text(verdict.statistics(column)[name]) for column in columns],
                "ratio": number_text(value / theirs) if theirs > 0 <= value else "–",
                "unit": readable_unit(tuned.problem.units[name]),
            }
        )
    return rows


def _bounds(tuned: TuningResult) -> list[dict[str, Any]]:
    scored = tuned.verdict.scored
    return [
        {
            "label": constraint.label,
            "value": number_text(scored.statistics[constraint.statistic.name]),
            "satisfied": scored.violations[constraint.label] <= 0,
        }
        for constraint in tuned.verdict.constraints
    ]


def other_bounds(tuned: TuningResult) -> str:
    """The bounds relative to the paper's gains that had other values in the search, as its scenarios differ."""
    pairs = zip(tuned.training.constraints, tuned.verdict.constraints, strict=True)
    differences = [searched.label for searched, here in pairs if searched.label != here.label]
    if not differences:
        return ""
    words = "A bound relative to the paper's gains has another value in other scenarios"
    return f"{words}: in the search {'; '.join(differences)}."


def _gains(tuned: TuningResult) -> list[dict[str, Any]]:
    start, best = leaves(tuned.problem.experiment), tuned.gains
    return [
        {"key": key, "best": number_text(best[key]), "start": number_text(start[key]), "searched": dimension.allowed}
        for dimension in tuned.problem.space.dimensions
        for key in dimension.keys
    ]


def _cost(tuned: TuningResult) -> dict[str, str]:
    cost = tuned.cost
    times = {"preparing": cost.preparing, "searching": cost.searching, "choosing and scoring": cost.judging}
    return {
        "trials": str(len(tuned.trials)),
        "rollouts": ", ".join(filter(None, (str(cost.rollouts), cost.mostly_judging))),
        "time": ", ".join(f"{seconds:.1f} s {words}" for words, seconds in times.items()),
    }


SECTIONS = {"gained": ("distributions", "before"), "cost": ("front",), "search": ("history", "importance", "gains")}
"""Section of the report → its figures."""


def _pictures(tuned: TuningResult) -> dict[str, list[dict[str, str]]]:
    problem, trials, verdict = tuned.problem, tuned.trials, tuned.verdict
    figures: dict[str, tuple[str, Figure | None]] = {
        "distributions": ("Test set", distributions(verdict)),
        "before": ("The paper's gains and the best", before_and_after(problem, verdict)),
        "history": ("History", history(problem, trials)),
        "front": ("Trade-off", front(problem, tuned.training.constraints, trials)),
        "importance": ("Which gains matter", importance(problem, trials)),
        "gains": ("Gains of the best candidates", best_gains(problem, trials, verdict)),
    }
    pictures = {
        name: {"title": title, "caption": CAPTIONS[name], "source": data_uri(figure)}
        for name, (title, figure) in figures.items()
        if figure is not None
    }
    return {section: [pictures[name] for name in names if name in pictures] for section, names in SECTIONS.items()}


COSTS = {
    "mean.chatter": "chatter",
    "mean.continuous_load": "the motors' load (root mean square torque)",
    "mean.torque_rate": "the rate of torque",
    "mean.energy": "energy",
}
"""Statistics that usually grow with better tracking → their names."""


def gained(tuned: TuningResult) -> str:
    """Root mean square error of the best, the start and the paper's gains; empty if the best is no improvement."""
    verdict = tuned.verdict
    errors = {name: verdict.statistics(name).get("mean.mse", math.nan) for name in verdict.shown}
    if not verdict.improved or not all(0 < error < math.inf for error in errors.values()):
        return ""
    before = " and ".join(
        f"{_length(errors[name])} with {words}"
        for name, words in (("start", "the start"), ("paper", "the paper's gains"))
        if name in errors
    )
    return f"Root mean square error: {_length(errors['best'])}, where it was {before}." if before else ""


def costs(tuned: TuningResult) -> list[str]:
    """Costs of the best gains relative to the paper's, and the largest tension beside its limit.

    Of gains that lose runs or violate a bound, a lower number is not called free of cost.
    """
    verdict = tuned.verdict
    tuned_statistics, paper_statistics = verdict.scored.statistics, verdict.statistics("paper")
    sound = verdict.scored.feasible
    failed = sum(count for outcome, count in verdict.scored.outcomes.items() if outcome != "completed")
    rows = []
    if failed:
        rows.append(f"{failed} of {verdict.scored.scenarios} runs do not complete; means are over the others.")
    elif not sound:
        rows.append("These gains violate a bound; a lower cost does not make up for that.")
    for name, words in COSTS.items():
        if tuned_statistics.get(name, 0) > 0 and paper_statistics.get(name, 0) > 0:
            ratio = tuned_statistics[name] / paper_statistics[name]
            free = ", no cost" if ratio <= 1 and sound else ""
            rows.append(f"{words[:1].upper()}{words[1:]}: {ratio:.3g} × the paper's{free}.")
    peak = tuned_statistics.get("worst.peak_tension", math.nan)
    limit = float(tuned.problem.experiment.controller.limits.tension_max)
    if math.isfinite(peak):
        rows.append(f"Largest tension {peak:.0f} N; commands are limited to {limit:.0f} N.")
    return rows


def _stress_command(folder: Path, own: str) -> str:
    return f"dualwinch stress {shlex.quote(str(folder / 'best.toml'))}{own} --out {shlex.quote(str(folder))}"


def next_steps(tuned: TuningResult, folder: Path, own: str = "", following: str = "") -> list[tuple[str, str]]:
    """Next steps: words and a command, empty for mere advice.

    Args:
        tuned: the study.
        folder: of its files.
        own: options of the commands for the user's own parts, each after a space.
        following: as in `write_tuning_report`.
    """
    best = shlex.quote(str(folder / "best.toml"))
    ensemble = tuned.problem.ensemble
    steps = [(f"{words[:1].upper()}{words[1:]}.", "") for words in advice(tuned)]
    if not tuned.verdict.improved:
        return steps
    if ensemble is not None:
        following = following or f"dualwinch compare paper {best} --ensemble {shlex.quote(ensemble.name)}{own}"
        words = "Check it against the paper's gains in scenarios of a new seed, with confidence intervals:"
        steps.append((words, f"{following} --seed 1000"))
    words = "Find which imperfection breaks it first; this report will then show it:"
    steps.append((words, _stress_command(folder, own)))
    steps.append(("Look at a run:", f"dualwinch simulate --config {best}{own} --plot run.png"))
    if tuned.supported:
        steps.append(("Put it on hardware, as C99:", f"dualwinch export c --config {best}{own} --out firmware"))
    return steps


def _length(mean_square: float) -> str:
    size = math.sqrt(mean_square)
    unit, name = prefixed_unit("m", size)
    return f"{size / unit:.3g} {name}"
