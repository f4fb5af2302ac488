"""Design of a controller for a machine: formulas (`controllers.presets.designed`), verified by stability margins.

1. Parts: the sliding-mode law with its observer, a filter that estimates the disturbance, and winches in tension
   control. Parts that have these gains stay as they are.
2. Gains by the formulas.
3. Margins of the nominal machine and of some drawn ones: at rest and at speed, at mid-track and near the ends, in every
   loop, for small and for large speed errors (`analysis.margin_survey`, `analysis.resonance`). Points without steady
   motion have none.
4. The standard deviation of the tensions by noise of the sensors, from the Lyapunov equation of the closed loop at rest
   at mid-track: four of them below the least tension, so that noise makes no rope slack.
5. While one of these is violated, what violates it gives way to 70 %: for noise the bandwidth; for margins what
   oscillates there, by its frequency: far below the bandwidth (by LAG_RATIO) integral action; far above that of the
   drums on their ropes (by two) the damping of the drums, at first on ropes that are short for its lag, then everywhere
   with the bandwidth; otherwise the bandwidth.
6. A design that satisfies all is checked on further drawn machines where its margins are least. The machine furthest
   below a bound joins those of step 3 (a cutting set; Mutapcic and Boyd, Optim. Methods Softw. 24, 2009, 381).
7. Between the first design that satisfies all and the one before it, shares are bisected: the error falls with a high
   power of the bandwidth, so that a whole step is dear.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from dualwinch.analysis.describing_function import LARGEST_SPEED_ERROR
from dualwinch.analysis.linear_loop import fastest_growing, linear_closed_loop
from dualwinch.analysis.margin_survey import (
    UNSTABLE,
    UNSTEADY,
    Indices,
    MarginSurvey,
    WorstMargin,
    comparable_value,
)
from dualwinch.analysis.resonance import LARGE_SIGNAL, MARGIN_AMPLITUDES, RESONANCE
from dualwinch.analysis.stability import SLIDING_MODE
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.coordinations.proportional_tension import ProportionalTension
from dualwinch.controllers.estimators.calibrating_kalman import CalibratingKalman
from dualwinch.controllers.estimators.self_calibrating_kalman import SelfCalibratingKalman
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.presets.designed import (
    ALL,
    LAG_RATIO,
    BandwidthLimit,
    LoopTiming,
    Shares,
    bandwidth_limits,
    bandwidth_of,
    designed_controller,
)
from dualwinch.model.arguments import instance
from dualwinch.model.drum_on_rope import drum_frequency
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.properties import is_stable
from dualwinch.model.plant import sags
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.structure import parameters_of
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.scenario import Scenario

LEAST_MARGINS = {"disk": 0.4, "delay": 1e-3, RESONANCE: 1.0, LARGE_SIGNAL: 1.0}
"""Kind of margin → its bound: radius of the disk, delay in s, and factors on the loop gain at the drums' resonance."""

SIGMAS = 4.0
"""Standard deviations of a tension by noise that stay below the least tension: one sample in 16 000 is beyond."""

DRAWS = 3
"""Drawn machines on which a design is verified besides the nominal one."""

NOISE = "noise"
"""Name of the bound on the noise of the tensions."""

STEP, STEPS, BISECTIONS = 0.7, 10, 2
"""Factor by which a loop gives way, how often at most, and number of bisections of the last step."""


