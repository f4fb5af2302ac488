"""Compiled extended Kalman filter over a log, predictions with its gains and exact derivatives, and a smoother."""

import ctypes
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import code_cache, compiled, compilers, language, translation_unit

Floats = NDArray[np.float64]

DRIVER = tuple(
    (Path(__file__).parent / "filter_driver" / name).read_text(encoding="utf-8")
    for name in ("linear.h", "kalman.c", "predict.c", "smooth.c")
)
"""Text of the C files of the filter."""


@dataclass(frozen=True)
class PredictedSystem:
    """A sampled system with recorded inputs, sensors, and parameters to be fitted.

    The state begins with the continuous part, `motion`; the rest changes at a sample. All functions have dense SX
    expressions.

    Attributes:
        sense: ``sense(state, input, parameters) -> reading``.
        prepare: ``prepare(state, input, parameters) -> (rest, hold)``: the rest of the state at the next sample, and
            the zero-order hold until then.
        move: ``move(motion, hold, part, parameters) -> (next_motion, margin)``, over one of `parts` equal parts of the
            sample interval.
        parts: number of these parts.
        one_step: ``one_step(motion, hold, parameters) -> (next_motion, margin, valid)`` over the sample interval, used
            wherever ``valid > 0``; or None.
        fitted: indices of the parameters to be fitted.
    """

    sense: ca.Function
    prepare: ca.Function
    move: ca.Function
    parts: int
    one_step: ca.Function | None
    fitted: tuple[int, ...]

    @property
    def functions(self) -> tuple[ca.Function, ...]:
        """All functions there are."""
        return (self.sense, self.prepare, self.move, *((self.one_step,) if self.one_step else ()))

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes of the vectors, by the names of their C macros."""
        return {
            "STATES": self.sense.numel_in("state"),
            "MOTION": self.move.numel_in("motion"),
            "REST": self.prepare.numel_out("rest"),
            "INPUTS": self.sense.numel_in("input"),
            "READINGS": self.sense.numel_out("reading"),
            "HOLD": self.prepare.numel_out("hold"),
            "FITTED": len(self.fitted),
            "PARTS": self.parts,
            "HAS_ONE_STEP": int(self.one_step is not None),
        }


@dataclass(frozen=True)
class FilterData:
    """Inputs and readings of a filter.

    Attributes:
        inputs: (samples, inputs).
        readings: (samples, readings); NaN for missing ones.
        start: (states,) mean before the first reading.
    """

    inputs: Floats
    readings: Floats
    start: Floats

    @property
    def arguments(self) -> tuple[Floats, Floats, int, Floats]:
        """Arguments of the C functions."""
        return self.inputs, self.readings, len(self.inputs), self.start


@dataclass(frozen=True)
class FilterCovariances:
    """Covariances of a filter.

    Attributes:
        initial: (states, states) covariance of the state before the first reading, P0.
        process: (states,) variances added by each sample, the diagonal of Q.
        measurement: (readings,) variances of the sensors' noise, the diagonal of R.
    """

    initial: Floats
    process: Floats
    measurement: Floats


@dataclass(frozen=True)
class FilterPass:
    """One pass of an extended Kalman filter: its gains, and the likelihood of its innovations.

    Attributes:
        outcome: its outcome.
        gains: (samples, readings, states) Kalman gains, from innovations to corrections; zero without a reading.
        whitening: (samples, readings, readings) from innovations to white ones of variance 1; likewise.
        counts, squares, logarithms: (readings,) sums for each sensor: number of readings, squares of the whitened
            innovations, logarithms of the innovations' variances.
        noise: (readings,) variance of each sensor's noise by one step of expectation maximisation, or NaN.
        states, deviations: (samples, states) filtered state after each sample's readings, and its standard deviation;
            or None.
        covariances: (samples, watched, states) the last states' rows of its covariance; or None.
        updates: (samples, readings, 2) each reading's innovation, less what those of sensors before it in the same
            sample explain, and its variance; NaN without a reading; or None.
        end: (states,) mean and (states, states) covariance before a next sample; or None.
    """

    outcome: compiled.Outcome
    gains: Floats
    whitening: Floats
    counts: Floats
    squares: Floats
    logarithms: Floats
    noise: Floats
    states: Floats | None
    deviations: Floats | None
    covariances: Floats | None = None
    updates: Floats | None = None
    end: tuple[Floats, Floats] | None = None

    @property
    def negative_log_likelihood(self) -> float:
        """Negative log-likelihood, up to a constant."""
        return float((self.squares + self.logarithms).sum() / 2)


@dataclass(frozen=True)
class FixedGainPrediction:
    """One-step-ahead predictions with given gains.

    Attributes:
        outcome: its outcome.
        normal: (p + 1, p + 1) normal equations: sums over all readings of the products of the whitened innovations'
            derivatives with respect to p parameters and, last, of the innovations themselves.
        innovations: (samples, readings) whitened innovations, NaN without a reading; or None.
    """

    outcome: compiled.Outcome
    normal: Floats
    innovations: Floats | None


@dataclass(frozen=True)
class Predictor:
    """A compiled filter, which runs without the global interpreter lock."""

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
        updates: bool = False,
        into: FilterPass | None = None,
    ) -> FilterPass:
        """Run the extended Kalman filter over all samples.

        Args:
            parameters: (parameters,).
            data: inputs and readings.
            covariances: P0, Q and R.
            outlier: innovation, over its standard deviation, beyond which a reading is downweighted (Huber's loss).
            gains: whether gains and whitening are kept; else their arrays have no samples.
            rows: whether filtered states are kept.
            watched: number of last states with kept rows of the covariance.
            updates: whether innovations with their variances, and the end, are kept.
            into: an earlier pass over the same data whose arrays of gains are reused.
        """
        samples, states, readings = len(data.inputs), self._sizes["STATES"], self._sizes["READINGS"]
        gain_samples = samples if gains else 0
        if into is not None and into.gains.shape == (gain_samples, readings, states):
            gain_rows, whitening = into.gains, into.whitening
        else:
            gain_rows, whitening = (
                np.zeros((gain_samples, readings, states)),
                np.zeros((gain_samples, readings, readings)),
            )
        sums, count = np.empty((readings, 4)), ctypes.c_int64()
        means, deviations = (np.full((samples, states), np.nan) if rows else None for _ in range(2))
        covariance_rows = np.full((samples, watched, states), np.nan) if watched else None
        update_rows = np.full((samples, readings, 2), np.nan) if updates else None
        end = (np.empty(states), np.empty((states, states))) if updates else None
        outcome = self._filter(
            parameters,
            *data.arguments,
            *(covariances.initial, covariances.process, covariances.measurement, outlier),
            *((gain_rows, whitening) if gains else (None, None)),
            *(sums, means, deviations, watched, covariance_rows, update_rows, *(end or (None, None))),
            ctypes.byref(count),
        )
        counts, squares, logarithms, noise = sums.T
        with np.errstate(invalid="ignore"):
            noise = noise / counts
        return FilterPass(
            outcome=compiled.Outcome(outcome),
            gains=gain_rows,
            whitening=whitening,
            counts=counts,
            squares=squares,
            logarithms=logarithms,
            noise=noise,
            states=means,
            deviations=deviations,
            covariances=covariance_rows,
            updates=update_rows,
            end=end,
        )

    def smooth(self, parameters: Floats, data: FilterData, filtered: FilterPass) -> tuple[Floats, Floats]:
        """Estimate the last states from all readings, later ones included (modified Bryson–Frazier smoother).

        Args:
            parameters: (parameters,).
            data: inputs and readings.
            filtered: a pass with rows and covariances of the watched states.

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
        """Predict all readings with given gains, with exact derivatives with respect to the fitted parameters.

        Args:
            parameters: (parameters,).
            data: inputs and readings.
            filtered: the pass with the gains of each sample.
            rows: whether the innovations are kept.
        """
        width, readings = self._sizes["FITTED"] + 1, self._sizes["READINGS"]
        normal, count = np.empty((width, width)), ctypes.c_int64()
        innovations = np.full((len(data.inputs), readings), np.nan) if rows else None
        gains = filtered.gains, filtered.whitening
        outcome = self._predict(parameters, *data.arguments, *gains, normal, innovations, ctypes.byref(count))
        return FixedGainPrediction(compiled.Outcome(outcome), normal, innovations)


DIRECTION = "direction"
"""Array of the tangents of the fitted parameters."""


def prediction_source(system: PredictedSystem, compiler: compilers.Compiler) -> str:
    """C99 translation translation_unit.unit of a filter over a log."""
    functions = {function.name(): function for function in system.functions}
    by_state = {name: _product(each, (), "1") for name, each in functions.items() if name != "move"}
    fitted = {name: _product(each, system.fitted, "LANES") for name, each in functions.items() if name != "move"}
    by_parts = _product(system.move, system.fitted, "1")
    linear = [_linear(functions[name], product) for name, product in (by_state | {"move": by_parts}).items()]
    sloped = [product.slopes for product in fitted.values()]
    hoisted = translation_unit.hoisted_all([*functions.values(), *linear, *sloped])
    lanes = {each.name(): language.LaneLayout(compiler.pairs, shared=("parameters", "derived")) for each in sloped}
    macros = {f"{name}_BY_STATE": product for name, product in by_state.items()} | {"MOVE_BY_ALL": by_parts}
    macros |= {f"{name}_BY_ALL": product for name, product in fitted.items()}
    statements = {name: product.statements() for name, product in macros.items()}
    statements["MOVE_BY_STATE"] = by_parts.statements(without=DIRECTION)
    defines = [f"#define {name.upper()} {' '.join(lines)}" for name, lines in statements.items()]
    sizes = {"LINEAR_ONE_STEP_SLOPES": 0} | system.sizes | language.lane_sizes(paired=compiler.pairs)
    sizes |= {f"{each.name().upper()}_SLOPES": each.numel_out("slopes") for each in linear}
    sizes |= {each.name().upper(): each.numel_out("slopes") for each in sloped}
    return translation_unit.unit(
        sizes,
        hoisted,
        "elementary.h",
        "lanes.h",
        "vectors.h",
        language.c_source(hoisted, language.Style(compares=True), lanes),
        "\n".join(defines) + "\n",
        *DRIVER,
    )


def _product(function: ca.Function, fitted: tuple[int, ...], lanes: str) -> language.JacobianProduct:
    """Product with the Jacobian of a function with respect to its state, motion or hold, and the fitted parameters."""
    tangents = {
        name: language.Tangents(f"{name}_tangent") for name in ("state", "motion", "hold") if name in function.name_in()
    }
    tangents |= {"parameters": language.Tangents(DIRECTION, fitted)} if fitted else {}
    outputs = [name for name in function.name_out() if name not in {"margin", "valid"}]
    return language.jacobian_product(function, tangents, outputs, lanes)


def _linear(function: ca.Function, product: language.JacobianProduct) -> ca.Function:
    """``linear_NAME``: a function together with the slopes of the product with its Jacobian."""
    inputs = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    outputs = function.call(inputs) | product.slopes.call(inputs)
    names = [*function.name_out(), "slopes"]
    every = [outputs[name] for name in names]
    return ca.Function(f"linear_{function.name()}", [*inputs.values()], every, [*inputs], names, {"cse": True})


@compilers.with_compiler
@language.GRAPHS.cached
def compile_predictor(compiler: compilers.Compiler, system: PredictedSystem) -> Predictor:
    """Compile (or find in the cache) and load a filter.

    Args:
        compiler: that of `find_compiler`, no argument of the caller.
        system: the predicted system.

    Raises:
        CompilerNotFoundError, CompileError, CacheError: as in `compile_rollout`.
    """
    signatures = {
        "filter": "pppnppppxpppppnppppp -> int",
        "smooth": "pppnpppnppp -> int",
        "predict": "pppnpppppp -> int",
    }
    made_of = translation_unit.recipe(
        system.functions, Path(__file__).read_text(encoding="utf-8"), DRIVER, system.parts, system.fitted
    )
    source = partial(prediction_source, system, compiler)
    driver = code_cache.loaded(source, compiler, language.lane_flags(compiler), made_of, **signatures)
    return Predictor(system.sizes, driver.filter, driver.predict, driver.smooth)
