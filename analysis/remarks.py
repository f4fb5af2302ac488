"""Remarks on problems of runs that their outcome does not show: slack ropes, saturation, chatter, instability."""

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from dualwinch.analysis.large_signal import LargeSignalStability, large_signal_stability
from dualwinch.analysis.linear_loop import fastest_growing, linear_closed_loop, loop_opened_at, without_idle_states
from dualwinch.analysis.margins import margins
from dualwinch.analysis.operating_points import loop_operating_point
from dualwinch.analysis.resonance import MARGIN_AMPLITUDES, RESONANCE, largest_gain, matched_damping, resonance_gains
from dualwinch.codegen.source.expressions import elements_read
from dualwinch.model.arguments import instance
from dualwinch.model.errors import ConfigurationError, DualwinchError
from dualwinch.model.linear.modes import Mode
from dualwinch.model.plant import is_distributed
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.result import EnsembleResult
from dualwinch.simulation.ensembles.streamed import EnsembleStatistics
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS, start_function
from dualwinch.simulation.loop.structure import is_automatic, solver_of, stiffest_mode
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.results.result import Result


@dataclass(frozen=True)
class RemarkLimits:
    """Thresholds of figures of merit and values for a remark.

    Attributes:
        chatter: mean change of a tension from sample to sample over half the preload; without noise it is below a
            thousandth for the laws of the paper's cases.
        saturated: share of the samples with the force command beyond its limit.
        torque_saturated: share of the samples with a motor torque at a limit; half in the paper's cases, whose second
            rope is kept at its smallest tension.
        overload: largest tension over the limit of its command; 1.33 in the paper's Case 1.
        resized: ratio of a size of ropes or winches to the paper's, or the inverse, that requires other tension limits.
    """

    chatter: float = 0.01
    saturated: float = 0.05
    torque_saturated: float = 0.6
    overload: float = 1.5
    resized: float = 1.5


WINCHES = ("winch_1", "winch_2")
ROPE_KEYS = ("rope_1", "rope_2")

DEPENDENT: dict[str, tuple[str, ...]] = {
    "plant.vehicle.normal_force": ("plant.vehicle.mass",),
    "plant.vehicle.drag_area": ("plant.vehicle.diameter", "plant.vehicle.height"),
    "plant.vehicle.diameter": ("plant.vehicle.drag_area",),
    "plant.vehicle.height": ("plant.vehicle.drag_area",),
    **{f"plant.{rope}.diameter": (f"plant.{rope}.area",) for rope in ROPE_KEYS},
    **{f"plant.{winch}.inertia": (f"plant.{winch}.drum_radius",) for winch in WINCHES},
    **{
        f"controller.{winch}.{gain}": (f"plant.{winch}.drum_radius", f"plant.{winch}.gear_ratio")
        for winch in WINCHES
        for gain in ("kp", "ki")
    },
}
"""Key → other keys whose defaults its own default was chosen for, though it does not follow their values."""


def defaults_left(experiment: Experiment, own: Collection[str] = ()) -> list[str]:
    """Remarks on defaults that are still used although values they were chosen for have changed.

    Keys in the experiment's file (`own`) are intended, even if they equal the default. Equal remarks on both winches or
    ropes are merged, as ``winch_*``.
    """
    values, usual = leaves(experiment), leaves(Experiment())
    remarks_by_cause: dict[str, dict[str, None]] = {}
    for key, causes in DEPENDENT.items():
        changed = [other for other in causes if values.get(other) != usual[other]]
        if changed and key not in own and key in values and values[key] == usual.get(key):
            remarks_by_cause.setdefault(", ".join(changed), {})[f"{key} = {values[key]:g}"] = None
    merged: dict[str, list[str]] = {}
    for causes, keys in remarks_by_cause.items():
        both = remarks_by_cause.get(swapped(causes))
        if both is not None and list(map(swapped, keys)) == list(both):
            merged[starred(causes)] = list(map(starred, keys))
        else:
            merged[causes] = list(keys)
    return [
        f"{', '.join(keys)}: still the default{'s' * (len(keys) > 1)}, not following {causes}; "
        f"if intended, give {'them' if len(keys) > 1 else 'it'}"
        for causes, keys in merged.items()
    ] + [*_drag_left(values, usual, own), *_tensions_left(values, usual, own), *_mass_left(values, usual, own)]