@dataclass(frozen=True)
class Design:
    """A controller designed for a machine, what limits its bandwidth, and its margins.

    Attributes:
        experiment: the machine with the controller.
        limits: bandwidths that properties of the machine allow, the smallest first.
        shares: what the verification left of bandwidth, damping and integral action.
        margins: kind → the smallest margin of the machines, index 0 the nominal one.
        bounds: kind → its bound.
        noise: standard deviation of a tension in N by noise of the sensors; infinite for an unstable loop.
        machines: number of machines on which margins are verified.
        unsteady: share of their operating points that have no steady motion with any gains, and no margins.
    """

    experiment: Experiment
    limits: tuple[BandwidthLimit, ...]
    shares: Shares
    margins: Mapping[str, WorstMargin]
    bounds: Mapping[str, float]
    noise: float
    machines: int
    unsteady: float

    @property
    def controller(self) -> Controller:
        """The controller."""
        return self.experiment.controller

    @property
    def bandwidth(self) -> float:
        """Bandwidth of the position loop in rad/s."""
        return bandwidth_of(self.limits, self.shares)

    @property
    def violations(self) -> tuple[str, ...]:
        """Kinds of margins below their bounds, and `NOISE`; empty for a verified design."""
        return tuple(kind for kind, share in self.kept_shares.items() if share < 1)

    @property
    def kept_shares(self) -> dict[str, float]:
        """Kind of margin, or `NOISE` → how much of its bound is kept; 1 or more: all of it."""
        shares = {kind: self.margins[kind].value / bound for kind, bound in self.bounds.items()}
        quiet = float(self.controller.limits.tension_min) / SIGMAS
        return shares | {NOISE: quiet / self.noise if self.noise else math.inf}

    def __str__(self) -> str:
        """The bandwidth, what limits it, and the margins, in five lines."""
        limit, *further_limits = self.limits
        timing = timing_of(self.experiment)
        lags = f"drive {1e3 * timing.drive:.3g} ms, load cell {1e3 * timing.load_cell:.3g} ms"
        samples = f"{1.5 + timing.delay_samples:g} samples {1e3 * timing.sampling:.3g} ms"
        shares = [f"{100 * share:.0f} % of the {what}" for what, share in self.shares.named.items() if share < 1]
        shares += ["damping on long ropes only"] if self.shares.fading else []
        margins = ", ".join(
            f"{kind.replace('_', ' ')} {_in_unit(kind, self.margins[kind].value)} (at least {_in_unit(kind, bound)})"
            for kind, bound in self.bounds.items()
        )
        unsteady = f"; no steady motion at {100 * self.unsteady:.0f} % of the points" if self.unsteady else ""
        below = f"; violated: {', '.join(self.violations)}" if self.violations else ""
        return "\n".join(
            (
                f"bandwidth {self.bandwidth:.3g} rad/s; the machine allows {limit}",
                f"beyond that: {', '.join(str(each) for each in further_limits)}",
                f"lag {1e3 * timing.lag:.3g} ms: {lags}, {samples}",
                f"margins and noise leave {', '.join(shares) or 'all of it'}; noise of a tension {self.noise:.3g} N",
                f"least margins of {self.machines} machine{'s' * (self.machines > 1)}: {margins}{below}{unsteady}",
            )
        )


def _in_unit(kind: str, margin: float) -> str:
    return f"{1e3 * margin:.3g} ms" if kind == "delay" else f"{margin:.3g}"


def timing_of(experiment: Experiment) -> LoopTiming:
    """Lags of the loop of an experiment."""
    values = leaves(experiment)
    return LoopTiming(
        drive=values.get("actuator.motor.time_constant", 0.0),
        load_cell=experiment.sensors.load_cell_time_constant,
        sample_time=experiment.simulation.sample_time,
        delay_samples=experiment.simulation.delay_samples,
    )


def with_designed_parts(experiment: Experiment) -> Experiment:
    """The experiment with the parts of a design in place of those that do not have its gains."""
    controller = experiment.controller
    values = leaves(controller)
    if not isinstance(controller.law, SLIDING_MODE):
        controller = replace(controller, law=FandoNftsm())
    sagging = sags(experiment.plant)
    if "kalman.bandwidth" not in values:  # only the self-calibrating filter knows sag
        controller = replace(controller, estimator=SelfCalibratingKalman() if sagging else CalibratingKalman())
    if "winch_1.damping" not in values or (sagging and not isinstance(controller.coordination, ProportionalTension)):
        controller = replace(controller, coordination=ProportionalTension())
    return replace(experiment, controller=controller)


def formula_design(experiment: Experiment, shares: Shares = ALL, kept: Collection[str] = ()) -> Experiment:
    """The experiment with the gains of the formulas, but for `kept` keys; its parts must have them."""
    controller = designed_controller(
        experiment.controller,
        experiment.plant,
        timing_of(experiment),
        largest_speed_error=LARGEST_SPEED_ERROR,
        position_noise=float(f"{experiment.sensors.position_deviation:.1g}"),
        speed_noise=experiment.sensors.speed_noise,
        shares=shares,
    )
    designed = replace(experiment, controller=controller)
    values = leaves(experiment)
    estimated = experiment.sensors.tension == "none"
    bandwidth = 1 / (LAG_RATIO * timing_of(experiment).lag) if estimated else 0.0
    designed = with_leaves(designed, {"controller.tension_observer.bandwidth": bandwidth})
    if "controller.kalman.speed_sensor" in values:
        designed = with_leaves(designed, {"controller.kalman.speed_sensor": experiment.sensors.speed != "none"})
    return with_leaves(designed, {key: values[key] for key in kept if key in values and key.startswith("controller.")})


