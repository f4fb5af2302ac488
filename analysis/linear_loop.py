"""Exact linearisation of the sampled loop, closed or opened.

One sample of plant and controller maps state to state. Its Jacobian at an operating point describes the evolution of
deviations from steady motion. Rope lengths are frozen at the point, so that in motion the system is valid for
dynamics that are fast compared with length/v.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.differentiated_sample import DifferentiatedSample
from dualwinch.analysis.margins import BOTH
from dualwinch.analysis.operating_points import (
    LoopOperatingPoint,
    loop_operating_point,
    operating_point,
    with_taut_ropes,
)
from dualwinch.analysis.steady_motion import PLANT, neighbours, without_round_off
from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.linearisation import linearise_at
from dualwinch.model.linear.modes import Mode, modes
from dualwinch.model.linear.properties import is_stable, states_that_matter
from dualwinch.model.linear.system import LinearSystem
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark, unknown
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS, ClosedLoop, closed_loop, initial_loop_state
from dualwinch.simulation.loop.structure import LoopStructure, structure_of
from dualwinch.simulation.rows import COLUMNS

Floats = NDArray[np.float64]

INPUTS = {
    "reference.x": ("x_ref", "m"),
    "reference.v": ("v_ref", "m/s"),
    "reference.a": ("a_ref", "m/s^2"),
    "current": ("current", "m/s"),
    "normal_force_variation": ("normal_force_variation", "N"),
    "force": ("force", "N"),
    "noise.position": ("position_noise", "m"),
    "noise.speed": ("speed_noise", "m/s"),
    "noise.tension_1": ("tension_1_noise", "N"),
    "noise.tension_2": ("tension_2_noise", "N"),
}
"""Exogenous signal → its name and unit as an input of the closed loop."""

OPENED_SIGNALS = {**{name: (name,) for name in LOOP_OPENINGS}, BOTH: ("tau_1", "tau_2")}
"""Value of ``opening`` → the signals that are opened."""

OUTSIDE = ("current", "force", "tension_min", "tension_max")
"""Further arguments of `operating_point`."""

OUTPUTS = ("x", "v", "e", "F1", "F2", "u", "tau_1", "tau_2")
"""Columns of a result that are outputs of the closed loop, in addition to the controller's signals."""


def linearise(
    experiment: Experiment,
    x: float | None = None,
    v: float = 0.0,
    *,
    preload: float | None = None,
    dt: float | None = None,
    **outside: float,
) -> LinearSystem:
    """Linearise the plant without controller at an operating point (`model.linear.linearisation.linearise`).

    Args:
        experiment: source of the plant, and of preload and limits unless given.
        x: position in m; default: mid-track.
        v: speed in m/s.
        preload: sum of both tensions in N.
        dt: sample time in s of a discrete system with zero-order hold; None: continuous time.
        outside: ``current`` in m/s, ``force`` in N, ``tension_min`` and ``tension_max`` in N, as in `operating_point`.

    Raises:
        ConfigurationError: no such operating point, a slack rope, or a sample time that is not positive.

    Example:
        >>> import dualwinch as dw
        >>> system = dw.linearise(dw.case(4), x=25)
        >>> system.states
        ('x', 'v', 'theta_1', 'omega_1', 'theta_2', 'omega_2')
    """
    for name in outside.keys() - set(OUTSIDE):
        raise ConfigurationError(unknown("argument", name, OUTSIDE, "; the plant is that of the experiment"))
    point = operating_point(experiment, x, v, preload=preload, **outside)
    return linearise_at([point], experiment.plant, dt)[0]


