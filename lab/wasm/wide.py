"""An experiment of the lab's structure: all that may be switched on is there, and a number says whether it is."""

from dataclasses import dataclass, replace

import casadi as ca

from dualwinch.codegen.sampled import Sampled
from dualwinch.model.actuators import Motor
from dualwinch.model.scalar import where
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import FORCE, ClosedLoop, closed_loop
from dualwinch.simulation.loop.structure import structure_of
from dualwinch.simulation.loop.zero_order_hold import named_function

DELAY = "simulation.delay_samples"
"""A number at run time here; elsewhere it shapes the code."""

LAG = "actuator.motor.time_constant"
"""May be 0 here: the motors are ideal."""

SHORTEST_LAG = 1e-15
"""Time constant in s of a motor without a lag: less than the round-off of its torque."""

QUEUE = ("queue.0.tau_1", "queue.0.tau_2")
"""States that hold the torques that arrive next."""


def wide(experiment: Experiment) -> Experiment:
    """The experiment with motors that lag, late torques, jitter and a position sensor that may fall silent.

    Where their numbers are 0 they change nothing.
    """
    return replace(
        experiment,
        actuator=Motor(),
        sensors=replace(experiment.sensors, outage="held", outage_length=1.0),
        simulation=replace(experiment.simulation, delay_samples=1, jitter=experiment.simulation.sample_time / 4),
    )


@dataclass(frozen=True)
class WideLoop(Sampled):
    """The closed loop of a wide experiment, whose last parameter is the number of samples by which torques are late.

    At 0 a torque arrives at once, at 1 it stands in the queue for a sample; more is the driver's to hold back.

    Attributes:
        closed: the closed loop it is made from.
    """

    closed: ClosedLoop

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return (*self.closed.parameters, DELAY)

    @property
    def queue(self) -> int:
        """Where in the state the first torque stands that arrives next; the other one follows."""
        return self.closed.states.index(QUEUE[0])


def wide_loop(experiment: Experiment) -> WideLoop:
    """The closed loop of an experiment that `wide` gave."""
    loop = closed_loop(structure_of(experiment), frozenset({FORCE}))
    sizes, states = loop.sizes, loop.states
    state, exogenous = ca.SX.sym("state", sizes["STATES"]), ca.SX.sym("exogenous", sizes["EXOGENOUS"])
    parameters = ca.SX.sym("parameters", sizes["PARAMETERS"] + 1)
    known, delay = parameters[:-1], parameters[-1]
    sent, _ = loop.sample(state, exogenous, known)
    arriving = {
        name: where(delay > 0, state[states.index(name)], sent[states.index(name) - sizes["MOTION"]]) for name in QUEUE
    }
    now = ca.vertcat(*(arriving.get(name, state[index]) for index, name in enumerate(states)))
    inputs = {"state": state, "exogenous": exogenous, "parameters": parameters}
    discrete, hold = loop.sample(now, exogenous, known)
    return WideLoop(
        sample=named_function("sample", inputs, {"discrete": discrete, "hold": hold}),
        observe=named_function("observe", inputs, {"row": loop.observe(now, exogenous, known)}),
        move=_with_delay(loop.move, parameters),
        parts=loop.parts,
        one_step=_with_delay(loop.one_step, parameters) if loop.one_step else None,
        closed=loop,
    )


def _with_delay(function: ca.Function, parameters: ca.SX) -> ca.Function:
    """The function of the longer vector of parameters."""
    inputs = {
        name: parameters if name == "parameters" else ca.SX.sym(name, function.size1_in(name))
        for name in function.name_in()
    }
    given = [parameters[:-1] if name == "parameters" else symbol for name, symbol in inputs.items()]
    return named_function(function.name(), inputs, dict(zip(function.name_out(), function.call(given), strict=True)))