def limits_of(experiment: Experiment, shares: Shares = ALL) -> tuple[BandwidthLimit, ...]:
    """The bandwidths that properties of an experiment's machine allow."""
    return bandwidth_limits(experiment.controller, experiment.plant, timing_of(experiment), shares)


def designed(
    machine: Experiment | Ensemble,
    *,
    kept: Collection[str] = (),
    bounds: Mapping[str, float] = LEAST_MARGINS,
    draws: int = DRAWS,
    seed: int = 0,
    checks: int = 0,
    compiled: bool = False,
) -> Design:
    """Design a controller for a machine by formulas, and verify it by its margins.

    See `analysis.design` for the steps and `controllers.presets.designed` for the formulas. The gains are a start for
    `tune`, stable and damped on any machine, not an optimum.

    Args:
        machine: an experiment, or an ensemble, from which further machines are drawn for the verification. Limits,
            preload and the nominal model stay as they are.
        kept: keys of gains that stay as they are.
        bounds: kind of margin (`analysis.margins.MARGIN_KINDS`, ``resonance``, ``large_signal``) → its least value.
        draws: number of drawn machines.
        checks: number of further drawn machines on which a design is checked.
        seed: of the draws.
        compiled: whether to compile the loop for its margins, which takes longer once.

    Returns:
        The design; `Design.violations` names margins below their bounds.

    Raises:
        ConfigurationError: no machine, or one whose values contradict each other.

    Example:
        >>> import dualwinch as dw
        >>> design = dw.designed(dw.case(4))
        >>> f"{design.bandwidth:.3g} rad/s"
        '71.1 rad/s'
    """
    if not isinstance(machine, Ensemble):
        instance("machine", machine, Experiment)
    base = machine.experiment if isinstance(machine, Ensemble) else machine
    base = formula_design(with_designed_parts(base), kept=kept)
    prepare(base)
    ensemble = machine if isinstance(machine, Ensemble) else None
    scenarios = replace(ensemble, experiment=base).chosen(range(draws + checks), seed) if ensemble else []
    machines: list[Experiment | Scenario] = [base, *scenarios]
    amplitudes = sorted({base.sensors.speed_noise, 0.01})
    names = [name for name in parameters_of(base) if name.startswith("controller.")]
    survey = MarginSurvey(machines, names, amplitudes=amplitudes, compiled=compiled)
    verified = set(range(1 + draws if ensemble else 1))

    def verify(shares: Shares) -> Design:
        """The design with some shares; machines on which it violates a bound join those that are verified."""
        experiment = formula_design(base, shares, kept)
        values = leaves(experiment)
        row = [values[name] for name in names]
        loops = np.flatnonzero([machine in verified for machine in survey.loops[:, 0].tolist()])
        at_loops = _LeastMargins.of(survey, row, bounds, loops)
        limits, noise = limits_of(experiment, shares), tension_noise(experiment)
        design = Design(experiment, limits, shares, at_loops.margins, bounds, noise, len(machines), at_loops.unsteady)
        if not design.violations and len(verified) < len(machines):
            loops = np.union1d(loops, survey.loops_at(at_loops.places))
            design = replace(design, margins=_LeastMargins.of(survey, row, bounds, loops).margins)
            verified.update(design.margins[kind].machine for kind in design.violations)
        return design

    design = verify(ALL)
    trials = [design]
    while design.violations and len(trials) < STEPS + design.shares.fading:  # which is no step of a share
        design = verify(_giving_way(design, machines))
        trials.append(design)
    if design.violations:
        return max(trials, key=lambda trial: min(trial.kept_shares.values()))
    violated = trials[-2].shares if len(trials) > 1 else design.shares
    for _ in range(BISECTIONS if violated.named != design.shares.named else 0):
        trial = verify(design.shares.towards(violated))
        if trial.violations:
            violated = trial.shares
        else:
            design = trial
    return design