def linear_closed_loop(experiment: Experiment, x: float | None = None, v: float = 0.0) -> LinearSystem:
    """Linearise the closed loop over one sample, around steady motion.

    The states are those of plant and controller that affect anything; see `INPUTS` and `OUTPUTS`. The matrices are
    exact Jacobians of the simulated step, with perfect sensors and without disturbances; noises are inputs. Constants
    of the machine that the estimator learns are held at their true values.

    Args:
        experiment: plant, gains, sample time and delay.
        x: position in m; default: mid-track.
        v: speed in m/s.

    Raises:
        ConfigurationError: no steady motion there (`analysis.operating_points.loop_operating_point`).

    Example:
        >>> import dualwinch as dw
        >>> loop = dw.linear_closed_loop(dw.case(4))
        >>> bool(abs(loop.poles()).max() < 1)
        True
    """
    point = loop_operating_point(experiment, x, v)
    loop = point.loop
    structure = with_taut_ropes(structure_of(point.experiment))
    outputs, state_indices = _outputs(loop), point.kept_states
    motions = state_indices[state_indices < loop.move.numel_in("motion")]
    sample = _closed_sample(structure, tuple(state_indices.tolist()))
    states = np.array([point.state, *neighbours(point.state)])
    motion_slopes, at_sample = sample(
        states, *(np.tile(vector, (len(states), 1)) for vector in (point.exogenous, point.parameters))
    )
    slopes = without_round_off(*np.concatenate([motion_slopes.slopes[:, motions], at_sample.slopes], axis=1))
    n = len(state_indices)
    matrices = slopes[:n, :n], slopes[:n, n:], slopes[n:, :n], slopes[n:, n:]
    units = {name: loop.quantities[name].unit for name in outputs} | dict(INPUTS.values())
    inputs = [name for name, _ in INPUTS.values()]
    return without_idle_states(_named(point, matrices, state_indices, inputs, outputs, units))


def linear_open_loop(
    experiment: Experiment, x: float | None = None, v: float = 0.0, opening: str = "u", nominal: Plant | None = None
) -> LinearSystem:
    """Linearise the loop opened at one signal, or at both torques: from the injected to minus the returned signal.

    The sign is that of negative feedback: closing the loop gives 1/(1 + L).

    Args:
        experiment: plant, gains, sample time and delay.
        x: position in m; default: mid-track.
        v: speed in m/s.
        opening: ``u``, the position law's force command; ``tau_1`` or ``tau_2``, a winch's torque; ``torques``, both.
        nominal: the plant the controller was designed for; default: the experiment's.

    Raises:
        ConfigurationError: an unknown opening, or no steady motion there.

    Example:
        >>> import dualwinch as dw
        >>> loop = dw.linear_open_loop(dw.case(4), opening="tau_1")
        >>> loop.inputs, loop.outputs, loop.dt
        (('tau_1_in',), ('tau_1_out',), 0.001)
    """
    return without_idle_states(whole_open_loop(experiment, x, v, opening, nominal))


def whole_open_loop(
    experiment: Experiment, x: float | None, v: float, opening: str, nominal: Plant | None = None
) -> LinearSystem:
    """`linear_open_loop` with all states, even those that affect nothing: the same states for all gains."""
    if opening not in OPENED_SIGNALS:
        raise ConfigurationError(unknown("opening", opening, OPENED_SIGNALS))
    return loop_opened_at(loop_operating_point(experiment, x, v, nominal), opening)


def loop_opened_at(point: LoopOperatingPoint, opening: str) -> LinearSystem:
    """`whole_open_loop` at an operating point that is already solved, for several openings of one loop."""
    (A,), (B,), (C,), (D,) = point.opened
    signals, all_openings = OPENED_SIGNALS[opening], list(LOOP_OPENINGS)
    here = [all_openings.index(signal) for signal in signals]
    closed_openings = [index for index in range(len(all_openings)) if index not in here]
    # close the other openings: their injected signal is the returned one
    closing = np.linalg.inv(np.eye(len(closed_openings)) - D[np.ix_(closed_openings, closed_openings)])
    through, direct = B[:, closed_openings] @ closing, D[here][:, closed_openings] @ closing
    matrices = (
        A + through @ C[closed_openings],
        B[:, here] + through @ D[closed_openings][:, here],
        -(C[here] + direct @ C[closed_openings]),
        -(D[here][:, here] + direct @ D[closed_openings][:, here]),
    )
    inputs, outputs = ([f"{signal}_{end}" for signal in signals] for end in ("in", "out"))
    unit = point.loop.quantities[LOOP_OPENINGS[signals[0]]].unit
    return _named(point, matrices, point.kept_states, inputs, outputs, dict.fromkeys([*inputs, *outputs], unit))


def closed(loop: LinearSystem) -> LinearSystem:
    """The closed loop 1/(1 + L) of an opened loop L from `linear_open_loop`, with the same names.

    Raises:
        numpy.linalg.LinAlgError: it is not well posed, as 1 + D is singular.
    """
    through = np.linalg.inv(np.eye(len(loop.D)) + loop.D)
    A, B = loop.A - loop.B @ through @ loop.C, loop.B @ through
    return replace(loop, A=A, B=B, C=through @ loop.C, D=loop.D @ through)


