"""A rollout with exact forward sensitivities in compiled C: partial derivatives and their products in vector lanes."""

import ctypes
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import Compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.tangents import JacobianProduct, Tangents, jacobian_product
from dualwinch.codegen.drivers.unit import all_read, hoisted_all, kept_rows, macros_of_lists, recipe, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import LANES, LaneLayout, c_source, lane_flags, lane_sizes
from dualwinch.codegen.source.expressions import BUILDING, GRAPHS, as_written
from dualwinch.codegen.source.hoist import hoisted_together
from dualwinch.codegen.source.operations import Style

Floats = NDArray[np.float64]

DERIVE = "derive_for_slopes"
"""Name of the C text that holds the slopes' function of the parameters."""

MOST_DIRECTIONS = 2 * LANES
"""Largest number of directions per call: tangents of the state along more would not fit into the first-level cache."""


@dataclass(frozen=True)
class Varied:
    """Variables and columns of the derivatives.

    Attributes:
        parameters: indices of the parameters that span the directions.
        signals: indices of the exogenous signals with tangents along the directions.
        columns: indices of the elements of a row with kept tangents.
    """

    parameters: tuple[int, ...]
    signals: tuple[int, ...] = ()
    columns: tuple[int, ...] = ()

    @property
    def directions(self) -> int:
        """Number of directions per call: a multiple of a quarter of the lanes, for all variables or an equal share."""
        quarter, numbers = LANES // 4, len(self.parameters) + len(self.signals)
        calls = math.ceil(numbers / MOST_DIRECTIONS) or 1
        return quarter * math.ceil(max(numbers, 1) / (quarter * calls))


WITHOUT = ("-fno-tree-loop-distribution", "-fno-ivopts", "-fno-predictive-commoning")
"""Passes of gcc that find next to nothing in these loops, in half the time of a build."""


def _along(move: ca.Function, varied: Varied) -> ca.Function:
    """``along_move(motion, hold, part, parameters, TANGENTS) -> next_motion_tangent``.

    TANGENTS are ``motion_tangent, hold_tangent, direction``.
    """
    inputs = {name: ca.SX.sym(name, move.size1_in(name)) for name in move.name_in()}
    seeds = {f"{name}_tangent": ca.SX.sym(f"{name}_tangent", inputs[name].numel()) for name in ("motion", "hold")}
    seeds["direction"] = ca.SX.sym("direction", len(varied.parameters))
    next_motion = move.call(inputs)["next_motion"]
    by = ca.vertcat(inputs["motion"], inputs["hold"], inputs["parameters"][list(varied.parameters)])
    tangent = ca.jtimes(next_motion, by, ca.vertcat(*seeds.values()))
    inputs |= seeds
    outputs = [ca.densify(tangent)]
    return ca.Function("along_move", [*inputs.values()], outputs, [*inputs], ["next_motion_tangent"], {"cse": True})


def _observe(system: Sampled, varied: Varied) -> ca.Function:
    """``observe`` of the system for the requested columns."""
    inputs = {name: ca.SX.sym(name, system.observe.size1_in(name)) for name in system.observe.name_in()}
    with as_written():
        row = system.observe.call(inputs)["row"][list(varied.columns)]
        return ca.Function("observe", [*inputs.values()], [row], [*inputs], ["row"], {"cse": True})


def jacobian_products(smooth: Sampled, varied: Varied) -> dict[str, JacobianProduct]:
    """Macro → product with the Jacobian of ``sample``, and of ``one_step`` and ``observe`` if needed."""
    by_parameters = {"parameters": Tangents("direction", varied.parameters)}
    at_sample = {
        "state": Tangents("state_tangent"),
        **by_parameters,
        "exogenous": Tangents("signal_tangent", varied.signals),
    }
    products = {"SAMPLE_PRODUCT": jacobian_product(smooth.sample, at_sample, ["discrete", "hold"])}
    if smooth.one_step:
        still = products["SAMPLE_PRODUCT"].still
        moving = [element for element in range(smooth.one_step.size1_in("hold")) if ("hold", element) not in still]
        between = {"motion": Tangents("motion_tangent"), "hold": Tangents("hold_tangent", moving, packed=False)}
        products["ONE_STEP_PRODUCT"] = jacobian_product(smooth.one_step, between | by_parameters, ["next_motion"])
    if varied.columns:
        products["OBSERVE_PRODUCT"] = jacobian_product(_observe(smooth, varied), at_sample, ["row"])
    return products


