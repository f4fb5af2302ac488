"""An extended Kalman filter over a whole log in compiled C, predictions with its gains and their exact derivatives."""

import ctypes
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import Compiler, find_compiler, with_compiler
from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.tangents import JacobianProduct, Tangents, jacobian_product
from dualwinch.codegen.drivers.unit import hoisted_all, recipe, unit
from dualwinch.codegen.sampled import PredictedSystem
from dualwinch.codegen.source.c_source import LaneLayout, c_source, lane_flags, lane_sizes
from dualwinch.codegen.source.expressions import GRAPHS
from dualwinch.codegen.source.operations import Style

Floats = NDArray[np.float64]

VECTOR = 8
"""Numbers side by side; rows of matrices are filled up with zeros to a multiple."""


@dataclass(frozen=True)
class FilterData:
    """Inputs and readings that a filter goes through.

    Attributes:
        inputs: (samples, inputs).
        readings: (samples, readings); NaN is no reading.
        start: (states,) expected before the first reading.
    """

    inputs: Floats
    readings: Floats
    start: Floats

    @property
    def arguments(self) -> tuple[Floats, Floats, int, Floats]:
        """As the C functions take them."""
        return self.inputs, self.readings, len(self.inputs), self.start


@dataclass(frozen=True)
class FilterCovariances:
    """Covariances that a filter starts from.

    Attributes:
        initial: (states, states) of the state expected before the first reading, P0.
        process: (states,) variances that each sample adds, the diagonal of Q.
        measurement: (readings,) variances of the sensors' noise, the diagonal of R.
    """

    initial: Floats
    process: Floats
    measurement: Floats


@dataclass(frozen=True)
class FilterPass:
    """One pass of an extended Kalman filter: its gains, and the likelihood of its innovations.

    Attributes:
        outcome: how it ended.
        done: samples gone through.
        gains: (samples, readings, states) Kalman gains, from innovations to corrections; zeros where nothing was read.
        whitening: (samples, readings, readings) from innovations to white ones of variance 1; likewise.
        counts, squares, logarithms: (readings,) sums for each sensor: number of readings, squares of the whitened
            innovations, logarithms of the innovations' variances.
        noise: (readings,) variance of each sensor's noise by one step of expectation maximisation, or NaN.
        states, deviations: (samples, states) filtered state after each sample's readings, and its standard deviation;
            or None.
        covariances: (samples, watched, states) the last states' rows of its covariance; or None.
    """

    outcome: Outcome
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
    def negative_log_likelihood(self) -> float:
        """Minus the logarithm of the likelihood, but for a constant."""
        return float((self.squares + self.logarithms).sum() / 2)


@dataclass(frozen=True)
class FixedGainPrediction:
    """Predictions one sample ahead with given gains.

    Attributes:
        outcome, done: as of `FilterPass`.
        normal: (p + 1, p + 1) normal equations: sums over all readings of the products of the whitened innovations'
            derivatives by p parameters and, last, of the innovations themselves.
        innovations: (samples, readings) whitened; NaN where nothing was read; or None.
    """

    outcome: Outcome
    done: int
    normal: Floats
    innovations: Floats | None


