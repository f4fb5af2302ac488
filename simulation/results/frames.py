"""Results as tables of other libraries, with units."""

from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any

from dualwinch.model.errors import MissingExtraError
from dualwinch.simulation.results.content import about
from dualwinch.simulation.results.run import Run

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


TIME = "t"
"""The column that becomes index or coordinate."""


def data_frame(result: Run) -> "pd.DataFrame":
    """See `Result.to_pandas`."""
    pandas = _extra("pandas")
    index = pandas.Index(result[TIME], name=TIME)
    frame = pandas.DataFrame({name: result[name] for name in result if name != TIME}, index=index)
    meanings = {name: quantity.meaning for name, quantity in result.quantities.items()}
    frame.attrs = {"units": result.units, "meanings": meanings, **_facts(result)}
    return frame


def data_set(result: Run) -> "xr.Dataset":
    """See `Result.to_xarray`."""
    xarray = _extra("xarray")
    arrays = {name: xarray.Variable(TIME, result[name], _attributes(result, name)) for name in result}
    return xarray.Dataset(
        {name: array for name, array in arrays.items() if name != TIME}, {TIME: arrays[TIME]}, _facts(result)
    )


def _attributes(result: Run, name: str) -> Mapping[str, str]:
    """As the climate and forecast conventions name them: xarray writes them on the axes of its figures."""
    said = about(result.quantities[name])
    return {"units": said["unit"], "long_name": said["meaning"], "interpolation": result.interpolation[name]}


def _facts(result: Run) -> dict[str, Any]:
    return {"outcome": result.outcome, "end_time": result.end_time, **result.metrics}


def _extra(name: str) -> ModuleType:
    """An optional library.

    Raises:
        MissingExtraError: it is not installed.
    """
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError:
        raise MissingExtraError(f"{name} is not installed; install it with: pip install 'dualwinch[{name}]'") from None
