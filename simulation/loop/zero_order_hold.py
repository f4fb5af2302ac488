"""Between two samples: the plant moves on under a zero-order hold."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import casadi as ca

from dualwinch.codegen.source.expressions import as_written
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import DisturbanceInputs, Plant, Torques, blank_state
from dualwinch.model.quantities.quantity import Quantity
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.scalar import Scalar, minimum
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem


@dataclass(frozen=True)
class ZeroOrderHold:
    """What acts on the plant from one sample to the next, constant in between."""

    t: Annotated[Scalar, Quantity("s", "time of the sample's beginning")]
    torques: Torques
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")]
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")]
    force: Annotated[Scalar, Quantity("N", "force on the vehicle along the track, beside the vortex force")]


@dataclass(frozen=True)
class JitteringHold(ZeroOrderHold):
    """The same where samples are early or late."""

    duration: Annotated[Scalar, Quantity("s", "time until the next sample")] = 0.0


def zero_order_hold(structure: Experiment, *, duration: Scalar, **held: Any) -> ZeroOrderHold:
    """What is held until the next sample; how long, only where that is not always the same."""
    return JitteringHold(**held, duration=duration) if structure.simulation.jitter > 0 else ZeroOrderHold(**held)


def problem_of(hold: ZeroOrderHold, duration: Scalar, plant: Plant, disturbance: Disturbance) -> Problem:
    """What an integrator has to solve from one sample to the next, `duration` s later where the hold says nothing."""
    return Problem(
        t=hold.t,
        duration=hold.duration if isinstance(hold, JitteringHold) else duration,
        torques=hold.torques,
        environment=DisturbanceInputs(hold.force, hold.current, hold.normal_force_variation),
        disturbance=disturbance,
        plant=plant,
    )


def motion_template(structure: Experiment) -> Motion:
    """What names the elements of the plant's vector; its numbers mean nothing."""
    return Motion(blank_state(structure.plant))


def hold_template(structure: Experiment) -> ZeroOrderHold:
    """What names the elements of a hold; its numbers mean nothing."""
    others = dict.fromkeys(("t", "current", "normal_force_variation", "force"), 0.0)
    return zero_order_hold(structure, duration=0.0, torques=Torques(0.0, 0.0), **others)


def between_samples(
    structure: Experiment, problem: Callable[[ZeroOrderHold], Problem], parameters: ca.SX
) -> tuple[ca.Function, ca.Function | None]:
    """The functions ``move`` and ``one_step`` of `codegen.sampled.Sampled`, the latter None where there is none.

    Their `margin` in m is the distance of the next position to the nearer end of the track, with the overrun.

    Args:
        structure: integrator and number of sub-steps.
        problem: gives what is solved, from the zero-order hold.
        parameters: symbols in it that are parameters.
    """
    template, still = hold_template(structure), motion_template(structure)
    motion, hold = ca.SX.sym("motion", len(leaves(still))), ca.SX.sym("hold", len(leaves(template)))
    part = ca.SX.sym("part")
    start = _with_elements(still, motion)
    solved = problem(_with_elements(template, hold))
    track, overrun = solved.plant.track, solved.plant.track.rope_offset / 2

    def function(name: str, inputs: dict[str, ca.SX], moved: Motion, **more: ca.SX) -> ca.Function:
        x = moved.plant.x
        margin = minimum(x + overrun, track.length + overrun - x)
        outputs = {"next_motion": ca.vertcat(*leaves(moved).values()), "margin": margin} | more
        inputs = {"motion": motion, "hold": hold} | inputs
        return named_function(name, inputs, outputs)

    integrator, h = INTEGRATORS[structure.simulation.integrator], solved.duration / structure.simulation.substeps
    careful = integrator.substep(solved, start, solved.t + part * h, h)
    move = function("move", {"part": part, "parameters": parameters}, careful)
    if not integrator.one_step:
        return move, None
    quick, valid = integrator.one_step(solved, start)
    return move, function("one_step", {"parameters": parameters}, quick, valid=valid)


def _with_elements(group: Any, vector: ca.SX) -> Any:
    return with_leaves(group, dict(zip(leaves(group), ca.vertsplit(vector), strict=True)))


def named_function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """A CasADi function of named inputs and outputs, common subexpressions merged."""
    with as_written():
        return ca.Function(
            name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs), {"cse": True}
        )
