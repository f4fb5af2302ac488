"""The controller in Structured Text, compiled by matiec, beside the C package over whole runs: bit for bit.

matiec (``iec2c``) turns IEC 61131-3 into C. It is free software under its own licence and no part of this product: it
is built in a folder of its own, whose path the command takes.
"""

import ctypes
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.document import command, markdown, publish
from benchmarks.embedded.host import Host, build
from dualwinch.codegen.block import Block
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package, prepared
from dualwinch.codegen.source.operations import PRECISIONS, Precision
from dualwinch.config.experiment_file import load
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import asked_motion
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.plc.project import identifier
from dualwinch.toolboxes.plc.structured_text import operation_count, st_package

NAME = "controller"
ABOUT = Provenance("dualwinch", "benchmark", "2026-01-01")
SITE = Path(__file__).parent / "independent" / "searched.toml"

GLUE = """
#include <tgmath.h> /* functions of a REAL in single precision */
#include "iec_std_lib.h"
#include "accessor.h"
#include "POUS.h"
#include "POUS.c"
TIME __CURRENT_TIME;
BOOL __DEBUG;
static CONTROLLER instance;
void st_begin(void) {{ CONTROLLER_init__(&instance, 0); }}
int st_step(const {real} *input, {real} *output) {{
  {inputs}
  CONTROLLER_body__(&instance);
  {outputs}
  return __GET_VAR(instance.STATUS);
}}
"""


CPUS = {"1511": 384, "1513": 256, "1515": 192, "1516": 64, "1518": 6}
"""Typical time in ns of an operation on REAL, by CPU of the S7-1500 (Siemens, Cycle and response times, 2014)."""

CALL = 10
"""Operations that a call of EXP, LN, SIN and so on is taken for, and a square root."""

CALLS = ("square roots", "EXP, LN, SIN, …")
"""Kinds of operations that are calls."""


@dataclass(frozen=True)
class Comparison:
    """A run of the Structured Text beside the C package's.

    Attributes:
        numbers: how many were compared.
        different: how many of the numbers differ in a bit.
        largest: the largest difference, as a share of the largest value of its output.
    """

    numbers: int
    different: int
    largest: float


def controller_inputs(experiment: Experiment, controller: Block) -> NDArray[np.float64]:
    """What a controller reads (samples, inputs) in a run: the sensors' readings and the reference."""
    result = simulate(override(experiment, {"simulation.readings": True}))
    columns = asked_motion(result.experiment) | result.columns
    names = [each.name for each in controller.inputs]
    return np.column_stack([columns[f"{name}_read" if f"{name}_read" in columns else name] for name in names])


def compiled_st(folder: Path, controller: Block, precision: Precision, iec2c: Path) -> ctypes.CDLL:
    """The controller's Structured Text through matiec and the C compiler of this machine.

    Raises:
        RuntimeError: either of them refuses it.
    """
    files = st_package(controller, NAME, ABOUT, precision)
    (folder / "all.st").write_text(files[f"{NAME}.st"] + files["main.st"])
    library = iec2c.resolve().parent / "lib"
    real = {"double": "double", "float": "float"}[precision]
    names = [[identifier(each.name).upper() for each in part] for part in (controller.inputs, controller.outputs)]
    inputs = "\n  ".join(f"__SET_VAR(instance.,{name},,input[{k}]);" for k, name in enumerate(names[0]))
    outputs = "\n  ".join(f"output[{k}] = __GET_VAR(instance.{name});" for k, name in enumerate(names[1]))
    (folder / "glue.c").write_text(GLUE.format(real=real, inputs=inputs, outputs=outputs))
    compiler = [*find_compiler().command, "-O1", "-ffp-contract=off", "-w", "-shared", "-fPIC", "-I", library / "C"]
    for call in (
        [iec2c.resolve(), "-I", library, "-T", ".", "all.st"],
        [*compiler, "-I", ".", "glue.c", "-o", "st.so", "-lm"],
    ):
        outcome = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
        if outcome.returncode:
            raise RuntimeError((outcome.stdout + outcome.stderr)[:2000])
    return ctypes.CDLL(str(folder / "st.so"))


