"""Options that several commands share."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

ControllerName = Literal["fando-nftsm", "nftsm", "pid-cascade", "super-twisting", "adrc"]

Case = Annotated[int | None, Parameter(help="Case 1 to 4 of the paper.")]

Config = Annotated[Path | None, Parameter(help="Experiment to read, TOML (see `dualwinch config`).")]

Assignments = Annotated[
    list[str] | None,
    Parameter(name="--set", help="key=value, any key of `dualwinch config`; may be repeated.", negative=""),
]

AssignmentsInBrief = Annotated[
    list[str] | None, Parameter(name="--set", help="key=value; may be repeated.", negative="")
]

Figure = Annotated[Path | None, Parameter(help="File for a figure: .png, .svg or .pdf.")]