@dataclass(frozen=True)
class _LeastMargins:
    """The least margins at some loops of a survey with steady motion.

    Attributes:
        margins: kind → the least margin; those by the drums' rule are of all machines.
        places: numbers of point and amplitude where the others occur.
        unsteady: share of the loops without steady motion.
    """

    margins: dict[str, WorstMargin]
    places: set[tuple[int, int]]
    unsteady: float

    @classmethod
    def of(cls, survey: MarginSurvey, row: Sequence[float], kinds: Collection[str], loops: Indices) -> "_LeastMargins":
        by_rule, of_loops = set(kinds) & MARGIN_AMPLITUDES.keys(), set(kinds) - MARGIN_AMPLITUDES.keys()
        (margins,), (smallest,) = survey.of_loops([row], of_loops, loops), survey.worst([row], by_rule, loops)
        steady = [number for number, each in enumerate(margins) if all(one.reason != UNSTEADY for one in each.values())]
        places = set[tuple[int, int]]()
        for kind in of_loops:
            worst_loop = min(steady or range(len(margins)), key=lambda number: comparable_value(margins[number][kind]))
            smallest[kind] = margins[worst_loop][kind]
            places.add(tuple(survey.loops[loops[worst_loop], 1:].tolist()))
        return cls(smallest, places, 1 - len(steady) / len(margins))


def tension_noise(experiment: Experiment) -> float:
    """Largest standard deviation of a tension in N by noise of the sensors, at rest at mid-track; infinite if unstable.

    Solves the Lyapunov equation of the sampled loop, with the observer's gain at small errors.
    """
    from scipy.linalg import solve_discrete_lyapunov

    sensors = experiment.sensors
    deviations = {
        "position_noise": sensors.position_deviation,
        "speed_noise": sensors.speed_noise,
        "tension_1_noise": sensors.tension_noise,
        "tension_2_noise": sensors.tension_noise,
    }
    try:
        loop = linear_closed_loop(experiment)
    except ConfigurationError:
        return math.inf  # no steady motion
    if not is_stable(loop):
        return math.inf
    scale = np.array([deviations.get(name, 0.0) for name in loop.inputs])
    rows = [loop.outputs.index(name) for name in ("F1", "F2")]
    into, out, direct = loop.B * scale, loop.C[rows], loop.D[rows] * scale
    covariance = out @ solve_discrete_lyapunov(loop.A, into @ into.T) @ out.T + direct @ direct.T
    return math.sqrt(max(0.0, *np.diag(covariance)))


def _giving_way(design: Design, machines: Sequence[Experiment | Scenario]) -> Shares:
    """The shares after one more step: what oscillates at the margin furthest below its bound gives way."""
    shares = design.shares
    kind = min((kind for kind in design.violations if kind != NOISE), key=design.kept_shares.__getitem__, default=NOISE)
    if kind == NOISE:
        return replace(shares, bandwidth=STEP * shares.bandwidth)
    frequency = _frequency(design, design.margins[kind], machines)
    plant, tension = design.experiment.plant, design.controller.limits.preload / 2
    length = plant.track.length / 2
    swing = max(float(drum_frequency(side, tension, length, plant.track)) for side in plant.sides)
    if frequency < design.bandwidth / LAG_RATIO:
        return replace(shares, integral=STEP * shares.integral)
    if frequency > 2 * swing and not shares.fading:
        return replace(shares, fading=True)
    if frequency > 2 * swing:
        return replace(shares, bandwidth=STEP * shares.bandwidth, damping=STEP * shares.damping)
    return replace(shares, bandwidth=STEP * shares.bandwidth)


def _frequency(design: Design, margin: WorstMargin, machines: Sequence[Experiment | Scenario]) -> float:
    """Angular frequency in rad/s of the oscillation at a margin; NaN if it is unknown."""
    if not margin.reason:
        return margin.frequency
    machine = machines[margin.machine]
    experiment = machine.experiment if isinstance(machine, Scenario) else machine
    if margin.reason == UNSTABLE:
        with suppress(ConfigurationError):
            loop = linear_closed_loop(replace(experiment, controller=design.controller), margin.x, margin.v)
            mode = fastest_growing(loop, experiment.plant)
            return math.nan if mode is None else mode.natural_frequency
    return math.nan
