"""The result of a run: a run with ways to show it, sample it anew and hand it to other libraries."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from dualwinch.simulation.loop.structure import solver_of
from dualwinch.simulation.results import frames, view
from dualwinch.simulation.results.resampling import instants, resampled
from dualwinch.simulation.results.run import Run

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class Result(Run):
    """One run. By name it gives its columns, as a mapping does: ``result["F1"]``, ``"F1" in result``, ``dict(result)``.

    Two results are equal where all they hold is, number for number. Fields are those of `Run`.
    """

    @property
    def integrator(self) -> str:
        """The integrator that solved the run: the one asked for, or rk4 where a rope is no Kelvin–Voigt rope."""
        return solver_of(self.experiment).integrator

    def resample(self, rate: float | None = None, *, times: ArrayLike | None = None) -> "Result":
        """The same run with rows at other instants.

        What goes on between two samples (motion, tensions, disturbance, reference position and speed) is interpolated
        linearly; what is set at a sample and held until the next (commands, reference acceleration, all signals of a
        controller's own) keeps the value of the latest row (`interpolation`). Nothing is filtered: fewer rows than
        before may alias.

        Args:
            rate: rows a second, from the first row on; or
            times: (n,) time of each row in s, ascending, none before the first row or after the last.

        Returns:
            A result with those rows; all else, figures of merit too, is the run's.

        Raises:
            ConfigurationError: neither or both are given, the run kept no rows, or a time lies outside.
        """
        return replace(self, columns=resampled(self.columns, instants(self["t"], rate, times)))

    def to_pandas(self) -> "pd.DataFrame":
        """The rows as a `pandas.DataFrame`, a column for each but ``t``, which is the index.

        Its ``attrs`` hold ``units`` and ``meanings`` by column, outcome, end time and figures of merit.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return frames.data_frame(self)

    def to_xarray(self) -> "xr.Dataset":
        """The rows as an `xarray.Dataset`, a variable over ``t`` for each column.

        The ``attrs`` of a variable hold ``units``, ``long_name`` and ``interpolation``, those of the dataset outcome,
        end time and figures of merit.

        Raises:
            MissingExtraError: xarray is not installed.
        """
        return frames.data_set(self)

    def __repr__(self) -> str:
        return view.text(self)

    def _repr_html_(self) -> str:
        """As a notebook shows it."""
        return view.html(self)
