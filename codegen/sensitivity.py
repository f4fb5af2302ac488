"""A rollout with its exact sensitivities in compiled C: the run once, one direction in each vector lane."""

import ctypes
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from codegen.c_source import c_source
from codegen.cache import library
from codegen.compiler import Compiler, find_compiler
from codegen.hoist import hoisted
from codegen.lanes import LANES, in_lanes, lane_flags, lane_macros
from codegen.rollout import driver_file, source_parts
from codegen.sampled import Sampled

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """How tangents pass through a function: its slopes, computed once, and products with them, once a direction.

    Attributes:
        slopes: ``slopes_NAME(...) -> slopes``: the elements of the Jacobian that are not constant.
        spread: ``spread_NAME(slopes, tangent of each input, ...) -> tangent of each output, ...``.
    """

    slopes: ca.Function
    spread: ca.Function


def spread(function: ca.Function, along: dict[str, ca.SX | None], tangents: list[str], outputs: list[str]) -> Spread:
    """Split the derivative of a function into its slopes and products with them.

    Args:
        function: of SX expressions.
        along: input name → indices of the elements it is differentiated by as a column, or None for all.
        tangents: names of the tangents of these inputs, in the same order.
        outputs: output name of the function → which are differentiated; their tangents are ``NAME_tangent``.
    """
    inputs = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    values = function.call(inputs)
    chosen = [inputs[name] if places is None else inputs[name][places] for name, places in along.items()]
    jacobian = ca.jacobian(ca.vertcat(*(values[name] for name in outputs)), ca.vertcat(*chosen))
    varying = [place for place in range(jacobian.nnz()) if not jacobian.nz[place].is_constant()]
    slopes = ca.SX.sym("slopes", len(varying))
    product = ca.SX(jacobian)
    product.nz[varying] = slopes
    seeds = [ca.SX.sym(name, column.numel()) for name, column in zip(tangents, chosen, strict=True)]
    ends = np.cumsum([0, *(values[name].numel() for name in outputs)]).tolist()
    spread_values = ca.vertsplit(ca.densify(ca.mtimes(product, ca.vertcat(*seeds))), ends)
    return Spread(
        slopes=ca.Function(
            f"slopes_{function.name()}",
            list(inputs.values()),
            [ca.densify(ca.vertcat(*(jacobian.nz[place] for place in varying)))],
            list(inputs),
            ["slopes"],
            {"cse": True},
        ),
        spread=ca.Function(
            f"spread_{function.name()}",
            [slopes, *seeds],
            spread_values,
            ["slopes", *tangents],
            [f"{name}_tangent" for name in outputs],
        ),
    )


def _along(function: ca.Function) -> ca.Function:
    """``along_NAME(..., motion_tangent, held_tangent) -> next_motion_tangent``: the derivative in one direction."""
    inputs = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    seeds = {f"{name}_tangent": ca.SX.sym(f"{name}_tangent", inputs[name].numel()) for name in ("motion", "held")}
    moved = function.call(inputs)["next_motion"]
    tangent = ca.jtimes(moved, ca.vertcat(inputs["motion"], inputs["held"]), ca.vertcat(*seeds.values()))
    arguments = inputs | seeds
    return ca.Function(
        f"along_{function.name()}",
        list(arguments.values()),
        [ca.densify(tangent)],
        list(arguments),
        ["next_motion_tangent"],
        {"cse": True},
    )


def sensitivity_source(system: Sampled, smooth: Sampled, gains: tuple[int, ...], compiler: Compiler) -> str:
    """C99 translation unit of a rollout with sensitivities; arguments as for `compile_sensitivity`."""
    sizes, functions = source_parts(system)
    at_sample = spread(
        smooth.sample,
        {"state": None, "parameters": list(gains)},  # pyright: ignore[reportArgumentType]
        ["state_tangent", "direction"],
        ["discrete", "held"],
    )
    spreads = [at_sample]
    if smooth.leap:
        spreads.append(
            spread(smooth.leap, {"motion": None, "held": None}, ["motion_tangent", "held_tangent"], ["next_motion"])
        )
    slopes = [part for one in spreads for part in hoisted(one.slopes)]
    along = _along(smooth.move)
    lanes = {one.spread.name(): (*one.spread.name_in()[1:], *one.spread.name_out()) for one in spreads}
    lanes[along.name()] = ("motion_tangent", "held_tangent", "next_motion_tangent")
    definitions = c_source([*functions, *slopes, *(one.spread for one in spreads), along])
    macros = {"GAINS": len(gains), "TRACKED": 0, "SAMPLE_SLOPES": at_sample.slopes.numel_out("slopes")}
    if smooth.leap:
        macros["LEAP_SLOPES"] = spreads[1].slopes.numel_out("slopes")
    for derive in slopes[::2]:
        macros[f"{derive.name().removeprefix('derive_').upper()}_DERIVED"] = derive.numel_out("derived")
    return "\n".join(
        [
            lane_macros(compiler),
            *(f"#define {name} {size}" for name, size in macros.items()),
            sizes,
            driver_file("elementary.h"),
            in_lanes(definitions, lanes, compiler),
            driver_file("sensitivity.c"),
        ]
    )


@dataclass(frozen=True)
class Sensitivity:
    """A compiled rollout with sensitivities to up to LANES directions at a time."""

    _call: "ctypes._NamedFuncPointer"

    def __call__(
        self,
        parameters: Floats,
        directions: Floats,
        exogenous: Floats,
        state: Floats,
        tangent: Floats,
        stride: int = 1,
    ) -> tuple[int, int, Floats, Floats]:
        """Run; Python's lock is released meanwhile.

        Args:
            parameters: (parameters,).
            directions: (gains, LANES), a direction in each column.
            exogenous: (samples, exogenous).
            state: (states,); overwritten with the final state.
            tangent: (states, LANES), the start's slopes along the directions; overwritten with the end's.
            stride: every how many samples the first state and its tangent are kept; 0 keeps none.

        Returns:
            Outcome, samples stepped, the first state (kept,) and its tangents (kept, LANES).
        """
        samples = exogenous.shape[0]
        kept = -(-samples // stride) if stride else 0
        values, tangents, done = np.empty(kept), np.empty((kept, LANES)), ctypes.c_int64()
        outcome = self._call(
            parameters.ctypes.data,
            directions.ctypes.data,
            exogenous.ctypes.data,
            state.ctypes.data,
            tangent.ctypes.data,
            samples,
            max(stride, 1),
            values.ctypes.data if stride else None,
            tangents.ctypes.data if stride else None,
            ctypes.byref(done),
        )
        rows = -(-done.value // stride) if stride else 0
        return outcome, done.value, values[:rows], tangents[:rows]


@cache
def compile_sensitivity(
    system: Sampled, smooth: Sampled, gains: tuple[int, ...], compiler: Compiler | None = None
) -> Sensitivity:
    """Compile (or find in the cache) and load a rollout with sensitivities.

    Args:
        system: what is run.
        smooth: what is differentiated along its run: `system` itself, or one without its steps, whose derivatives
            are zero almost everywhere.
        gains: indices of the parameters that directions are made of.
        compiler: by default the one `find_compiler` finds.

    Raises:
        CompilerNotFoundError, CompileError, CacheError: as `compile_rollout`.
    """
    chosen = compiler or find_compiler()
    path = library(sensitivity_source(system, smooth, gains, chosen), chosen, lane_flags(chosen))
    call = ctypes.CDLL(str(path)).sensitivity
    call.restype = ctypes.c_int
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    call.argtypes = [pointer] * 5 + [count, count, pointer, pointer, ctypes.POINTER(count)]
    return Sensitivity(call)