@dataclass(frozen=True)
class Predictor:
    """A compiled filter; Python's lock is released while it runs."""

    _sizes: dict[str, int]
    _filter: "ctypes._NamedFuncPointer"
    _predict: "ctypes._NamedFuncPointer"
    _smooth: "ctypes._NamedFuncPointer"

    def filter(
        self,
        parameters: Floats,
        data: FilterData,
        covariances: FilterCovariances,
        *,
        outlier: float = np.inf,
        gains: bool = True,
        rows: bool = False,
        watched: int = 0,
        into: FilterPass | None = None,
    ) -> FilterPass:
        """Run the extended Kalman filter over all samples.

        Args:
            parameters: (parameters,).
            data: inputs and readings.
            covariances: P0, Q and R.
            outlier: innovation, over its standard deviation, beyond which a reading counts less (Huber's loss).
            gains: whether gains and whitening are kept; else their arrays have no samples.
            rows: whether filtered states are kept.
            watched: number of states, the last ones, whose rows of the covariance are kept.
            into: an earlier pass over the same data that is no longer needed; its arrays of gains are overwritten.
        """
        samples, states, readings = len(data.inputs), self._sizes["STATES"], self._sizes["READINGS"]
        kept = samples if gains else 0
        if into is not None and into.gains.shape == (kept, readings, states):
            gain_rows, whitening = into.gains, into.whitening
        else:
            gain_rows, whitening = np.zeros((kept, readings, states)), np.zeros((kept, readings, readings))
        sums, done = np.empty((readings, 4)), ctypes.c_int64()
        means, deviations = (np.full((samples, states), np.nan) if rows else None for _ in range(2))
        covariance_rows = np.full((samples, watched, states), np.nan) if watched else None
        outcome = self._filter(
            parameters,
            *data.arguments,
            *(covariances.initial, covariances.process, covariances.measurement, outlier),
            *((gain_rows, whitening) if gains else (None, None)),
            *(sums, means, deviations, watched, covariance_rows, ctypes.byref(done)),
        )
        counts, squares, logarithms, noise = sums.T
        with np.errstate(invalid="ignore"):
            noise = noise / counts
        return FilterPass(
            outcome=Outcome(outcome),
            done=done.value,
            gains=gain_rows,
            whitening=whitening,
            counts=counts,
            squares=squares,
            logarithms=logarithms,
            noise=noise,
            states=means,
            deviations=deviations,
            covariances=covariance_rows,
        )

    def smooth(self, parameters: Floats, data: FilterData, filtered: FilterPass) -> tuple[Floats, Floats]:
        """Estimate the last states from all readings, later ones included (modified Bryson–Frazier smoother).

        Args:
            parameters: (parameters,).
            data: inputs and readings.
            filtered: a pass with rows, and covariances of the states that are watched.

        Returns:
            (samples, watched) means, and (samples, watched, watched) their covariances.

        Raises:
            ValueError: a pass without rows or covariances.
        """
        if filtered.states is None or filtered.covariances is None:
            raise ValueError("filtered: must have rows and covariances")
        samples, watched, _ = filtered.covariances.shape
        means, covariances = np.full((samples, watched), np.nan), np.full((samples, watched, watched), np.nan)
        passed = filtered.states, filtered.gains, filtered.whitening
        self._smooth(parameters, *data.arguments[:3], *passed, watched, filtered.covariances, means, covariances)
        return means, covariances

    def predict(
        self, parameters: Floats, data: FilterData, filtered: FilterPass, *, rows: bool = False
    ) -> FixedGainPrediction:
        """Predict all readings with given gains, with exact derivatives by the fitted parameters.

        Args:
            parameters: (parameters,).
            data: inputs and readings.
            filtered: gains for each of its samples.
            rows: whether the innovations are kept.
        """
        width, readings = self._sizes["FITTED"] + 1, self._sizes["READINGS"]
        normal, done = np.empty((width, width)), ctypes.c_int64()
        innovations = np.full((len(data.inputs), readings), np.nan) if rows else None
        gains = filtered.gains, filtered.whitening
        outcome = self._predict(parameters, *data.arguments, *gains, normal, innovations, ctypes.byref(done))
        return FixedGainPrediction(Outcome(outcome), done.value, normal, innovations)


def prediction_source(system: PredictedSystem, compiler: Compiler) -> str:
    """C99 translation unit of a filter over a log."""
    functions = {function.name(): function for function in system.functions}
    by_state = {name: _product(each, (), "1") for name, each in functions.items() if name != "move"}
    fitted = {name: _product(each, system.fitted, "LANES") for name, each in functions.items() if name != "move"}
    by_parts = _product(system.move, system.fitted, "1")
    linear = [_linear(functions[name], product) for name, product in (by_state | {"move": by_parts}).items()]
    sloped = [product.slopes for product in fitted.values()]
    hoisted = hoisted_all([*functions.values(), *linear, *sloped])
    lanes = {each.name(): LaneLayout(not compiler.is_clang, shared=("parameters", "derived")) for each in sloped}
    macros = {f"{name}_BY_STATE": product for name, product in by_state.items()} | {"MOVE_BY_ALL": by_parts}
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
        *(f"filter/{name}" for name in ("linear.h", "kalman.c", "predict.c", "smooth.c")),
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


@with_compiler
@GRAPHS.cached
def compile_predictor(system: PredictedSystem, compiler: Compiler | None = None) -> Predictor:
    """Compile (or find in the cache) and load a filter.

    Args:
        system: what is predicted.
        compiler: by default the one `find_compiler` finds.

    Raises:
        CompilerNotFoundError, CompileError, CacheError: as `compile_rollout`.
    """
    chosen = compiler or find_compiler()
    signatures = {
        "filter": "pppnppppxpppppnpp -> int",
        "smooth": "pppnpppnppp -> int",
        "predict": "pppnpppppp -> int",
    }
    made_of = recipe(system.functions, "prediction", system.parts, system.fitted)
    driver = loaded(lambda: prediction_source(system, chosen), chosen, lane_flags(chosen), made_of, **signatures)
    return Predictor(system.sizes, driver.filter, driver.predict, driver.smooth)
