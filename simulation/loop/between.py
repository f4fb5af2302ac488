"""What happens between two samples: the plant moves on, under what is held."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

import casadi as ca

from dualwinch.codegen.source.expressions import as_written
from dualwinch.model.disturbance import Disturbance
from dualwinch.model.plant import Environment, Plant, PlantState, Torques
from dualwinch.model.quantity import Quantity
from dualwinch.model.scalar import Scalar, minimum
from dualwinch.model.tree import leaves, with_leaves
from dualwinch.simulation.integrators import INTEGRATORS, Motion, Problem
from dualwinch.simulation.loop.structure import Structure


@dataclass(frozen=True)
class Held:
    """What acts on the plant between two samples: it is held."""

    t: Annotated[Scalar, Quantity("s", "time of the sample's beginning")]
    torques: Torques
    current: Annotated[Scalar, Quantity("m/s", "ambient current along the track")]
    normal_force_variation: Annotated[Scalar, Quantity("N", "change of the force on the rail")]
    force: Annotated[Scalar, Quantity("N", "force on the vehicle along the track, beside the vortex force")]


def problem_of(held: Held, duration: Scalar, plant: Plant, disturbance: Disturbance) -> Problem:
    """What an integrator has to solve from one sample to the next, `duration` s later."""
    return Problem(
        t=held.t,
        duration=duration,
        torques=held.torques,
        environment=Environment(held.force, held.current, held.normal_force_variation),
        disturbance=disturbance,
        plant=plant,
    )


NOTHING_MOVES = Motion(PlantState(*[0.0] * 6))
NOTHING_HELD = Held(0.0, Torques(0.0, 0.0), 0.0, 0.0, 0.0)


def between_samples(
    structure: Structure, problem: Callable[[Held], Problem], parameters: ca.SX
) -> tuple[ca.Function, ca.Function | None]:
    """The functions ``move`` and ``leap`` of `codegen.sampled.Sampled`; no leap where the integrator has none.

    Their `margin` in m is the distance of the next position to the nearer end of the track, with the overrun.

    Args:
        structure: integrator and number of sub-steps.
        problem: gives what is solved, from what is held.
        parameters: symbols in it that are parameters.
    """
    motion, given = ca.SX.sym("motion", len(leaves(NOTHING_MOVES))), ca.SX.sym("held", len(leaves(NOTHING_HELD)))
    part = ca.SX.sym("part")
    start = _with_elements(NOTHING_MOVES, motion)
    solved = problem(_with_elements(NOTHING_HELD, given))
    track, overrun = solved.plant.track, solved.plant.track.rope_offset / 2

    def function(name: str, inputs: dict[str, ca.SX], moved: Motion, **more: ca.SX) -> ca.Function:
        x = moved.plant.x
        margin = minimum(x + overrun, track.length + overrun - x)
        outputs = {"next_motion": ca.vertcat(*leaves(moved).values()), "margin": margin} | more
        inputs = {"motion": motion, "held": given} | inputs
        return named_function(name, inputs, outputs)

    integrator, h = INTEGRATORS[structure.integrator], solved.duration / structure.substeps
    careful = integrator.substep(solved, start, solved.t + part * h, h)
    move = function("move", {"part": part, "parameters": parameters}, careful)
    if not integrator.leap:
        return move, None
    quick, valid = integrator.leap(solved, start)
    return move, function("leap", {"parameters": parameters}, quick, valid=valid)


def _with_elements(group: Any, vector: ca.SX) -> Any:
    return with_leaves(group, dict(zip(leaves(group), ca.vertsplit(vector), strict=True)))


def named_function(name: str, inputs: dict[str, ca.SX], outputs: dict[str, ca.SX]) -> ca.Function:
    """A CasADi function of named inputs and outputs, common subexpressions merged."""
    with as_written():
        return ca.Function(
            name, list(inputs.values()), list(outputs.values()), list(inputs), list(outputs), {"cse": True}
        )
