"""A rollout with its exact sensitivities in compiled C: the run once, its slopes and their products in lanes."""

import ctypes
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import Compiler, find_compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.tangents import JacobianProduct, Tangents, jacobian_product
from dualwinch.codegen.drivers.unit import hoisted_all, kept_rows, recipe, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import LANES, LaneLayout, c_source, lane_flags, lane_sizes
from dualwinch.codegen.source.expressions import GRAPHS, as_written
from dualwinch.codegen.source.hoist import hoisted
from dualwinch.codegen.source.operations import Style

Floats = NDArray[np.float64]

PRODUCTS = "SAMPLE_PRODUCT", "ONE_STEP_PRODUCT", "OBSERVE_PRODUCT"
"""Macros of sensitivity.c, in the order in which it takes what their slopes need."""


DERIVE = "derive_"
"""What the names of texts in C begin with that hold a function of the parameters, before the macro of its product."""

MOST_DIRECTIONS = 2 * LANES
"""Directions that one call takes at most: tangents of all the state along more would leave the nearest cache."""


@dataclass(frozen=True)
class Varied:
    """What runs are differentiated by, and which of their columns.

    Attributes:
        parameters: indices of the parameters that directions are made of.
        signals: indices of the signals from outside that move along directions, each in its own way.
        columns: indices of the elements of a row whose tangents are kept.
    """

    parameters: tuple[int, ...]
    signals: tuple[int, ...] = ()
    columns: tuple[int, ...] = ()

    @property
    def directions(self) -> int:
        """How many directions one call takes: quarters of the lanes enough for all, or for an even share of them."""
        quarter, numbers = LANES // 4, len(self.parameters) + len(self.signals)
        calls = math.ceil(numbers / MOST_DIRECTIONS) or 1
        return quarter * math.ceil(max(numbers, 1) / (quarter * calls))


def _along(move: ca.Function, varied: Varied) -> ca.Function:
    """``along_move(motion, hold, part, parameters, TANGENTS) -> next_motion_tangent``.

    TANGENTS are ``motion_tangent, hold_tangent, direction``.
    """
    inputs = {name: ca.SX.sym(name, move.size1_in(name)) for name in move.name_in()}
    seeds = {f"{name}_tangent": ca.SX.sym(f"{name}_tangent", inputs[name].numel()) for name in ("motion", "hold")}
    seeds["direction"] = ca.SX.sym("direction", len(varied.parameters))
    moved = move.call(inputs)["next_motion"]
    by = ca.vertcat(inputs["motion"], inputs["hold"], inputs["parameters"][list(varied.parameters)])
    tangent = ca.jtimes(moved, by, ca.vertcat(*seeds.values()))
    inputs |= seeds
    outputs = [ca.densify(tangent)]
    return ca.Function("along_move", [*inputs.values()], outputs, [*inputs], ["next_motion_tangent"], {"cse": True})


def _observe(system: Sampled, varied: Varied) -> ca.Function:
    """``observe`` of the system, of the columns that are asked for."""
    inputs = {name: ca.SX.sym(name, system.observe.size1_in(name)) for name in system.observe.name_in()}
    with as_written():
        row = system.observe.call(inputs)["row"][list(varied.columns)]
        return ca.Function("observe", [*inputs.values()], [row], [*inputs], ["row"], {"cse": True})


def jacobian_products(smooth: Sampled, varied: Varied) -> dict[str, JacobianProduct]:
    """Macro → product with the Jacobian of ``sample``, and of ``one_step`` and ``observe`` where they are needed."""
    by_parameters = {"parameters": Tangents("direction", varied.parameters)}
    at_sample = {
        "state": Tangents("state_tangent"),
        **by_parameters,
        "exogenous": Tangents("signal_tangent", varied.signals),
    }
    found = {"SAMPLE_PRODUCT": jacobian_product(smooth.sample, at_sample, ["discrete", "hold"])}
    if smooth.one_step:
        still = found["SAMPLE_PRODUCT"].still
        moving = [element for element in range(smooth.one_step.size1_in("hold")) if ("hold", element) not in still]
        between = {"motion": Tangents("motion_tangent"), "hold": Tangents("hold_tangent", moving, packed=False)}
        found["ONE_STEP_PRODUCT"] = jacobian_product(smooth.one_step, between | by_parameters, ["next_motion"])
    if varied.columns:
        found["OBSERVE_PRODUCT"] = jacobian_product(_observe(smooth, varied), at_sample, ["row"])
    return found


