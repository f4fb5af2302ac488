"""Functional Mock-up Units of a block: model description, C sources and binaries of FMI 2 and FMI 3."""

from codegen.fmu.archive import Fmu, build_fmu, fmu_model, write_fmu
from codegen.fmu.description import About
from codegen.fmu.platforms import PLATFORMS, find_platform, host_platform

__all__ = [
    "PLATFORMS",
    "About",
    "Fmu",
    "build_fmu",
    "find_platform",
    "fmu_model",
    "host_platform",
    "write_fmu",
]