def sensitivity_source(
    system: Sampled,
    smooth: Sampled,
    products: Mapping[str, JacobianProduct],
    varied: Varied,
    compiler: Compiler,
) -> str:
    """C99 translation unit of a rollout with sensitivities; arguments as in `compile_sensitivity`.

    Expressions of the parameters alone, long code that runs once per run, are left to the caller: the unit holds them
    as serialised CasADi functions, so that the library contains everything.
    """
    functions = [function for function in system.functions if function is not system.observe]
    run = hoisted_all([*functions, *((_observe(system, varied),) if varied.columns else ())])
    derive, sloped = hoisted_together(tuple(product.slopes for product in products.values()))
    directional = _along(smooth.move, varied)
    motion, signals = range(system.sizes["MOTION"]), all_read(sloped, "exogenous")
    packed = {"state": sorted({*motion, *all_read(sloped, "state")}), "exogenous": signals}
    layout = LaneLayout(compiler.pairs, shared=("parameters", "derived"), packed=packed)
    lanes = {slopes.name(): layout for slopes in sloped}
    lanes[directional.name()] = LaneLayout(compiler.pairs, shared=smooth.move.name_in(), stride="DIRECTIONS")
    definitions = c_source([*run, *sloped, directional], Style(compares=True), lanes)
    defines = [f"#define {name} {' '.join(product.statements())}" for name, product in products.items()]
    listed = macros_of_lists(READ_STATE=packed["state"], READ_EXOGENOUS=signals)
    text = f'EXPORT const char {DERIVE}[] = "{derive.serialize()}";'
    sizes = system.sizes | lane_sizes(paired=compiler.pairs) | {"DIRECTIONS": varied.directions, "TRACKED": 0}
    sizes |= {"VARIED": len(varied.parameters), "SIGNALS": len(varied.signals), "ROW": len(varied.columns)}
    sizes |= {slopes.name().upper(): slopes.numel_out("slopes") for slopes in sloped}
    macros = "\n".join([listed, *defines, text, ""])
    return unit(sizes, run, "elementary.h", "lanes.h", "vectors.h", definitions, macros, "sensitivity.c")


class SensitivityRows(NamedTuple):
    """Outcome of a run, with its kept values and tangents.

    Attributes:
        outcome, samples: outcome, and number of samples stepped.
        state, state_tangents: (kept,) the first state, and (kept, directions) its tangents.
        rows, row_tangents: (kept, columns) the requested columns, and (kept, columns, directions) their tangents.
    """

    outcome: Outcome
    samples: int
    state: Floats
    state_tangents: Floats
    rows: Floats
    row_tangents: Floats


@dataclass(frozen=True)
class Sensitivity:
    """A compiled rollout with sensitivities.

    Attributes:
        varied: variables and columns of the derivatives.
    """

    varied: Varied
    _derive: ca.Function
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
        into: Floats | None = None,
    ) -> SensitivityRows:
        """Run without the global interpreter lock.

        Args:
            parameters: (parameters,).
            directions: (varied parameters, directions), a direction in each column.
            exogenous: (samples, exogenous).
            state: (states,); overwritten with the final state.
            tangent: (states, directions), tangents of the initial state; overwritten with those of the final state.
            stride: every `stride`-th sample keeps the first state, the columns and their tangents; 0: none.
            signals: (samples, varied signals, directions), tangents of these signals; required if there are any.
            into: (kept, directions), C-contiguous, for the tangents of the first state; rows after an early end are
                left as they are. Default: a new array.
        """
        samples, columns, width = len(exogenous), len(self.varied.columns), self.varied.directions
        row_count, count = kept_rows(samples, stride), ctypes.c_int64()
        initial_row, rows, row_tangents = (
            np.empty((row_count, *shape)) for shape in ((), (columns,), (columns, width))
        )
        arrays = initial_row, np.empty((row_count, width)) if into is None else into, rows, row_tangents
        signal_tangents = np.empty((samples, len(self.varied.signals), width)) if signals is None else signals
        outcome = self._call(
            parameters,
            np.array(self._derive(parameters), order="C"),
            *(directions, exogenous, signal_tangents, state, tangent, samples, max(stride, 1)),
            *(array if stride else None for array in arrays),
            ctypes.byref(count),
        )
        return SensitivityRows(
            Outcome(outcome), count.value, *(array[: kept_rows(count.value, stride)] for array in arrays)
        )


@with_compiler
@GRAPHS.cached
def compile_sensitivity(compiler: Compiler, system: Sampled, smooth: Sampled, varied: Varied) -> Sensitivity:
    """Compile (or find in the cache) and load a rollout with sensitivities.

    Args:
        compiler: that of `find_compiler`, no argument of the caller.
        system: the system that is run.
        smooth: the system that is differentiated along the run: `system` itself, or one without quantisation, whose
            derivatives are zero almost everywhere.
        varied: variables and columns of the derivatives.

    Raises:
        CompilerNotFoundError, CompileError, CacheError: as in `compile_rollout`.
    """

    def source() -> str:
        with BUILDING:
            return sensitivity_source(system, smooth, jacobian_products(smooth, varied), varied, compiler)

    driver = loaded(
        source,
        compiler,
        lane_flags(compiler) + (() if compiler.is_clang else WITHOUT),
        recipe((*system.functions, *smooth.functions), "sensitivity", system.parts, smooth.parts, varied),
        sensitivity="pppppppnnppppp -> int",
    )
    text = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(driver, DERIVE)))
    return Sensitivity(varied, ca.Function.deserialize(text.decode()), driver.sensitivity)