def sensitivity_source(
    system: Sampled,
    smooth: Sampled,
    products: Mapping[str, JacobianProduct],
    varied: Varied,
    compiler: Compiler,
) -> str:
    """C99 translation unit of a rollout with sensitivities; arguments as for `compile_sensitivity`.

    What slopes take that depends on the parameters alone is left to the caller, as it would be long code for once a
    run: CasADi functions that the unit holds as text, so that a library says all that a process needs.
    """
    functions = [system.sample, system.move, *((system.one_step,) if system.one_step else ())]
    run = hoisted_all([*functions, *((_observe(system, varied),) if varied.columns else ())])
    sloped, along = [hoisted(product.slopes)[1] for product in products.values()], _along(smooth.move, varied)
    paired = not compiler.is_clang
    lanes = {slopes.name(): LaneLayout(paired, shared=("parameters", "derived")) for slopes in sloped}
    lanes[along.name()] = LaneLayout(paired, shared=smooth.move.name_in(), apart="DIRECTIONS")
    definitions = c_source([*run, *sloped, along], Style(compares=True), lanes)
    defines = [f"#define {name} {' '.join(product.statements)}" for name, product in products.items()]
    derives = {name: hoisted(product.slopes)[0].serialize() for name, product in products.items()}
    texts = [f'EXPORT const char {DERIVE}{name}[] = "{text}";' for name, text in derives.items()]
    sizes = system.sizes | lane_sizes(compiler) | {"DIRECTIONS": varied.directions, "TRACKED": 0}
    sizes |= {"VARIED": len(varied.parameters), "SIGNALS": len(varied.signals), "ROW": len(varied.columns)}
    sizes |= {slopes.name().upper(): slopes.numel_out("slopes") for slopes in sloped}
    return unit(sizes, run, "elementary.h", "lanes.h", definitions, "\n".join([*defines, *texts, ""]), "sensitivity.c")


class Kept(NamedTuple):
    """How a run went, and what was kept of it and of its tangents.

    Attributes:
        outcome, done: how it ended, and how many samples were stepped.
        first, first_tangents: (kept,) the first state, and (kept, directions) its tangents.
        rows, row_tangents: (kept, columns) the columns asked for, and (kept, columns, directions) their tangents.
    """

    outcome: Outcome
    done: int
    first: Floats
    first_tangents: Floats
    rows: Floats
    row_tangents: Floats


@dataclass(frozen=True)
class Sensitivity:
    """A compiled rollout with sensitivities.

    Attributes:
        varied: by what it is differentiated.
    """

    varied: Varied
    _derive: Mapping[str, ca.Function]
    _call: "ctypes._NamedFuncPointer"

    def __call__(
        self,
        parameters: Floats,
        directions: Floats,
        exogenous: Floats,
        state: Floats,
        tangent: Floats,
        stride: int = 1,
        signals: Floats | None = None,
    ) -> Kept:
        """Run; Python's lock is released meanwhile.

        Args:
            parameters: (parameters,).
            directions: (varied parameters, directions), a direction in each column.
            exogenous: (samples, exogenous).
            state: (states,); overwritten with the final state.
            tangent: (states, directions), the start's slopes along the directions; overwritten with the end's.
            stride: every how many samples the first state, the columns and their tangents are kept; 0 keeps none.
            signals: (samples, varied signals, directions), the slopes of these signals; needed where there are any.
        """
        samples, columns, width = len(exogenous), len(self.varied.columns), self.varied.directions
        kept, done = kept_rows(samples, stride), ctypes.c_int64()
        arrays = [np.empty((kept, *shape)) for shape in ((), (width,), (columns,), (columns, width))]
        moved = np.empty((samples, len(self.varied.signals), width)) if signals is None else signals
        derived = {name: np.array(derive(parameters), order="C") for name, derive in self._derive.items()}
        outcome = self._call(
            parameters,
            *(derived.get(name) for name in PRODUCTS),
            *(directions, exogenous, moved, state, tangent, samples, max(stride, 1)),
            *(array if stride else None for array in arrays),
            ctypes.byref(done),
        )
        return Kept(Outcome(outcome), done.value, *(array[: kept_rows(done.value, stride)] for array in arrays))


@with_compiler
@GRAPHS.cached
def compile_sensitivity(
    system: Sampled, smooth: Sampled, varied: Varied, compiler: Compiler | None = None
) -> Sensitivity:
    """Compile (or find in the cache) and load a rollout with sensitivities.

    Args:
        system: what is run.
        smooth: what is differentiated along its run: `system` itself, or one without its steps, whose derivatives
            are zero almost everywhere.
        varied: by what, and which columns.
        compiler: by default the one `find_compiler` finds.

    Raises:
        CompilerNotFoundError, CompileError, CacheError: as `compile_rollout`.
    """
    chosen = compiler or find_compiler()
    driver = loaded(
        lambda: sensitivity_source(system, smooth, jacobian_products(smooth, varied), varied, chosen),
        chosen,
        lane_flags(chosen),
        recipe((*system.functions, *smooth.functions), "sensitivity", system.parts, smooth.parts, varied),
        sensitivity="pppppppppnnppppp -> int",
    )
    needed = zip(PRODUCTS, (True, smooth.one_step is not None, bool(varied.columns)), strict=True)
    texts = {name: ctypes.c_char.in_dll(driver, f"{DERIVE}{name}") for name, there in needed if there}
    derive = {
        name: ca.Function.deserialize(ctypes.string_at(ctypes.addressof(text)).decode()) for name, text in texts.items()
    }
    return Sensitivity(varied, derive, driver.sensitivity)