def _drag_left(values: Mapping[str, Any], usual: Mapping[str, Any], own: Collection[str]) -> Iterator[str]:
    """Remark that a given drag area may include the drag coefficient, which is still the paper's."""
    area, coefficient = "plant.vehicle.drag_area", "plant.vehicle.drag_coefficient"
    described = area in own or values[area] != usual[area]
    if described and coefficient not in own and values[coefficient] == usual[coefficient]:
        yield (
            f"{coefficient} = {usual[coefficient]:g}: still the paper's, times drag_area = {values[area]:g} m^2; where "
            "that is a drag area Cd A, give drag_coefficient = 1"
        )


TENSIONS = ("preload", "tension_min", "tension_max")
"""Keys of ``controller.coordination`` whose defaults suit the paper's ropes and motors."""

SIZES = (
    *(f"plant.{rope}.{size}" for rope in ROPE_KEYS for size in ("area", "diameter")),
    *(f"plant.{winch}.{size}" for winch in WINCHES for size in ("drum_radius", "gear_ratio")),
)
"""Sizes that determine the suitable tensions of ropes and winches."""


def _tensions_left(values: Mapping[str, Any], usual: Mapping[str, Any], own: Collection[str]) -> Iterator[str]:
    """Remark on tensions that are still the paper's although ropes or motors have changed."""
    factor = RemarkLimits().resized
    resized = [
        key
        for key in SIZES
        if key in values and min(values[key], usual[key]) > 0
        if max(values[key] / usual[key], usual[key] / values[key]) > factor
    ]
    keys = {name: f"controller.coordination.{name}" for name in TENSIONS}
    defaults = [name for name, key in keys.items() if key not in own and values.get(key) == usual[key]]
    if resized and defaults:
        tensions = ", ".join(f"{name} = {usual[keys[name]]:g}" for name in defaults)
        sizes = ", ".join(dict.fromkeys(starred(key) if swapped(key) in resized else key for key in resized))
        yield (
            f"controller.coordination: {tensions} N: still of the paper's ropes and motors, not following {sizes}; "
            "if intended, give them"
        )


def _mass_left(values: Mapping[str, Any], usual: Mapping[str, Any], own: Collection[str]) -> Iterator[str]:
    """Remark on ropes to which mass is added even mid-track, as a default is that of a longer track."""
    middle = values["plant.track.length"] / 2 + values["plant.track.rope_offset"]
    heavy = [f"plant.{rope}.shortest_mass" for rope in ROPE_KEYS if values[f"plant.{rope}.mass_per_length"]]
    left = [key for key in heavy if key not in own and middle < values[key] == usual[key]]
    for key in dict.fromkeys(map(starred, left)) if len(left) == len(ROPE_KEYS) else left:
        yield (
            f"{key} = {usual[left[0]]:g} m: still the default, and ropes are {middle:g} m long mid-track; "
            "if intended, give it"
        )


DRAWN = frozenset(("plant.vehicle.height", "plant.vehicle.diameter", *(f"plant.{rope}.diameter" for rope in ROPE_KEYS)))
"""Sizes that describe a machine whether or not its motion depends on them: animations and `idealisations` do."""


def without_effect(experiment: Experiment, own: Collection[str]) -> list[str]:
    """Remarks on values that the user has set and that nothing depends on, such as the damping of a rigid gearbox.

    `own` are the keys that the user has set; zeros and values equal to the default are left out. Nothing is said of an
    experiment that cannot run, or that has another error.
    """
    defaults = {key: leaf.default for key, leaf in describe_parts(experiment).items()}
    values, usual = leaves(experiment), defaults | leaves(Experiment())
    changed = {key: values[key] for key in set(own) - DRAWN if values.get(key) and values[key] != usual.get(key)}
    if not changed:
        return []
    try:
        prepared = prepare(experiment)
    except ConfigurationError:
        return []
    functions = *prepared.loop.functions, start_function(prepared.structure)
    read = set().union(*(elements_read(function, "parameters") for function in functions))
    idle = [name for index, name in enumerate(prepared.loop.parameters) if index not in read and name in changed]
    both = {starred(key) for key in idle if changed.get(swapped(key)) == changed[key] and swapped(key) != key}
    named = dict.fromkeys((starred(key) if starred(key) in both else key, changed[key]) for key in idle)
    return [
        f"{key} = {value:g}: no effect in this experiment, as the effect that it belongs to is absent or switched off"
        for key, value in named
    ]


def swapped(words: str) -> str:
    """Keys with the numbers of the other winch or rope."""
    return NUMBER.sub(lambda match: f"{match[1]}_{3 - int(match[2])}", words)


def starred(words: str) -> str:
    """Keys with ``*`` for the number of winch or rope, as ``winch_*``."""
    return NUMBER.sub(r"\1_*", words)


