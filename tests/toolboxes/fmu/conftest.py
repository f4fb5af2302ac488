from functools import cache
from pathlib import Path

import pytest

from dualwinch.simulation.paper import case
from dualwinch.toolboxes.fmu.export import export_fmu
from tests.fmus import Exported


@pytest.fixture(scope="session")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Exported:
    """``exported(what, version)``: an FMU of Case 4 for this machine."""

    @cache
    def made(what: str, version: int) -> Path:
        path = tmp_path_factory.mktemp("fmu") / f"{what}.fmu"
        export_fmu(case(4), path, block=what, fmi=version)  # pyright: ignore[reportArgumentType]
        return path

    return made