def fastest_growing(system: LinearSystem, plant: Plant) -> Mode | None:
    """The fastest growing mode of a system, named as in `model.linear.modes`; None: none grows."""
    if is_stable(system):
        return None
    growing = [mode for mode in modes(system, plant) if mode.grows]
    return max(growing, key=lambda mode: mode.rate.real, default=None)


def _outputs(loop: ClosedLoop) -> list[str]:
    """Columns of a result that are outputs of the closed loop."""
    return [*OUTPUTS, *(name for name in loop.columns if name not in COLUMNS)]


@built_once
def _closed_sample(structure: LoopStructure, kept: tuple[int, ...]) -> DifferentiatedSample:
    """A sample of the closed loop: the kept states a sample later and the outputs, by the kept states and inputs."""
    loop = closed_loop(structure)
    arguments = [ca.SX.sym(name, loop.sample.size1_in(name)) for name in loop.sample.name_in()]
    discrete, hold = loop.sample(*arguments)
    row, moving = loop.observe(*arguments), loop.move.numel_in("motion")
    values = [discrete[[index - moving for index in kept if index >= moving]]]
    values.append(row[[loop.columns.index(name) for name in _outputs(loop)]])
    results = ca.Function(
        "closed_sample", arguments, [ca.vertcat(*values), hold], loop.sample.name_in(), ["values", "hold"]
    )
    columns = [*(("state", index) for index in kept), *(("exogenous", loop.exogenous.index(name)) for name in INPUTS)]
    return DifferentiatedSample(loop, results, columns, compiled=False)


def _named(
    point: LoopOperatingPoint,
    matrices: tuple[Floats, Floats, Floats, Floats],
    states: NDArray[np.intp],
    inputs: Sequence[str],
    outputs: Sequence[str],
    units: Mapping[str, str],
) -> LinearSystem:
    """A named linear system of some of the closed loop's states."""
    every = state_names(point)
    names_and_units = [every[index] for index in states]
    return LinearSystem(
        *matrices,
        dt=point.experiment.simulation.sample_time,
        states=tuple(name for name, _ in names_and_units),
        inputs=tuple(inputs),
        outputs=tuple(outputs),
        units={**units, **dict(names_and_units)},
        operating_point={
            **point.row,
            "preload": point.experiment.controller.limits.preload,
            "residual": point.residual,
        },
    )


def without_idle_states(system: LinearSystem) -> LinearSystem:
    """The system without idle states, which no output depends on or which no input moves.

    A state that nothing moves, such as an integral without a gain, keeps its value at the operating point.
    """
    state_indices = np.flatnonzero(states_that_matter(system.A[None], system.B[None], system.C[None])[0])
    states = tuple(system.states[index] for index in state_indices)
    idle = set(system.states) - set(states)
    units = {name: unit for name, unit in system.units.items() if name not in idle - {*system.inputs, *system.outputs}}
    A, B, C = system.A[np.ix_(state_indices, state_indices)], system.B[state_indices], system.C[:, state_indices]
    return replace(system, A=A, B=B, C=C, states=states, units=units)


def state_names(point: LoopOperatingPoint) -> list[tuple[str, str]]:
    """Short name and unit of each state of the closed loop."""
    descriptions = describe_parts(initial_loop_state(structure_of(point.experiment)))
    names_and_units = []
    for state, name in zip(point.loop.states, _short_names(point.loop.states), strict=True):
        torque = state.startswith("queue.")
        names_and_units.append(
            (name, "N m" if torque else descriptions[state].quantity.unit if state in descriptions else "1")
        )
    return names_and_units


def learns(experiment: Experiment) -> bool:
    """Whether the estimator learns constants of the machine, which are held in the linearised loop."""
    return bool(closed_loop(structure_of(experiment)).marked(Mark.LEARNT).any())


def _short_names(states: Sequence[str]) -> list[str]:
    """Short names of states: without their prefix where that is unambiguous."""
    prefixes = (PLANT, "controller.law.", "controller.coordination.", "controller.", "")
    names = [state.removeprefix(next(filter(state.startswith, prefixes))) for state in states]
    count = Counter(names)
    return [
        name if count[name] == 1 or state.startswith(PLANT) else state.removeprefix("controller.")
        for state, name in zip(states, names, strict=True)
    ]