def compare(experiment: Experiment, precision: Precision, iec2c: Path) -> Comparison:
    """Run both over the same inputs."""
    controller = block("controller", experiment)
    kind = np.float32 if precision == "float" else np.float64
    inputs = np.ascontiguousarray(controller_inputs(experiment, controller), kind)
    outputs = np.empty((len(inputs), len(controller.outputs)), kind)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        st = compiled_st(folder, controller, precision, iec2c)
        package = c_package(controller, NAME, ABOUT, precision)
        host = Host(build(folder, package, NAME, find_compiler().command), NAME, controller, precision)
        st.st_begin()
        for given, output in zip(inputs, outputs, strict=True):
            st.st_step(ctypes.c_void_p(given.ctypes.data), ctypes.c_void_p(output.ctypes.data))
        expected = host.run(inputs)
    apart_by = np.abs(outputs - expected).max(axis=0) / np.maximum(np.abs(expected).max(axis=0), np.finfo(kind).tiny)
    return Comparison(
        numbers=outputs.size,
        different=int((outputs != expected).sum()),
        largest=float(apart_by.max()),
    )


COMPARED = ("50 s of", "numbers compared, each", *(f"different, {kind}" for kind in PRECISIONS), "largest difference")
LOAD = (
    "controller",
    "operations a sample",
    "of these calls",
    "preparing",
    *(f"{cpu} ({ns} ns), ms" for cpu, ns in CPUS.items()),
)


def experiments() -> dict[str, Experiment]:
    """The experiments whose controllers are compared, by their names in the tables."""
    return {
        "Case 4": case(4),
        "Case 4, Kalman filter": override(case(4), {"controller.estimator": "kalman"}),
        "Case 4, MPC": override(case(4), {"controller.kind": "mpc"}),
        "`site`, tuned gains": override(load(SITE), {"simulation.duration": 50.0}),
    }


def comparisons(iec2c: Path) -> str:
    """The table of comparisons in Markdown.

    Raises:
        RuntimeError: a compiler refuses its input.
    """
    rows = list[list[str]]()
    for name, experiment in experiments().items():
        runs = [compare(experiment, precision, iec2c) for precision in PRECISIONS]
        counts = (f"{count:,}".replace(",", " ") for count in (runs[0].numbers, *(run.different for run in runs)))
        rows.append([name, *counts, f"{max(run.largest for run in runs):.1g}"])
    compilers = [
        subprocess.run([*command, "--version"], capture_output=True, text=True, check=False).stdout.partition("\n")[0]
        for command in ([iec2c, "-v"], find_compiler().command)
    ]
    return f"{markdown(COMPARED, rows)}\n\n*{' · '.join(filter(None, compilers))}*"


def loads() -> str:
    """The table of operations, and what they take on each CPU, in Markdown."""
    rows = list[list[str]]()
    for name, experiment in experiments().items():
        apart = prepared(block("controller", experiment), "double")
        step, prepare = operation_count(apart.step), operation_count(apart.derive)
        calls = sum(count for kind, count in step.kinds.items() if kind in CALLS)
        worth = step.total + (CALL - 1) * calls
        times = [f"{worth * ns * 1e-6:.2g}" for ns in CPUS.values()]
        counts = (f"{count:,}".replace(",", " ") for count in (step.total, calls, prepare.total))
        rows.append([name, *counts, *times])
    return markdown(LOAD, rows)


def main() -> int:
    """Run the command line; 0 done, 1 where a compiler is missing or refuses its input."""
    parser = command(__doc__)
    parser.add_argument(
        "iec2c",
        type=Path,
        nargs="?",
        metavar="IEC2C",
        help="matiec's compiler, in its own folder beside lib/; without it only the operations of a sample are counted",
    )
    chosen = parser.parse_args()
    if chosen.iec2c and not chosen.iec2c.is_file():
        parser.error(f"{chosen.iec2c}: there is no such file")
    try:
        tables = {"plc load": loads()} | ({"plc": comparisons(chosen.iec2c)} if chosen.iec2c else {})
        publish(chosen.write, tables)
    except (RuntimeError, OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