NUMBER = re.compile(r"\b(winch|rope|creep)_([12])\b")


def raised_substeps(experiment: Experiment) -> list[str]:
    """Remark on sub-steps that the adaptive integrator takes beyond `simulation.substeps`, as the plant needs them."""
    simulation, plant, limits = experiment.simulation, experiment.plant, experiment.controller.limits
    try:
        solver = solver_of(experiment)
        if is_automatic(experiment) or solver.substeps <= simulation.substeps:
            return []
        mode = stiffest_mode(plant, solver.integrator, limits)
    except (ConfigurationError, ArithmeticError):
        return []
    return [f"simulation.substeps = {simulation.substeps}: {solver.substeps} are taken, as {mode}"]


NOT_COMPUTABLE = (DualwinchError, ArithmeticError, np.linalg.LinAlgError)
"""Errors of a loop without a steady state, or with values beyond every float: nothing is remarked on it."""


def remarks(
    result: Result | EnsembleResult | EnsembleStatistics, limits: RemarkLimits | None = None, *, loop: bool = True
) -> list[str]:
    """Remarks on problems of a run, or of an ensemble's, that outcomes do not show, and on its loop (`loop_remarks`).

    An unstable loop comes first, as the cause of everything else; advice for stable loops is then left out. The loop is
    checked if the plant is not the default one, or if the run chatters or was not completed, so that figures of merit
    say nothing; not at all (`loop` is False) if torques came from another controller than the experiment's.

    Args:
        result: of a run, or of an ensemble, whose worst scenario and mean are judged.
        limits: of figures of merit; default: the usual ones.
        loop: whether to check the loop.

    Example:
        >>> import dualwinch as dw
        >>> dw.remarks(dw.simulate(dw.case(4)))
        []
    """
    instance("result", result, Result, EnsembleResult, EnsembleStatistics)
    if not isinstance(result, Result):
        completed = result.outcome_counts.get("completed", 0) == len(result)
        return list(ensemble_remarks(result.ensemble.experiment, result.statistics, completed=completed))
    figures, completed = dict(result.metrics), result.outcome == "completed"
    return list(_remarks(result.experiment, figures, figures, "", limits, loop=loop, completed=completed))


def ensemble_remarks(
    experiment: Experiment, statistics: Mapping[str, Mapping[str, float]], *, completed: bool
) -> Iterator[str]:
    """Remarks on an ensemble, as `remarks` has them on a run: on its nominal loop, the worst scenario and the mean.

    `statistics` are those of each figure of merit by kind; `completed` tells whether all scenarios were.
    """
    worst, mean = ({name: of[kind] for name, of in statistics.items()} for kind in ("worst", "mean"))
    yield from _remarks(experiment, worst, mean, " of the worst scenario", None, loop=True, completed=completed)


def _remarks(
    experiment: Experiment,
    worst: Mapping[str, float],
    mean: Mapping[str, float],
    where: str,
    limits: RemarkLimits | None,
    *,
    loop: bool,
    completed: bool,
) -> Iterator[str]:
    """Remarks on figures of merit: tensions by the worst scenario, which `where` names, all else by the mean."""
    limits, control = limits or RemarkLimits(), experiment.controller.limits
    half = control.preload / 2
    chatters = mean["chatter"] > limits.chatter * half
    looked_at = chatters or not completed or experiment.plant != Experiment().plant
    unstable = list(loop_remarks(experiment)) if loop and looked_at else []
    yield from unstable
    if loop and looked_at and not unstable:
        yield from large_signal_remarks(experiment)
    if worst["slack_share"] > 0:
        advice = "" if unstable else ": increase the preload or reduce the speed"
        yield f"a rope is slack in {100 * worst['slack_share']:.3g} % of the samples{where}{advice}"
    if worst["peak_tension"] > limits.overload * control.tension_max:
        peak, share = worst["peak_tension"], worst["peak_tension"] / control.tension_max
        yield f"a rope is pulled by up to {peak:.4g} N, {share:.3g} times tension_max"
    if mean["saturated_share"] > limits.saturated:
        yield f"the force command is beyond its limit in {100 * mean['saturated_share']:.3g} % of the samples"
    if mean["torque_saturated_share"] > limits.torque_saturated:
        yield f"a motor torque is at its limit in {100 * mean['torque_saturated_share']:.3g} % of the samples"
    if chatters:
        yield (
            f"it chatters: tensions jump by {mean['chatter']:.3g} N a sample, {100 * mean['chatter'] / half:.2g} % of "
            "their mean"
        )


