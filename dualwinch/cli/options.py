"""Options that several commands share."""

import re
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token

LAWS = "fando-nftsm, nftsm, pid-cascade, super-twisting, adrc, lqi, eid, rbf-sliding-mode, mpc"
ESTIMATORS = "none, lowpass, kalman, calibrating-kalman, self-calibrating-kalman"
COORDINATIONS = "differential-tension, scheduled-preload, master-slave, force-position"
OWN = "or the kind of a part of your own (see --plugin)"

Law = Annotated[str | None, Parameter(name="--controller", help=f"Position law: {LAWS}, {OWN}.")]

Estimator = Annotated[str | None, Parameter(help=f"Estimator: {ESTIMATORS}, {OWN}.")]

Plugins = Annotated[
    list[str] | None,
    Parameter(name="--plugin", help="Python file, or module, with parts of your own; may be repeated.", negative=""),
]

MOST_DIGITS = 18
"""Digits of a whole number on the command line."""


def whole(kind: Any, tokens: Sequence[Token]) -> int:  # noqa: ARG001
    """A whole number as it is written; cyclopts would round 1.5."""
    text = tokens[0].value.strip()
    digits = text.removeprefix("-").removeprefix("+")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= MOST_DIGITS):
        raise ValueError(f"{text!r} must be a whole number of at most {MOST_DIGITS} digits")
    return int(text)


WHOLE = Parameter(converter=whole)
"""Beside the type of every option that is a whole number."""

Case = Annotated[int | None, WHOLE, Parameter(help="Case 1 to 4 of the paper.")]

Config = Annotated[Path | None, Parameter(help="Experiment to read, TOML (see `dualwinch config`).")]

Assignments = Annotated[
    list[str] | None,
    Parameter(name="--set", help="key=value, any key of `dualwinch config`; may be repeated.", negative=""),
]

AssignmentsInBrief = Annotated[
    list[str] | None, Parameter(name="--set", help="key=value; may be repeated.", negative="")
]

Priors = Annotated[
    list[str] | None,
    Parameter(name="--prior", help="Prior, key=mean±sd (or key=mean+-sd); may be repeated.", negative=""),
]

Figure = Annotated[Path | None, Parameter(help="File for a figure: .png, .svg or .pdf.")]


def with_estimator(estimator: str | None, assignments: list[str] | None) -> list[str]:
    """Assignments with that of an estimator before them."""
    return [*([] if estimator is None else [f"controller.estimator={estimator}"]), *(assignments or [])]


LONGEST_TIME = 1e7
"""Largest number of a time."""


def seconds_from(text: str, option: str = "--time") -> float:
    """A time such as ``60s``, ``5min``, ``2h`` or ``90`` in s.

    Raises:
        ConfigurationError: it is none.
    """
    from dualwinch.model.errors import ConfigurationError

    parts = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|m|h|)\s*", text)
    if not parts or not 0 < float(parts[1]) <= LONGEST_TIME:
        raise ConfigurationError(f"{option} {text}: must be a time such as 60s, 5min or 2h")
    return float(parts[1]) * {"s": 1, "": 1, "m": 60, "min": 60, "h": 3600}[parts[2]]


def use_parts(plugins: list[str] | None) -> None:
    """Make parts known that are not built in: those of installed packages, and those of given files and modules.

    Raises:
        ConfigurationError: a file or module cannot be imported, or a part not be registered.
    """
    from dualwinch.config.plugins import EntryPointWarning, load_entry_points, load_plugin

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", EntryPointWarning)
        load_entry_points()
    for warning in caught:
        if issubclass(warning.category, EntryPointWarning):
            sys.stderr.write(f"dualwinch: warning: {warning.message}\n")
    for plugin in plugins or []:
        load_plugin(plugin)
