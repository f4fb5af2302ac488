"""A filter over a whole log in compiled C: gains from covariances, and with these the exact slopes of surprises."""

import ctypes
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import library
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.tangents import JacobianProduct, Tangents, jacobian_product
from dualwinch.codegen.drivers.unit import hoisted_all, unit
from dualwinch.codegen.predicted import Predicted
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.source.lanes import Lanes, lane_flags, lane_sizes
from dualwinch.codegen.source.operations import Style

Floats = NDArray[np.float64]

VECTOR = 8
"""Numbers side by side; rows of matrices are filled up with zeros to a multiple."""


@dataclass(frozen=True)
class Course:
    """What a filter is given of a log.

    Attributes:
        inputs: (samples, inputs).
        readings: (samples, readings); NaN is no reading.
        start: (states,) what is expected before the first reading.
    """

    inputs: Floats
    readings: Floats
    start: Floats

    def pointers(self) -> tuple[int, int, int, int]:
        """Addresses and length, as the C functions take them."""
        return self.inputs.ctypes.data, self.readings.ctypes.data, len(self.inputs), self.start.ctypes.data


@dataclass(frozen=True)
class Spread:
    """How far things scatter.

    Attributes:
        start: (states, states) covariance of what is expected before the first reading.
        walk: (states,) what a sample adds to the variances.
        readings: (readings,) variances of the sensors' noise.
    """

    start: Floats
    walk: Floats
    readings: Floats


@dataclass(frozen=True)
class Weights:
    """Gains of a filter, and how likely the log is in its eyes.

    Attributes:
        outcome: as `Outcome`, of how it ended.
        done: samples gone through.
        gains: (samples, readings, states) from surprises to corrections; zeros where nothing was read.
        whitening: (samples, readings, readings) from surprises to ones that are white, of variance 1; likewise.
        counts, squares, logarithms: (readings,) for each sensor: how many readings, the squares of their whitened
            surprises, and the logarithms of the surprises' variances before that, summed.
        noise: (readings,) variance that each sensor's noise turns out to have; NaN without readings.
        states, deviations: (samples, states) what is expected after each sample's readings, and its standard deviation;
            or None.
        covariances: (samples, watched, states) the last states' rows of its covariance; or None.
    """

    outcome: int
    done: int
    gains: Floats
    whitening: Floats
    counts: Floats
    squares: Floats
    logarithms: Floats
    noise: Floats
    states: Floats | None
    deviations: Floats | None
    covariances: Floats | None = None

    @property
    def unlikelihood(self) -> float:
        """Minus the logarithm of the likelihood, but for a constant."""
        return float((self.squares + self.logarithms).sum() / 2)


@dataclass(frozen=True)
class Prediction:
    """What was expected with given gains.

    Attributes:
        outcome, done: as of `Weights`.
        normal: (p + 1, p + 1) sums over all readings of the products of the whitened surprises' slopes by p numbers,
            and, last, of the surprises themselves.
        surprises: (samples, readings) whitened; NaN where nothing was read; or None.
    """

    outcome: int
    done: int
    normal: Floats
    surprises: Floats | None


