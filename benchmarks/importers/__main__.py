"""Run Case 4 by every importer that is installed, and print how far each is from `dualwinch simulate`.

``--write FILE`` puts the table between the file's two marks.
"""

import tempfile
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import get_context
from pathlib import Path

import casadi as ca
import numpy as np
from rich.console import Console

from benchmarks.document import command, markdown, publish
from benchmarks.importers.co_simulation import IMPORTERS, Floats, error
from dualwinch.simulation.blocks import BLOCKS, block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.fmu.export import export_fmu

SLOPES = "CasADi's `DaeBuilder`, plant: Jacobian from directional derivatives"
"""Row of what CasADi imports: relative to the largest element."""


def slopes(folder: Path, version: int) -> float:
    """Largest relative difference of the derivatives' Jacobian by the states, in CasADi's importer."""
    import fmpy

    made = block("plant", case(4))
    if made.derivative is None:
        raise RuntimeError("the plant has no derivative")
    parameters, given = ([variable.start for variable in group] for group in (made.parameters, made.inputs))
    state = np.array(made.initial(parameters)).ravel() + np.array([1.0, 0.5, 0.1, 0.2, -0.1, 0.1, 0.3, 100, 0.0])
    unpacked = str(fmpy.extract(str(folder / f"plant{version}.fmu")))
    continuous = len(made.continuous)
    imported = ca.DaeBuilder("plant", unpacked).create("imported", ["x", "u"], ["ode", "y"])
    found = ca.DM(imported.jacobian()(state[:continuous], given, 0, 0)[0]).full()
    expected = ca.DM(made.derivative.jacobian()(state, given, parameters, 0, 0)[0]).full()[:, :continuous]
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def answers(folder: Path, version: int, reference: Floats, expected: Floats) -> dict[str, str]:
    """What every importer finds of one version of FMI, in words; each runs in a process of its own."""
    findings: dict[str, str] = {}
    for name in IMPORTERS:
        with ProcessPoolExecutor(1, get_context("spawn")) as process:
            try:
                found = process.submit(error, name, folder, version, reference, expected).result()
                findings[name] = f"{found:.1e} m"
            except ImportError:
                findings[name] = "not installed"
            except BrokenProcessPool:
                findings[name] = "its process crashes"
            except Exception as problem:  # noqa: BLE001  # whatever a foreign importer says is the answer
                findings[name] = f"refuses: {str(problem).splitlines()[0]}"
    findings[SLOPES] = f"{slopes(folder, version):.1e}"
    return findings


def main() -> None:
    """Export, run, print or write."""
    document = command(__doc__).parse_args().write
    reference, expected = exogenous_signals(case(4))[:, :3], simulate(case(4)).columns["x"]
    with tempfile.TemporaryDirectory() as made, Console(stderr=True).status("running"):
        folder = Path(made)
        for version in (2, 3):
            for name in BLOCKS:
                export_fmu(case(4), folder / f"{name}{version}.fmu", block=name, fmi=version)
        both = [answers(folder, version, reference, expected) for version in (2, 3)]
    rows = [[name, *(findings[name] for findings in both)] for name in both[0]]
    publish(document, {"importers": markdown(["importer", "FMI 2", "FMI 3"], rows)})


if __name__ == "__main__":
    main()
