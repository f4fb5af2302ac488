"""One sample of the loop cut open at all joints at once, with its exact derivatives, compiled for many points.

What leaves the joints are inputs and what comes back to them are outputs: closing all but one gives the loop cut at
that one, closing all the closed loop. So a single evaluation serves Newton's method for the steady cruise and the
margins of every cut.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen import native
from dualwinch.codegen.source.expressions import built_once
from dualwinch.model.plant import PlantState, tensions
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.loop.closed_loop import CUTS, ClosedLoop, closed_loop
from dualwinch.simulation.loop.structure import Structure, template_of

X, DRUMS = "motion.plant.x", ("motion.plant.theta_1", "motion.plant.theta_2")
"""States of the vehicle's position and the drums' angles."""

QUICK_BUILD = ("-O1",)
"""The function is long and straight: more takes a compiler thrice as long and brings nothing."""


@dataclass(frozen=True, eq=False)
class OpenSample:
    """A sample, open at all of `CUTS`.

    Attributes:
        loop: the closed loop, not cut.
        kept: (n,) indices of its states that are no bookkeeping.
        x, ropes: indices of the vehicle's position and of both drums' angles among those.
        moving: (n,) which of them go on with the vehicle, beside the drums.
        reference: index of the reference position among what comes from outside.
        evaluate: ``(state, exogenous, parameters, cut) -> (following, returned, facts, change, slopes)``: the kept
            states a sample later (n,), what comes back to the cuts (3,), the force command, what its limit leaves of it
            and both tensions (4,), both tensions' changes over the sample (2,); and the derivatives of following,
            returned and change by kept states, reference position and what leaves the cuts (n + 5, n + 4).
    """

    loop: ClosedLoop
    kept: NDArray[np.intp]
    x: int
    ropes: list[int]
    moving: NDArray[np.bool_]
    reference: int
    evaluate: native.CompiledFunction


@built_once
def open_sample(structure: Structure) -> OpenSample:
    """The open sample of a structure, compiled.

    Raises:
        DualwinchError: no compiler, or no usable cache folder.
    """
    loop, cut = closed_loop(structure), closed_loop(structure, cuts=tuple(CUTS))
    arguments = [ca.SX.sym(name, cut.sample.size1_in(name)) for name in cut.sample.name_in()]
    state, exogenous, parameters, leaving = arguments
    following, row, _ = cut.step(*arguments)
    returned = cut.sample(*arguments)[cut.sample.name_out().index("returned")]
    kept = np.flatnonzero(~loop.marked(Mark.BOOKKEEPING))
    values = dict(zip(loop.parameters, ca.vertsplit(parameters), strict=True))
    plant = with_leaves(template_of(structure).plant, values, "plant.")

    def forces(vector: ca.SX) -> ca.SX:
        named = dict(zip(loop.states, ca.vertsplit(vector), strict=True))
        return ca.vertcat(
            *tensions(PlantState(*(named[f"motion.plant.{key}"] for key in PlantState.__annotations__)), plant)
        )

    change = forces(following) - forces(state)
    facts = row[[loop.columns.index(name) for name in ("u", "u_sat", "F1", "F2")]]
    reference = loop.exogenous.index("reference.x")
    wanted = ca.vertcat(following[kept.tolist()], returned, change)
    by = [state, exogenous, leaving]
    slopes = [ca.jacobian(wanted, vector) for vector in by]
    slope = ca.horzcat(slopes[0][:, kept.tolist()], slopes[1][:, reference], slopes[2])
    function = ca.Function(
        "open_sample",
        arguments,
        [following[kept.tolist()], returned, facts, change, ca.densify(slope)],
        ["state", "exogenous", "parameters", "cut"],
        ["following", "returned", "facts", "change", "slopes"],
        {"cse": True},
    )
    names = [loop.states[index] for index in kept]
    drums = [names.index(name) for name in DRUMS]
    moving = loop.marked(Mark.POSITION)[kept]
    moving[drums] = False
    return OpenSample(loop, kept, names.index(X), drums, moving, reference, native.compile(function, flags=QUICK_BUILD))