@dataclass(frozen=True)
class Predictor:
    """A compiled filter; Python's lock is released while it runs."""

    _sizes: dict[str, int]
    _weigh: "ctypes._NamedFuncPointer"
    _predict: "ctypes._NamedFuncPointer"
    _smooth: "ctypes._NamedFuncPointer"

    def weigh(
        self,
        parameters: Floats,
        course: Course,
        spread: Spread,
        *,
        outlier: float = np.inf,
        gains: bool = True,
        rows: bool = False,
        watched: int = 0,
        into: Weights | None = None,
    ) -> Weights:
        """The gains of every sample, by an extended Kalman filter.

        Args:
            parameters: (parameters,).
            course: the log.
            spread: variances.
            outlier: surprise, over its standard deviation, from which on a reading counts less (Huber).
            gains: whether gains and whitening are kept; else their arrays have no samples.
            rows: whether what is expected is kept.
            watched: of how many states, the last ones, rows of the covariance are kept.
            into: of the same course, and no longer needed: its arrays of gains are written anew.
        """
        samples, states, readings = len(course.inputs), self._sizes["STATES"], self._sizes["READINGS"]
        weighed = samples if gains else 0
        if into is not None and into.gains.shape == (weighed, readings, states):
            found_gains, whitening = into.gains, into.whitening
        else:
            found_gains, whitening = np.zeros((weighed, readings, states)), np.zeros((weighed, readings, readings))
        sums, done = np.empty((readings, 4)), ctypes.c_int64()
        kept = [np.full((samples, states), np.nan) for _ in range(2)] if rows else []
        covariances = np.full((samples, watched, states), np.nan) if watched else None
        inputs, read, length, start = course.pointers()
        outcome = self._weigh(
            parameters.ctypes.data,
            inputs,
            read,
            length,
            start,
            *(vector.ctypes.data for vector in (spread.start, spread.walk, spread.readings)),
            outlier,
            *((array.ctypes.data if gains else None) for array in (found_gains, whitening)),
            sums.ctypes.data,
            *((array.ctypes.data for array in kept) if rows else (None, None)),
            watched,
            None if covariances is None else covariances.ctypes.data,
            ctypes.byref(done),
        )
        counts, squares, logarithms, noise = sums.T
        with np.errstate(invalid="ignore"):
            noise = noise / counts
        found, spreads = kept if rows else (None, None)
        return Weights(
            outcome, done.value, found_gains, whitening, counts, squares, logarithms, noise, found, spreads, covariances
        )

    def smooth(self, parameters: Floats, course: Course, weights: Weights) -> tuple[Floats, Floats]:
        """What the last states were by all readings, those that came later among them.

        Args:
            parameters: (parameters,).
            course: the log.
            weights: with rows, and covariances of the states that are watched.

        Returns:
            (samples, watched) means, and (samples, watched, watched) their covariances.

        Raises:
            ValueError: weights without rows or covariances.
        """
        if weights.states is None or weights.covariances is None:
            raise ValueError("weights: must have rows and covariances")
        samples, watched, _ = weights.covariances.shape
        means, spreads = np.full((samples, watched), np.nan), np.full((samples, watched, watched), np.nan)
        inputs, read, length, _ = course.pointers()
        self._smooth(
            parameters.ctypes.data,
            inputs,
            read,
            length,
            *(array.ctypes.data for array in (weights.states, weights.gains, weights.whitening)),
            watched,
            weights.covariances.ctypes.data,
            means.ctypes.data,
            spreads.ctypes.data,
        )
        return means, spreads

    def predict(self, parameters: Floats, course: Course, weights: Weights, *, rows: bool = False) -> Prediction:
        """What is expected with given gains, and its exact slopes by the fitted numbers.

        Args:
            parameters: (parameters,).
            course: the log.
            weights: gains for each of its samples.
            rows: whether the surprises are kept.
        """
        width, readings = self._sizes["FITTED"] + 1, self._sizes["READINGS"]
        normal, done = np.empty((width, width)), ctypes.c_int64()
        surprises = np.full((len(course.inputs), readings), np.nan) if rows else None
        inputs, read, length, start = course.pointers()
        outcome = self._predict(
            parameters.ctypes.data,
            inputs,
            read,
            length,
            start,
            weights.gains.ctypes.data,
            weights.whitening.ctypes.data,
            normal.ctypes.data,
            None if surprises is None else surprises.ctypes.data,
            ctypes.byref(done),
        )
        return Prediction(outcome, done.value, normal, surprises)


