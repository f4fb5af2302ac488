"""The sampled closed loop of plant and controller as one symbolic step, with a zero-order hold between samples."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.errors import DualwinchError
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.expressions import as_written, built_once, with_fixed
from dualwinch.controllers.controller import (
    Controller,
    ControllerOutput,
    ControllerState,
    controller_step,
    initial_controller_state,
)
from dualwinch.model.actuators import NoState, drive, is_ideal
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.motions import no_departures, previewed
from dualwinch.model.overloads import loaded_vehicle, push_force, remaining_torque
from dualwinch.model.plant import (
    DisturbanceInputs,
    Plant,
    Torques,
    holding_torques,
    resting_state,
    shaft_torques,
    tensions,
)
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark, Quantity
from dualwinch.model.quantities.tree import leaves, symbols, with_leaves
from dualwinch.model.reference import Setpoint
from dualwinch.model.scalar import Scalar, absolute, minimum, quantise
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem
from dualwinch.simulation.loop.structure import LoopStructure, structure_of, symbolic_parts
from dualwinch.simulation.metrics.metric import states_after, states_before
from dualwinch.simulation.metrics.metrics import Accumulators, accumulate
from dualwinch.simulation.rows import COLUMNS, Sample, row_of
from dualwinch.simulation.sensors import Noise, Readings, first_readings, measure, silence_of


@dataclass(frozen=True, eq=False)
class ClosedLoop(Sampled):
    """The closed loop as named CasADi functions, and the names of the elements of their vectors.

    At a sample the controller runs and the sums behind the figures of merit are updated; the plant then moves until
    the next sample. `margin` in m is the distance of the next position to the nearer end of the track.

    Attributes:
        states, exogenous, parameters: names of the elements of those vectors.
        marks: state → its marks.
        quantities: quantity of each element of a row, by name: the columns of a result.
    """

    states: tuple[str, ...]
    exogenous: tuple[str, ...]
    parameters: tuple[str, ...]
    marks: Mapping[str, frozenset[Mark]]
    quantities: Mapping[str, Quantity]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the elements of a row."""
        return tuple(self.quantities)

    def vector(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """(parameters,) vector for the compiled code, from numbers by name as `structure.parameters_of` returns them.

        Raises:
            DualwinchError: the names are not the parameters of this closed loop.
        """
        if tuple(values) != self.parameters:
            odd = ", ".join(sorted(set(values) ^ set(self.parameters))) or "their order"
            raise DualwinchError(f"these are not the parameters of this closed loop; what differs: {odd}")
        return np.array(list(values.values()), float)

    def marked(self, *marks: Mark) -> NDArray[np.bool_]:
        """(states,) whether a state has any of these marks."""
        return np.array([not self.marks[name].isdisjoint(marks) for name in self.states])

    @property
    def step(self) -> ca.Function:
        """``step(state, exogenous, parameters) -> (next_state, row, margin)`` over one sample."""
        return _whole_step(self)


@built_once
def _whole_step(loop: Sampled) -> ca.Function:
    arguments = [ca.SX.sym(name, loop.sample.size1_in(name)) for name in loop.sample.name_in()]
    discrete, hold, *_ = loop.sample(*arguments)
    start = arguments[0][: loop.move.numel_in("motion")]
    motion, margin = start, ca.SX(0)
    for part in range(loop.parts):
        motion, margin = loop.move(motion, hold, part, arguments[2])
    if loop.one_step:
        end, moved_margin, valid = loop.one_step(start, hold, arguments[2])
        motion = ca.if_else(valid > 0, end, motion)
        margin = ca.if_else(valid > 0, moved_margin, margin)
    outputs = [ca.vertcat(motion, discrete), loop.observe(*arguments), margin]
    names = loop.sample.name_in(), ["next_state", "row", "margin"]
    return ca.Function("step", arguments, outputs, *names, {"cse": True})


LOOP_OPENINGS = {"u": "u_sat", "tau_1": "tau_1", "tau_2": "tau_2"}
"""Signals at which the loop can be opened for analysis → the column that returns to the opening."""


@dataclass(frozen=True)
class Exogenous:
    """Exogenous signals of one sample."""

    reference: Setpoint
    noise: Noise = field(default_factory=Noise)
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0
    force: Annotated[Scalar, Quantity("N", "force on the vehicle along the track")] = 0.0
    steady: Annotated[Scalar, Quantity("1", "1 in the steady-state window")] = 0.0
    ahead: Any = field(default_factory=NoState)


def zero_exogenous(controller: Controller) -> Exogenous:
    """Exogenous signals of one sample under a controller, all zero."""
    times, standstill = controller.preview, Setpoint(0.0, 0.0, 0.0)
    return Exogenous(standstill, ahead=no_departures(times)) if times else Exogenous(standstill)


def exogenous_names(controller: Controller) -> tuple[str, ...]:
    """Names of the exogenous signals of one sample under a controller."""
    return tuple(leaves(zero_exogenous(controller)))


FORCE, DRIFT, SILENT, LATENESS = "force", "noise.drift", "noise.silent", "noise.lateness"
"""Rarely used signals: where they are zero, code without them is compiled."""


def absent_signals(*experiments: Experiment, varying: Collection[str] = ()) -> frozenset[str]:
    """Exogenous signals that are always zero in all these experiments, so that their terms can be left out.

    The values of `varying` keys may differ elsewhere.
    """
    present = {
        FORCE: any(experiment.disturbance.force.given for experiment in experiments)
        or any(key.startswith("disturbance.force.") for key in varying),
        DRIFT: any(experiment.sensors.position_drift > 0 for experiment in experiments)
        or "sensors.position_drift" in varying,
        SILENT: any(silence_of(experiment.sensors) for experiment in experiments),
        LATENESS: any(experiment.simulation.jitter > 0 for experiment in experiments),
    }
    return frozenset(name for name, is_present in present.items() if not is_present)


@dataclass(frozen=True)
class LoopState:
    """State of the closed loop between two samples."""

    motion: Motion
    controller: ControllerState
    readings: Any = field(default_factory=Readings)
    actuator_1: Any = field(default_factory=NoState)
    actuator_2: Any = field(default_factory=NoState)
    timing: Any = field(default_factory=NoState)
    sample: Annotated[Scalar, Quantity("1", "number of the sample"), Mark.BOOKKEEPING] = 0.0


@dataclass(frozen=True)
class Timing:
    """Timing of samples with jitter."""

    lateness: Annotated[Scalar, Quantity("s", "time by which the sample is late"), Mark.BOOKKEEPING] = 0.0


def initial_loop_state(structure: LoopStructure, parts: Any = None, x: Scalar = 0.0) -> LoopState:
    """Plant, controller, sensors and actuators before the first sample, where the position sensor reads x in m.

    Numbers are those of `parts`, an experiment or `symbolic_parts`; without them only names and types have a meaning.
    """
    parts = parts or structure
    preload, actuator, sensors = parts.controller.limits.preload, parts.actuator, parts.sensors
    resting = resting_state(preload, parts.plant, x - sensors.position_bias)
    holding = holding_torques(preload, parts.plant)
    return LoopState(
        motion=Motion(resting),
        controller=initial_controller_state(parts.controller, x),
        readings=first_readings(resting, preload / 2, parts.plant, sensors, silence_of(structure.sensors)),
        timing=Timing() if structure.jitter else NoState(),
        actuator_1=actuator.holding_state(holding.tau_1),
        actuator_2=actuator.holding_state(holding.tau_2),
    )


def _queue_names(delay_samples: int) -> list[str]:
    return [f"queue.{sample}.{name}" for sample in range(delay_samples) for name in ("tau_1", "tau_2")]


def starting_state(structure: LoopStructure, parts: Any = None, x: Scalar = 0.0) -> dict[str, Scalar]:
    """Initial state by name: at rest, both ropes at preload/2, equilibrium torques in the delay queue.

    Arguments as for `initial_loop_state`.
    """
    start, parts = initial_loop_state(structure, parts, x), parts or structure
    holding = leaves(holding_torques(parts.controller.limits.preload, parts.plant))
    queue = {name: holding[name.rsplit(".", 1)[1]] for name in _queue_names(structure.delay_samples)}
    return leaves(start) | queue | leaves(Accumulators(), "metrics.") | states_before(parts.metrics)


def initial_state_of(experiment: Experiment) -> dict[str, float]:
    """`starting_state` of an experiment as floats, at the beginning of its reference."""
    start = starting_state(structure_of(experiment), experiment, experiment.reference.start)
    return {key: float(value) for key, value in start.items()}


def _metric_sample(
    row: Mapping[str, tuple[Scalar, Quantity]],
    torques: Torques,
    plant: Plant,
    output: ControllerOutput,
    *,
    number: Scalar,
    steady: Scalar,
) -> Sample:
    """The signals of a sample from which figures of merit are computed."""
    columns = {name: value for name, (value, _) in row.items()}
    power_1 = plant.winch_1.gear_ratio * torques.tau_1 * columns["omega_1"]
    power_2 = plant.winch_2.gear_ratio * torques.tau_2 * columns["omega_2"]
    return Sample(
        **{name: columns[name] for name in COLUMNS},
        number=number,
        torque_1=torques.tau_1,
        torque_2=torques.tau_2,
        power=absolute(power_1) + absolute(power_2),
        saturated=output.saturated,
        torque_saturated=output.winches.torque_saturated,
        steady=steady,
        signals={name: value for name, value in columns.items() if name not in COLUMNS},
    )


def _instant(
    state: LoopState, exogenous: Exogenous, sample_time: Scalar, jitter: Scalar
) -> tuple[Scalar, Scalar, Setpoint, Any]:
    """Time of a sample and time to the next in s, the setpoint at that time, and the next sample's timing state.

    The controller knows only the setpoint of a punctual sample.
    """
    t = state.sample * sample_time
    if not isinstance(state.timing, Timing):
        return t, sample_time, exogenous.reference, state.timing
    lateness, following = state.timing.lateness, jitter * exogenous.noise.lateness
    return t + lateness, sample_time + (following - lateness), exogenous.reference.ahead(lateness), Timing(following)


@built_once
def closed_loop(
    structure: LoopStructure, zeros: frozenset[str] = frozenset(), openings: tuple[str, ...] = ()
) -> ClosedLoop:
    """Build the symbolic functions of a structure (cached).

    Parameters (`structure.zeros_of`) and signals (`absent_signals`) in `zeros` are always zero: the functions leave out
    their terms and ignore their values.

    At the `openings`, some of F1, F2, u, tau_1 and tau_2, each computed from those before it, the loop is opened for
    analysis: the signals injected there become a fourth input, ``injected``, of `sample`, `observe` and `step`, and the
    returned signals a further output, ``returned``, of `sample`.
    """
    silence, zero_signals = silence_of(structure.sensors), zero_exogenous(structure.controller)
    queued = _queue_names(structure.delay_samples)
    vectors = {
        "state": tuple(starting_state(structure)),
        "exogenous": tuple(leaves(zero_signals)),
        "parameters": tuple(structure.parameters),
    }
    vector_symbols = {name: ca.SX.sym(name, len(names)) for name, names in vectors.items()}
    injected = {opening: ca.SX.sym(opening) for opening in openings}
    of_state, outside, values = (
        dict(zip(names, ca.vertsplit(vector_symbols[name]), strict=True)) for name, names in vectors.items()
    )
    outside |= {name: ca.SX(0) for name in zeros & outside.keys()}
    if openings:
        vector_symbols["injected"] = ca.vertcat(*injected.values())
    values |= dict.fromkeys(zeros, ca.SX(0))
    parts = symbolic_parts(structure, values)
    plant, sensors, actuator = parts.plant, parts.sensors, parts.actuator
    nominal = with_leaves(structure.nominal, values, "nominal.")
    sample_time = values["simulation.sample_time"]
    start = initial_loop_state(structure)
    state, exogenous = with_leaves(start, of_state), with_leaves(zero_signals, outside)
    plant_state = state.motion.plant

    # at the sample: sense and control
    t, duration, reference, timing = _instant(state, exogenous, sample_time, values["simulation.jitter"])
    pulls = dict(zip(("F1", "F2"), tensions(plant_state, plant, t), strict=True))
    forces = injected.get("F1", pulls["F1"]), injected.get("F2", pulls["F2"])
    readings, measurement = measure(
        plant_state, forces, exogenous.noise, state.readings, plant, sensors, sample_time, silence, state.sample
    )
    controller_state, output = controller_step(
        state.controller,
        measurement,
        previewed(exogenous.reference, structure.controller.preview, exogenous.ahead),
        parts.controller,
        nominal,
        sample_time,
        shared_force=injected.get("u"),
    )

    # until the next sample: the plant moves under the motors' torques, which follow the commands that arrive
    winches = output.winches
    sent = injected.get("tau_1", winches.tau_1), injected.get("tau_2", winches.tau_2)
    queue = [*(of_state[name] for name in queued), *sent]
    rounded = (quantise(torque, values["simulation.torque_step"]) for torque in queue[:2])
    arriving = remaining_torques(t, Torques(*rounded), parts.disturbance)
    actuators, torques = drive(
        (state.actuator_1, state.actuator_2), arriving, plant_state, plant, actuator, sample_time
    )
    hold = zero_order_hold(
        structure,
        t=t,
        torques=shaft_torques(torques, plant_state, plant, duration / 2),
        current=exogenous.current,
        normal_force_variation=exogenous.normal_force_variation,
        force=exogenous.force,
        duration=duration,
    )

    def problem(hold: ZeroOrderHold) -> Problem:
        if FORCE in zeros:
            hold = replace(hold, force=0.0)
        return problem_of(hold, sample_time, plant, parts.disturbance)

    posed = problem(hold)
    row = row_of(
        t=hold.t,
        state=plant_state,
        forces=forces,
        reference=reference,
        bias=sensors.position_bias,
        output=output,
        environment=posed.environment_at(hold.t, plant_state.v, state.motion.phase),
        plant=posed.plant,
        nominal=nominal,
        torques=None if is_ideal(actuator) else hold.torques,
        measurement=measurement if structure.readings else None,
    )
    sample = _metric_sample(row, hold.torques, plant, output, number=state.sample, steady=exogenous.steady)
    sums = leaves(accumulate(with_leaves(Accumulators(), of_state, "metrics."), sample, sample_time), "metrics.")
    sums |= states_after(parts.metrics, of_state, sample, sample_time)
    following = leaves(LoopState(state.motion, controller_state, readings, *actuators, timing, state.sample + 1))
    following |= dict(zip(queued, queue[2:], strict=True)) | sums
    discrete = [following[name] for name in vectors["state"][len(leaves(state.motion)) :]]
    at_sample = {"discrete": ca.vertcat(*discrete), "hold": ca.vertcat(*leaves(hold).values())}
    if openings:
        returned = pulls | {"u": output.position.u_sat, "tau_1": winches.tau_1, "tau_2": winches.tau_2}
        at_sample["returned"] = ca.vertcat(*(returned[opening] for opening in openings))
    marks = {name: leaf.marks for name, leaf in describe_parts(start).items()}
    marks |= dict.fromkeys(sums, frozenset({Mark.BOOKKEEPING}))  # nothing depends on them
    move, one_step = between_samples(structure, problem, vector_symbols["parameters"])
    sample_function = named_function("sample", vector_symbols, at_sample)
    phase, interval = _schedule(structure.controller, vectors["state"], marks)
    return ClosedLoop(
        sample=sample_function,
        observe=named_function("observe", vector_symbols, {"row": ca.vertcat(*(value for value, _ in row.values()))}),
        move=move,
        parts=structure.substeps,
        one_step=one_step,
        fast_sample=_fast_sample(sample_function, phase) if interval > 1 else None,
        phase=phase,
        states=vectors["state"],
        exogenous=vectors["exogenous"],
        parameters=vectors["parameters"],
        marks={name: marks.get(name, frozenset()) for name in vectors["state"]},
        quantities={name: quantity for name, (_, quantity) in row.items()},
    )


def _schedule(controller: Controller, states: Sequence[str], marks: Mapping[str, frozenset[Mark]]) -> tuple[int, int]:
    """Index of the state that is the phase of a controller's slow part, and its interval in samples; 0, 1 without."""
    phases = [index for index, name in enumerate(states) if Mark.PHASE in marks.get(name, ())]
    described, values = describe_parts(controller), leaves(controller)
    intervals = [int(values[key]) for key, leaf in described.items() if Mark.INTERVAL in leaf.marks]
    return (phases[0], intervals[0]) if len(phases) == len(intervals) == 1 else (0, 1)


def _fast_sample(sample: ca.Function, phase: int) -> ca.Function:
    """`sample` without the code that runs only where the state `phase` is 0; the phase itself goes on."""
    inputs, outputs = with_fixed(sample, "state", phase, 1.0)
    number = phase - (sample.numel_in("state") - sample.numel_out("discrete"))
    with as_written():
        outputs[0][number] = sample.call(inputs)[0][number]
    names_in, names_out = sample.name_in(), sample.name_out()
    return named_function(
        "fast_sample", dict(zip(names_in, inputs, strict=True)), dict(zip(names_out, outputs, strict=True))
    )


Floats = NDArray[np.float64]


@built_once
def start_function(structure: LoopStructure) -> ca.Function:
    """``start(parameters, x) -> state`` of a structure: `starting_state` as a CasADi function; (states,)."""
    parameters, x, state = _start(structure, steps=True)
    return ca.Function("start", [parameters, x], [state], ["parameters", "x"], ["state"])


def starts(structure: LoopStructure, vectors: Floats, x: float | Floats) -> Floats:
    """Initial states (runs, states) for parameter vectors (runs, parameters).

    Each run begins at its x in m: (runs,), or one value for all.
    """
    function, positions = _mapped(structure, len(vectors)), np.full(len(vectors), x, float)
    states = np.empty((len(vectors), function.size1_out(0)))
    buffer, evaluate = function.buffer()  # converting arrays would take CasADi longer than evaluating
    buffer.set_arg(0, np.ascontiguousarray(vectors).reshape(-1).data)  # pyright: ignore[reportCallIssue]
    buffer.set_arg(1, positions.data)  # pyright: ignore[reportCallIssue]
    buffer.set_res(0, states.reshape(-1).data)  # pyright: ignore[reportCallIssue]
    evaluate()
    return states


@built_once
def _mapped(structure: LoopStructure, count: int) -> ca.Function:
    return start_function(structure).map(count)


@built_once
def start_slopes(structure: LoopStructure) -> ca.Function:
    """``start_slopes(parameters, x)``, (states, parameters): Jacobian of the initial state, without quantisation."""
    parameters, x, state = _start(structure, steps=False)
    return ca.Function("start_slopes", [parameters, x], [ca.densify(ca.jacobian(state, parameters))])


def _start(structure: LoopStructure, *, steps: bool) -> tuple[ca.SX, ca.SX, ca.SX]:
    x, values = ca.SX.sym("x"), {name: ca.SX.sym(name) for name in structure.parameters}
    stepless = {} if steps else {"sensors.encoder_counts": 0, "sensors.position_resolution": 0.0}
    state = starting_state(structure, symbolic_parts(structure, {**values, **stepless}), x)
    return ca.vertcat(*values.values()), x, ca.densify(ca.vertcat(*state.values()))


@dataclass(frozen=True)
class ZeroOrderHold:
    """Inputs of the plant, held constant from one sample to the next."""

    t: Annotated[Scalar, Quantity("s", "time of the sample's beginning")] = 0.0
    torques: Torques = field(default_factory=Torques)
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")] = 0.0
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")] = 0.0
    force: Annotated[Scalar, Quantity("N", "force on the vehicle along the track, beside the vortex force")] = 0.0


@dataclass(frozen=True)
class JitteringHold(ZeroOrderHold):
    """Zero-order hold of a duration that varies by jitter."""

    duration: Annotated[Scalar, Quantity("s", "time until the next sample")] = 0.0


def zero_order_hold(structure: LoopStructure, *, duration: Scalar = 0.0, **inputs: Any) -> ZeroOrderHold:
    """The inputs held until the next sample, by default zero; includes the duration only if it varies."""
    return JitteringHold(**inputs, duration=duration) if structure.jitter else ZeroOrderHold(**inputs)


def problem_of(hold: ZeroOrderHold, duration: Scalar, plant: Plant, disturbance: Disturbance) -> Problem:
    """The integration problem from one sample to the next, `duration` s later unless the hold gives its own.

    The force includes that of a push, the vehicle its payload.
    """
    force = hold.force + push_force(hold.t, disturbance.push)
    return Problem(
        t=hold.t,
        duration=hold.duration if isinstance(hold, JitteringHold) else duration,
        torques=hold.torques,
        environment=DisturbanceInputs(force, hold.current, hold.normal_force_variation),
        disturbance=disturbance,
        plant=replace(plant, vehicle=loaded_vehicle(hold.t, plant.vehicle, disturbance.payload)),
    )


def remaining_torques(t: Scalar, torques: Torques, disturbance: Disturbance) -> Torques:
    """Torque commands in N m that dropouts of the drives leave at a time in s."""
    return Torques(
        remaining_torque(t, torques.tau_1, disturbance.dropout_1),
        remaining_torque(t, torques.tau_2, disturbance.dropout_2),
    )


def between_samples(
    structure: LoopStructure, problem: Callable[[ZeroOrderHold], Problem], parameters: ca.SX
) -> tuple[ca.Function, ca.Function | None]:
    """The functions ``move`` and ``one_step`` of `codegen.sampled.Sampled`; the latter may be None.

    Their `margin` in m is the distance of the next position to the nearer end of the track, overrun included. The
    structure gives integrator and sub-steps, `problem` the integration problem of a zero-order hold.
    """
    start, motion = symbols(structure.motion, "motion")
    inputs_held, hold = symbols(zero_order_hold(structure), "hold")
    part, solved = ca.SX.sym("part"), problem(inputs_held)
    track, overrun = solved.plant.track, solved.plant.track.rope_offset / 2

    def function(name: str, inputs: dict[str, ca.SX], moved: Motion, **more: ca.SX) -> ca.Function:
        x = moved.plant.x
        margin = minimum(x + overrun, track.length + overrun - x)
        outputs = {"next_motion": ca.vertcat(*leaves(moved).values()), "margin": margin} | more
        inputs = {"motion": motion, "hold": hold} | inputs
        return named_function(name, inputs, outputs)

    integrator, h = INTEGRATORS[structure.integrator], solved.duration / structure.substeps
    substep = integrator.substep(solved, start, solved.t + part * h, h)
    move = function("move", {"part": part, "parameters": parameters}, substep)
    if not integrator.one_step:
        return move, None
    single_step, valid = integrator.one_step(solved, start)
    return move, function("one_step", {"parameters": parameters}, single_step, valid=valid)


def named_function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """A CasADi function with named inputs and outputs, common subexpressions merged."""
    with as_written():
        return ca.Function(
            name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs), {"cse": True}
        )
