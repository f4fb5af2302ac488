"""The result of an estimation: estimates with uncertainties, as tables, text, record, ensemble and figure."""

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dualwinch.toolbox import Ensemble, Experiment, drawing, ensembles, quantities
from dualwinch.toolbox import tables as kernel_tables
from dualwinch.toolboxes.identification.diagnostics import (
    LikelihoodProfile,
    UnidentifiableDirection,
    WhitenessTest,
    uninformed_keys,
)
from dualwinch.toolboxes.identification.estimate import LocalOptimum
from dualwinch.toolboxes.identification.models import ModelEvidence
from dualwinch.toolboxes.identification.options import EstimationOptions
from dualwinch.toolboxes.identification.predictor import GaussMarkov
from dualwinch.toolboxes.identification.smoother import SmoothedForce
from dualwinch.toolboxes.identification.unknowns import UncertainEstimates, UnknownParameter

Floats = NDArray[np.float64]
Table = tuple[list[str], list[list[str]]]


CONFIDENCE = 0.95
"""Probability of the printed intervals."""

INNOVATION_COLOURS = LinearSegmentedColormap.from_list("innovation", [drawing.BLUE, "white", drawing.VERMILION])


@dataclass(frozen=True, eq=False, repr=False)
class IdentificationResult(UncertainEstimates):
    """Estimates of a machine's parameters.

    Attributes:
        experiment: as given, with the estimates in place of the unknown parameters.
        unknowns, covariance: the estimated parameters, and (p, p) covariance of the estimates' errors.
        values: (p,) the estimates.
        unidentifiable: directions that the logs do not determine.
        noise: reading → standard deviation of its noise.
        process_noise: disturbance → its Gauss–Markov process.
        whiteness: tests of the innovations of each sensor.
        held_out: the same for the part of the logs that was not fitted; empty: there was none.
        innovations: reading → (2, windows) time in s since the start of all logs, and root mean square of the whitened
            innovations in time windows; 1 if the model is right.
        logs: names.
        duration: of all logs in s.
        passes: number of passes of the filter through the logs.
        converged: whether the search converged.
        optima: the distinct optima of several starts, the best first.
        seconds: wall time.
        options: of the estimation.
        forces: the unrecorded force in each log, if requested.
        profiles: profile likelihoods, if requested.
        excess: notes from reading the logs, on the model, and on implausibly large disturbances.
        along: additional parameter → value and standard deviation; estimated because innovations were not white
            without them.
        data_sheet: gain, zero or scale → value and standard deviation, estimated along with a prior by its data sheet
            (`options.DataSheetOptions`).
        sheet_shares: (p,) shares of the estimates' variances that are due to these.
        widened: largest factor of the sandwich covariance on the model's deviations, applied if innovations are not
            white; else 1.
        models: all models that were fitted, the experiment as described first, by their criteria.
        interrupted: whether an interruption (Ctrl-C) ended the comparison of models.
    """

    experiment: Experiment
    values: Floats
    unidentifiable: tuple[UnidentifiableDirection, ...]
    noise: dict[str, float]
    process_noise: dict[str, GaussMarkov]
    whiteness: tuple[WhitenessTest, ...]
    held_out: tuple[WhitenessTest, ...]
    innovations: dict[str, Floats]
    logs: tuple[str, ...]
    duration: float
    passes: int
    converged: bool
    optima: tuple[LocalOptimum, ...]
    seconds: float
    options: EstimationOptions
    forces: tuple[SmoothedForce, ...] = ()
    profiles: tuple[LikelihoodProfile, ...] = ()
    excess: tuple[str, ...] = ()
    along: dict[str, tuple[float, float]] = field(default_factory=dict)
    data_sheet: dict[str, tuple[float, float]] = field(default_factory=dict)
    sheet_shares: Floats = field(default_factory=lambda: np.zeros(0))
    widened: float = 1.0
    models: tuple[ModelEvidence, ...] = ()
    interrupted: bool = False

    @property
    def correlation(self) -> Floats:
        """(p, p) of the estimates' errors."""
        return self.covariance / np.outer(self.deviations, self.deviations)

    @property
    def uninformed(self) -> tuple[str, ...]:
        """Keys on which the logs add hardly any information to the prior."""
        return uninformed_keys(self.unknowns, self.deviations)

    @property
    def at_bounds(self) -> tuple[str, ...]:
        """Keys of the estimates at an end of their range, where deviations do not measure their errors."""
        return tuple(
            unknown.key
            for unknown, value in zip(self.unknowns, self.values, strict=True)
            if min(value - unknown.lower, unknown.upper - value) <= 1e-6 * unknown.scale
        )

    def interval(self, key: str, share: float = CONFIDENCE) -> tuple[float, float]:
        """The interval that contains a parameter with a probability of `share`, if the model is right.

        Raises:
            ValueError: a key that was not estimated.
        """
        from scipy.special import ndtri

        index = self.keys.index(key)
        half = float(ndtri((1 + share) / 2) * self.deviations[index])
        return float(self.values[index]) - half, float(self.values[index]) + half

    def ensemble(self, name: str = "fitted", seed: int = 0, draws: int = 256) -> Ensemble:
        """The machines consistent with the logs: draws from the covariance of the estimates.

        Draws beyond a parameter's range are clipped to its end.

        Args:
            name: of the ensemble.
            seed: of the draws.
            draws: number of sets of parameters.
        """
        normal = np.random.default_rng(seed).standard_normal((draws, len(self.values)))
        size, ways = np.linalg.eigh(self.correlation)  # in units of the deviations, for conditioning
        samples = self.values + self.deviations * (normal @ (np.sqrt(np.maximum(size, 0.0))[:, np.newaxis] * ways.T))
        distributions = {
            unknown.key: ensembles.Drawn(
                ensembles.Choice(tuple(np.clip(column, unknown.lower, unknown.upper).tolist())), together="fitted"
            )
            for unknown, column in zip(self.unknowns, samples.T, strict=True)
        }
        logs = ", ".join(self.logs)
        description = f"machines consistent with {logs}: {draws} draws of the estimates' errors, seed {seed}"
        return Ensemble(name, description, self.experiment, distributions)

    @property
    def headline(self) -> str:
        """The estimation in one line."""
        return (
            f"{len(self.keys)} parameter{'s' * (len(self.keys) != 1)} from {self.duration:.4g} s of "
            f"{len(self.logs)} log{'s' * (len(self.logs) != 1)}"
        )

    @property
    def tables(self) -> list[Table]:
        """Headings and rows of all tables: estimates, sensors and, if any, optima and profiles."""
        tables = [self._estimates_table(), self._sensors_table()]
        tables += [self._optima_table()] if len(self.optima) > 1 else []
        tables += [self._models_table()] if len(self.models) > 1 else []
        return tables + ([self._profiles_table()] if self.profiles else [])

    def _estimates_table(self) -> Table:
        rows, shares = [], self.sheet_shares if len(self.sheet_shares) else np.zeros(len(self.values))
        for unknown, value, deviation, share in zip(self.unknowns, self.values, self.deviations, shares, strict=True):
            low, high = self.interval(unknown.key)
            digits = _digits(value, deviation)
            error = [
                f"{deviation:.2g}",
                kernel_tables.relative(deviation, value),
                f"{low:.{digits}g} to {high:.{digits}g}",
            ]
            error += [f"{share:.0%}"] if self.data_sheet else []
            error = ["–"] * len(error) if unknown.key in self.at_bounds else error
            estimate, unit = f"{value:.{digits}g}", quantities.behind_number(unknown.unit).strip()
            rows.append([unknown.key, f"{unknown.start:.6g}", estimate, *error, unit])
        interval = f"{100 * CONFIDENCE:g} % interval"
        headings = ["parameter", "start", "estimate", "std. deviation", "relative", interval]
        return [*headings, *(["of its variance, sensors'"] if self.data_sheet else []), "unit"], rows

    def _sensors_table(self) -> Table:
        rows, end_tests = [], {test.name: test for test in self.held_out}
        for test in self.whiteness:
            row = [test.name, f"{test.count}", f"{self.noise.get(test.name, math.nan):.3g}", test.words]
            rows.append(
                row + ([f"{end_tests[test.name].variance:.3f}" if test.name in end_tests else ""] if end_tests else [])
            )
        headings = ["sensor", "readings", "noise (std. deviation)", "innovations"]
        return headings + (["normalised variance, held out"] if end_tests else []), rows

    def _optima_table(self) -> Table:
        rows = [
            [f"{each.searches}", f"{-each.deviance / 2:.3g}", *(f"{value:.5g}" for value in each.values)]
            for each in self.optima
        ]
        return ["searches", "log-likelihood, less the best", *self.keys], rows

    def _models_table(self) -> Table:
        rows = [
            [
                ", ".join(each.alternatives) or "as described",
                f"{each.parameters}",
                f"{each.deviance:.4g}",
                f"{each.criterion:.4g}",
                "refused" if each.refusal else f"{each.weight:.2g}",
            ]
            for each in self.models
        ]
        return ["model, with", "parameters", "deviance, less the least", "BIC, less the least", "weight"], rows

    def _profiles_table(self) -> Table:
        rows = []
        for profile in self.profiles:
            ends = (*profile.interval, *self.interval(profile.key))
            low, high, by_low, by_high = (f"{end:.6g}" for end in ends)
            rows.append([profile.key, f"{low} to {high}", f"{by_low} to {by_high}"])
        return ["parameter", "95 % interval by its profile", "by its std. deviation"], rows

    @property
    def notes(self) -> list[str]:
        """Notes on the tables."""
        estimated = (f"{key} = {value:.4g} ± {deviation:.2g}" for key, (value, deviation) in self.along.items())
        words = [f"also estimated, with priors: {', '.join(estimated)}"] if self.along else []
        if self.widened > 1:
            words.append(
                "innovations are not white: the model lacks something; standard deviations are up to "
                f"{self.widened:.3g} times those of the model (sandwich covariance)"
            )
        if self.widened > self.options.search.reach:
            words.append(
                "such deviations are not to be trusted: fit other parameters that may be wrong, such as "
                "plant.rope_*.modulus"
            )
        words += [*self.excess, *(each.words for each in self.unidentifiable)]
        correlation = self.correlation
        words += [f"{key}: the logs say less on it than its prior" for key in self.uninformed]
        for row in range(len(self.keys)):
            for column in range(row):
                if abs(correlation[row, column]) > self.options.diagnostics.correlated:
                    pair = f"{self.keys[column]} and {self.keys[row]}"
                    words.append(f"{pair}: their errors are correlated, {correlation[row, column]:+.3f}")
        words += [
            f"{key}: estimated at a bound of its range, so its deviation is not known; is the log of this machine?"
            for key in self.at_bounds
        ]
        if len(self.optima) > 1:
            likelihood = -self.optima[1].deviance / 2
            words.append(f"{len(self.optima)} distinct optima; the second is less likely, exp({likelihood:.3g})")
        if self.interrupted:
            words.append("interrupted: other alternatives were not compared")
        if not self.converged:
            words.append("the search did not converge: standard deviations may be too small")
        return words

    def to_record(self) -> dict[str, Any]:
        """All results as a dictionary for JSON."""
        return {
            "logs": list(self.logs),
            "duration": self.duration,
            "converged": self.converged,
            "widened": self.widened,
            "confidence": CONFIDENCE,
            "passes": self.passes,
            "seconds": self.seconds,
            "parameters": [
                {
                    "key": unknown.key,
                    "unit": unknown.unit,
                    "start": unknown.start,
                    "prior": asdict(unknown.prior) if unknown.prior else None,
                    "estimate": float(value),
                    "deviation": None if unknown.key in self.at_bounds else float(deviation),
                    "relative": None if unknown.key in self.at_bounds or not value else float(deviation / abs(value)),
                    "interval": None if unknown.key in self.at_bounds else list(self.interval(unknown.key)),
                }
                for unknown, value, deviation in zip(self.unknowns, self.values, self.deviations, strict=True)
            ],
            "along": {key: list(pair) for key, pair in self.along.items()},
            "data_sheet": {key: list(pair) for key, pair in self.data_sheet.items()},
            "sheet_shares": self.sheet_shares.tolist(),
            "correlation": self.correlation.tolist(),
            "unidentifiable": [
                {"keys": list(each.keys), "deviation": each.deviation if np.isfinite(each.deviation) else None}
                for each in self.unidentifiable
            ],
            "noise": self.noise,
            "process_noise": {name: asdict(each) for name, each in self.process_noise.items()},
            "whiteness": [asdict(test) | {"white": test.white} for test in self.whiteness],
            "held_out": [asdict(test) | {"white": test.white} for test in self.held_out],
            "models": [asdict(each) for each in self.models],
            "optima": [asdict(each) for each in self.optima],
            "profiles": [
                {
                    "key": each.key,
                    "values": each.values.tolist(),
                    "rise": each.rise.tolist(),
                    "interval": [end if np.isfinite(end) else None for end in each.interval],
                }
                for each in self.profiles
            ],
            "notes": self.notes,
        }

    def __repr__(self) -> str:
        tables = (kernel_tables.markdown(*each) for each in self.tables)
        return "\n\n".join([f"Identified: {self.headline}", *tables, "\n".join(self.notes)]).rstrip()

    def _repr_html_(self) -> str:
        """HTML for a notebook."""
        words = ". ".join([self.headline, *self.notes])
        return kernel_tables.page("Identified", words, "".join(kernel_tables.table(*each) for each in self.tables))

    def plot(self, *, ax: drawing.GivenAxes = None) -> Figure:
        """Draw estimates with their intervals, and the innovations' size over time, into two axes or a new figure."""
        rows, values, deviations = range(len(self.unknowns)), self.values, self.deviations
        with drawing.new_page(ax, 1.6 + 0.34 * max(len(rows), 5), "What the logs say", self.headline) as page:
            estimates, sensors = page.panels(1, 2)
            by = np.array([unknown.uncertainty for unknown in self.unknowns]) / 100
            starts = np.array([unknown.start for unknown in self.unknowns])
            estimates.axvline(0, color=drawing.GREY, linewidth=1.0)
            estimates.errorbar(
                (values - starts) / by,
                rows,
                xerr=1.96 * deviations / by,
                fmt="o",
                color=drawing.BLUE,
                markersize=4,
                linewidth=1.5,
                capsize=2,
            )
            estimates.set_yticks(rows, [*map(_estimate_label, self.unknowns, values.tolist(), deviations.tolist())])
            estimates.set_ylim(len(rows) - 0.5, -0.5)
            has_priors = any(unknown.prior for unknown in self.unknowns)
            estimates.set_xlabel("change, % of " + ("the prior deviation" if has_priors else "the start"))
            self._draw_innovations(sensors)
        return page.figure

    def _draw_innovations(self, axes: Axes, shown: float = 0.5) -> None:
        """Draw a strip of colour for each sensor: white where its innovations are as large as expected.

        Colours end where root mean squares deviate from 1 by `shown`.
        """
        names, verdicts = list(self.innovations), {test.name: test.words for test in self.whiteness}
        mesh = axes.pcolormesh(
            next(iter(self.innovations.values()))[0],
            range(len(names)),
            np.array([self.innovations[name][1] for name in names]),
            cmap=INNOVATION_COLOURS,
            vmin=1 - shown,
            vmax=1 + shown,
            rasterized=True,
        )
        axes.grid(visible=False)
        labels = [f"{name}\n{verdicts.get(name, '').partition(' at lag')[0]}" for name in names]
        axes.set_yticks(range(len(names)), labels)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xlabel("time in motion (s)")
        axes.figure.colorbar(mesh, ax=axes, extend="both", label="innovations, RMS (1: as expected)")


def _digits(value: float, deviation: float) -> int:
    """Number of digits of a value whose last is a tenth of its deviation."""
    if not value or not deviation or not math.isfinite(deviation):
        return 4
    return min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(deviation)) + 2, 2), 9)


def _estimate_label(unknown: UnknownParameter, value: float, deviation: float) -> str:
    """A key without its common prefix, and its estimate."""
    key = unknown.key.removeprefix("plant.").removeprefix("sensors.").removeprefix("disturbance.")
    return f"{drawing.plain(key)}\n{value:.5g} ± {deviation:.2g}{quantities.behind_number(unknown.unit)}"
