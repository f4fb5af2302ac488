"""Functional Mock-up Units of a block: model description, C sources and binaries of FMI 2 and FMI 3."""

from dualwinch.toolboxes.fmu.build import PLATFORMS, Platform, archive, build_fmu, find_platform, host_platform
from dualwinch.toolboxes.fmu.description import About
from dualwinch.toolboxes.fmu.model import FMU_KINDS, VERSIONS, FmuModel, Kind, Version, fmu_model

__all__ = [
    "FMU_KINDS",
    "PLATFORMS",
    "VERSIONS",
    "About",
    "FmuModel",
    "Kind",
    "Platform",
    "Version",
    "archive",
    "build_fmu",
    "find_platform",
    "fmu_model",
    "host_platform",
]
