"""A rollout with its exact sensitivities in compiled C: the run once, its slopes and their products in lanes."""

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import library
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.tangents import JacobianProduct, Tangents, jacobian_product
from dualwinch.codegen.drivers.unit import hoisted_all, unit
from dualwinch.codegen.sampled import Sampled
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.source.hoist import hoisted
from dualwinch.codegen.source.lanes import LANES, Lanes, lane_flags, lane_sizes
from dualwinch.codegen.source.operations import Style

Floats = NDArray[np.float64]


def directions_for(gains: tuple[int, ...]) -> int:
    """How many directions one call takes: half the lanes are enough for few gains."""
    return LANES // 2 if len(gains) <= LANES // 2 else LANES


def _along(move: ca.Function) -> ca.Function:
    """``along_move(motion, hold, part, parameters, motion_tangent, hold_tangent) -> next_motion_tangent``."""
    inputs = {name: ca.SX.sym(name, move.size1_in(name)) for name in move.name_in()}
    seeds = {f"{name}_tangent": ca.SX.sym(f"{name}_tangent", inputs[name].numel()) for name in ("motion", "hold")}
    moved = move.call(inputs)["next_motion"]
    tangent = ca.jtimes(moved, ca.vertcat(inputs["motion"], inputs["hold"]), ca.vertcat(*seeds.values()))
    inputs |= seeds
    outputs = [ca.densify(tangent)]
    return ca.Function("along_move", [*inputs.values()], outputs, [*inputs], ["next_motion_tangent"], {"cse": True})


def jacobian_products(smooth: Sampled, gains: tuple[int, ...]) -> dict[str, JacobianProduct]:
    """Macro → product with the Jacobian of ``sample``, and of ``one_step`` where the system has one."""
    by_gains = {"state": Tangents("state_tangent"), "parameters": Tangents("direction", gains)}
    found = {"SAMPLE_PRODUCT": jacobian_product(smooth.sample, by_gains, ["discrete", "hold"])}
    if smooth.one_step:
        still = found["SAMPLE_PRODUCT"].still
        moving = [element for element in range(smooth.one_step.size1_in("hold")) if ("hold", element) not in still]
        between = {"motion": Tangents("motion_tangent"), "hold": Tangents("hold_tangent", moving)}
        found["ONE_STEP_PRODUCT"] = jacobian_product(smooth.one_step, between, ["next_motion"])
    return found


def sensitivity_source(
    system: Sampled,
    smooth: Sampled,
    products: Mapping[str, JacobianProduct],
    gains: tuple[int, ...],
    compiler: Compiler,
) -> str:
    """C99 translation unit of a rollout with sensitivities; arguments as for `compile_sensitivity`.

    What slopes take that depends on the parameters alone is left to the caller: long code for once a run.
    """
    run = hoisted_all((system.sample, system.move, *((system.one_step,) if system.one_step else ())))
    sloped, along = [hoisted(product.slopes)[1] for product in products.values()], _along(smooth.move)
    paired = not compiler.is_clang
    lanes = {slopes.name(): Lanes(paired, shared=("parameters", "derived")) for slopes in sloped}
    lanes[along.name()] = Lanes(paired, shared=smooth.move.name_in(), apart="DIRECTIONS")
    definitions = c_source([*run, *sloped, along], Style(compares=True), lanes)
    defines = [f"#define {name} {' '.join(product.statements)}" for name, product in products.items()]
    sizes = system.sizes | lane_sizes(compiler)
    sizes |= {"GAINS": len(gains), "DIRECTIONS": directions_for(gains), "TRACKED": 0}
    sizes |= {slopes.name().upper(): slopes.numel_out("slopes") for slopes in sloped}
    return unit(sizes, run, "elementary.h", "lanes.h", definitions, "\n".join(defines) + "\n", "sensitivity.c")


@dataclass(frozen=True)
class Sensitivity:
    """A compiled rollout with sensitivities.

    Attributes:
        directions: how many directions one call takes.
    """

    directions: int
    _derive: tuple[ca.Function, ...]
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
            directions: (gains, directions), a direction in each column.
            exogenous: (samples, exogenous).
            state: (states,); overwritten with the final state.
            tangent: (states, directions), the start's slopes along the directions; overwritten with the end's.
            stride: every how many samples the first state and its tangent are kept; 0 keeps none.

        Returns:
            Outcome, samples stepped, the first state (kept,) and its tangents (kept, directions).
        """
        samples = exogenous.shape[0]
        kept = -(-samples // stride) if stride else 0
        values, tangents, done = np.empty(kept), np.empty((kept, self.directions)), ctypes.c_int64()
        derived = [np.array(derive(parameters), order="C") for derive in self._derive]
        for_sample, for_one_step = (*derived, None) if len(derived) == 1 else derived
        outcome = self._call(
            parameters.ctypes.data,
            for_sample.ctypes.data,
            None if for_one_step is None else for_one_step.ctypes.data,
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
    products = jacobian_products(smooth, gains)
    path = library(sensitivity_source(system, smooth, products, gains, chosen), chosen, lane_flags(chosen))
    call = ctypes.CDLL(str(path)).sensitivity
    call.restype = ctypes.c_int
    pointer, count = ctypes.c_void_p, ctypes.c_int64
    call.argtypes = [pointer] * 7 + [count, count, pointer, pointer, ctypes.POINTER(count)]
    return Sensitivity(directions_for(gains), tuple(hoisted(product.slopes)[0] for product in products.values()), call)