def loop_remarks(experiment: Experiment) -> Iterator[str]:
    """Remark on a closed loop that is unstable at rest at mid-track, by its poles or by the rule for drum resonance.

    Uses `linear_closed_loop` and `resonance_gains`, as `dualwinch linearise --loop closed` does.
    """
    middle, mode = experiment.plant.track.length / 2, None
    where = f"(dualwinch linearise --loop closed --x {middle:g})"
    with suppress(*NOT_COMPUTABLE):  # no steady state to linearise at
        mode = fastest_growing(linear_closed_loop(experiment, middle), experiment.plant)
    if mode is not None:
        yield (
            f"unstable at small amplitudes: at rest at {middle:g} m deviations {in_words(mode)}"
            f"{_cycle_words(experiment)} {where}"
        )
    try:
        gains = resonance_gains(experiment, amplitudes=MARGIN_AMPLITUDES[RESONANCE])
    except NOT_COMPUTABLE:
        return  # the rule does not apply to this law
    worst = largest_gain(gains)
    if worst.verdict == "fails":
        yield (
            f"drum {worst.winch} may oscillate on its rope at {worst.frequency:.3g} Hz: the loop gain at this "
            f"resonance is {worst.gain:.3g}, must be at most 1{_damping_advice(experiment, worst.winch)} {where}"
        )


def in_words(mode: Mode) -> str:
    """Growth and name of an unstable mode."""
    frequency = f" at {mode.natural_frequency / (2 * np.pi):.3g} Hz" if mode.rate.imag else ""
    return f"grow by {mode.rate.real:.3g} 1/s{frequency}, {mode.label}"


def stability_of(experiment: Experiment) -> LargeSignalStability | None:
    """`large_signal_stability`; ``None`` without steady motion, or if the loop is the same at all amplitudes."""
    try:
        return large_signal_stability(experiment)
    except NOT_COMPUTABLE:
        return None


def _cycle_words(experiment: Experiment) -> str:
    """Size of the limit cycle of a loop that is unstable at small amplitudes, and whether it matters; may be empty."""
    stability = stability_of(experiment)
    if stability is None:
        return ""
    harmless = ", less than the speed sensor's noise: harmless"
    return f"{stability.cycle_words}{harmless if stability.cycle <= experiment.sensors.speed_noise else ''}"


def large_signal_remarks(experiment: Experiment) -> Iterator[str]:
    """The speed error up to which the loop is stable, where it has a limit or ropes have mass (`large_signal`)."""
    stability, middle = stability_of(experiment), experiment.plant.track.length / 2
    if stability and (not stability.throughout or is_distributed(experiment.plant)):
        yield f"{stability} (dualwinch linearise --loop open --x {middle:g})"


def loop_notes(experiment: Experiment) -> list[str]:
    """Remarks on a loop: that it is unstable at small amplitudes, else up to which speed error it is stable."""
    return [*loop_remarks(experiment)] or [*large_signal_remarks(experiment)]


def _damping_advice(experiment: Experiment, winch: int) -> str:
    """What to set where the drum's speed is damped less than the wave impedance of its rope."""
    key, matched = f"controller.winch_{winch}.damping", matched_damping(experiment, winch)
    here = leaves(experiment).get(key)
    if here is None or here >= 0.9 * matched:
        return ""
    return f"; {key} = {here:.3g}, where {matched:.3g} matches its rope"


def delay_remarks(experiment: Experiment, least: float) -> Iterator[str]:
    """Remark on a loop at rest at mid-track whose delay margin is smaller than the required one in s.

    There is no remark on an unstable loop (`loop_remarks`).
    """
    middle = experiment.plant.track.length / 2
    try:
        point = loop_operating_point(experiment, middle, 0.0)
        margins_at = {each: margins(without_idle_states(loop_opened_at(point, each))) for each in LOOP_OPENINGS}
    except NOT_COMPUTABLE:
        return
    opening, worst = min(margins_at.items(), key=lambda each: each[1].delay)
    if worst.delay < least and all(each.stable for each in margins_at.values()):
        yield (
            f"the loop tolerates {1e3 * worst.delay:.2g} ms of further delay at {opening}, at rest at {middle:g} m; a "
            f"sample takes {1e3 * experiment.simulation.sample_time:g} ms "
            f"(dualwinch linearise --loop open --opening {opening} --x {middle:g})"
        )


LINEARISE = "dualwinch linearise"
"""The command named in remarks on a loop."""


def in_full(words: str, typed: str) -> str:
    """A remark on a loop in which the command has the options that select the experiment."""
    return words.replace(LINEARISE, f"{LINEARISE} {typed}".rstrip())