def prediction_source(system: Predicted, compiler: Compiler) -> str:
    """C99 translation unit of a filter over a log."""
    functions = {function.name(): function for function in system.functions}
    weighed = {name: _product(each, (), "1") for name, each in functions.items() if name != "move"}
    fitted = {name: _product(each, system.fitted, "LANES") for name, each in functions.items() if name != "move"}
    by_parts = _product(system.move, system.fitted, "1")
    linear = [_linear(functions[name], product) for name, product in (weighed | {"move": by_parts}).items()]
    sloped = [product.slopes for product in fitted.values()]
    hoisted = hoisted_all([*functions.values(), *linear, *sloped])
    lanes = {each.name(): Lanes(not compiler.is_clang, shared=("parameters", "derived")) for each in sloped}
    macros = {f"{name}_BY_STATE": product for name, product in weighed.items()} | {"MOVE_BY_ALL": by_parts}
    macros |= {f"{name}_BY_ALL": product for name, product in fitted.items()}
    defines = [f"#define {name.upper()} {' '.join(product.statements)}" for name, product in macros.items()]
    sizes = {"ONE_STEP_DERIVED": 0, "LINEAR_ONE_STEP_SLOPES": 0} | system.sizes | lane_sizes(compiler)
    sizes |= {f"{each.name().upper()}_SLOPES": each.numel_out("slopes") for each in linear}
    sizes |= {each.name().upper(): each.numel_out("slopes") for each in sloped}
    sizes |= {"VECTOR": VECTOR, "COLUMNS": _whole_vectors(sizes["STATES"]), "WAYS": _whole_vectors(sizes["FITTED"] + 1)}
    return unit(
        sizes,
        hoisted,
        "elementary.h",
        "lanes.h",
        c_source(hoisted, Style(compares=True), lanes),
        "\n".join(defines) + "\n",
        *(f"filter/{name}" for name in ("linear.h", "weigh.c", "predict.c", "smooth.c")),
    )


def _whole_vectors(count: int) -> int:
    """No fewer numbers than some, and vectors of `VECTOR` of them."""
    return -(-count // VECTOR) * VECTOR


def _product(function: ca.Function, fitted: tuple[int, ...], lanes: str) -> JacobianProduct:
    """The product with a function's Jacobian by the state, or the part of it or of what follows that it takes."""
    along = {name: Tangents(f"{name}_tangent") for name in ("state", "motion", "hold") if name in function.name_in()}
    along |= {"parameters": Tangents("direction", fitted)} if fitted else {}
    outputs = [name for name in function.name_out() if name not in {"margin", "valid"}]
    return jacobian_product(function, along, outputs, lanes)


def _linear(function: ca.Function, product: JacobianProduct) -> ca.Function:
    """``linear_NAME``: a function and the slopes of a product with its Jacobian."""
    inputs = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    outputs = function.call(inputs) | product.slopes.call(inputs)
    names = [*function.name_out(), "slopes"]
    every = [outputs[name] for name in names]
    return ca.Function(f"linear_{function.name()}", [*inputs.values()], every, [*inputs], names, {"cse": True})


@cache
def compile_predictor(system: Predicted, compiler: Compiler | None = None) -> Predictor:
    """Compile (or find in the cache) and load a filter.

    Args:
        system: what is predicted.
        compiler: by default the one `find_compiler` finds.

    Raises:
        CompilerNotFoundError, CompileError, CacheError: as `compile_rollout`.
    """
    chosen = compiler or find_compiler()
    loaded = ctypes.CDLL(str(library(prediction_source(system, chosen), chosen, lane_flags(chosen))))
    pointer, count, done = ctypes.c_void_p, ctypes.c_int64, ctypes.POINTER(ctypes.c_int64)
    loaded.weigh.argtypes = (
        [pointer] * 3 + [count] + [pointer] * 4 + [ctypes.c_double] + [pointer] * 5 + [count, pointer, done]
    )
    loaded.smooth.argtypes = [pointer] * 3 + [count] + [pointer] * 3 + [count] + [pointer] * 3
    loaded.predict.argtypes = [pointer] * 3 + [count] + [pointer] * 5 + [done]
    loaded.weigh.restype = loaded.predict.restype = loaded.smooth.restype = ctypes.c_int
    return Predictor(system.sizes, loaded.weigh, loaded.predict, loaded.smooth)
