"""A package on an emulated Cortex-M: built by the bare-metal GCC, run by QEMU, measured."""

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.source.operations import Precision

COMPILER, EMULATOR, SIZE = "arm-none-eabi-gcc", "qemu-system-arm", "arm-none-eabi-size"

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-ffunction-sections", "-fstack-usage", "-mthumb", "-mfloat-abi=hard")
STRICT = ("-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Wdouble-promotion", "-Werror")

CLOCK, SHIFT = 25e6, 10
"""The boards' clock in Hz; QEMU lets 2**SHIFT ns pass with every instruction."""

TICKS = 2**SHIFT * 1e-9 * CLOCK
"""Clock ticks an instruction."""


@dataclass(frozen=True)
class Board:
    """A processor, the board QEMU has it on, where that has its large memory, and what its FPU computes in."""

    name: str
    machine: str
    processor: tuple[str, ...]
    memory: int
    precision: Precision = "float"


BOARDS = (
    Board("Cortex-M4F", "mps2-an386", ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"), 0x21000000),
    Board("Cortex-M7", "mps2-an500", ("-mcpu=cortex-m7", "-mfpu=fpv5-sp-d16"), 0x60000000),
)
DOUBLE_BOARD = Board("Cortex-M7", "mps2-an500", ("-mcpu=cortex-m7", "-mfpu=fpv5-d16"), 0x60000000, "double")
"""The Cortex-M7 with its other FPU."""


@dataclass(frozen=True)
class Measurement:
    """What a run on a board gave.

    Attributes:
        outputs: (samples, outputs) in the board's precision.
        instructions: (samples,) of every step, call included.
        preparation: instructions of preparing the parameters, where there are any.
        code: bytes of the package's functions and constants.
        stack: deepest stack in bytes that the run used in a step, C library included.
        declared_stack: bytes that the package's own functions take of it, as the compiler says.
        symbols: of everything that is linked.
    """

    outputs: NDArray[Any]
    instructions: NDArray[np.int64]
    preparation: int
    code: int
    stack: int
    declared_stack: int
    symbols: tuple[str, ...]


def missing() -> list[str]:
    """The programs this needs and the machine lacks."""
    return [name for name in (COMPILER, EMULATOR, SIZE) if shutil.which(name) is None]


def measure(
    board: Board, package: Mapping[str, str], name: str, inputs: NDArray[Any], outputs: int, *, freeze: bool
) -> Measurement:
    """Build a package of the board's precision for it and step it once for every line of inputs.

    Args:
        board: where to run.
        package: its files.
        name: of the package.
        inputs: (samples, inputs).
        outputs: number of outputs.
        freeze: whether the package's parameters are constants.

    Raises:
        RuntimeError: a program fails; the message is what it says.
    """
    with tempfile.TemporaryDirectory() as given:
        folder = Path(given)
        for file, text in package.items():
            (folder / file).write_text(text)
        for file in ("firmware.c", "board.ld"):
            (folder / file).write_text((files("benchmarks.embedded") / file).read_text())
        real = np.float32 if board.precision == "float" else np.float64
        inputs.astype(real).tofile(folder / "inputs.bin")
        build = (COMPILER, *board.processor, *FLAGS)
        _call(folder, *build, *STRICT, "-c", f"{name}.c")
        facts = (f'-DHEADER="{name}.h"', f"-DNAME={name}", f"-DSAMPLES={len(inputs)}", f"-DFROZEN={int(freeze)}")
        _call(folder, *build, *facts, "-c", "firmware.c")
        linker = (
            f"-Wl,--defsym=large_memory={board.memory}",
            "-nostartfiles",
            "--specs=nosys.specs",
            "-Wl,--gc-sections",
            "-Wl,--no-warn-rwx-segments",
        )
        _call(folder, *build, *linker, "-Tboard.ld", "firmware.o", f"{name}.o", "-lm", "-o", "firmware.elf")
        entry = ("-Wl,--defsym=_start=0", f"-Wl,-e,{name}_step", f"-Wl,-u,{name}_init", "-Wl,-Map=alone.map")
        _call(folder, *build, *linker, *entry, f"{name}.o", "-lm", "-o", "alone.elf")
        _call(
            folder, EMULATOR, "-machine", board.machine, "-nographic", "-monitor", "none", "-serial", "none",
            "-icount", f"shift={SHIFT},sleep=off", "-semihosting-config", "enable=on,target=native",
            "-kernel", "firmware.elf",
        )  # fmt: skip
        words = (folder / "outputs.bin").read_bytes()
        empty_call, stack, preparation = np.frombuffer(words, np.uint32, 3).astype(float)
        row = np.dtype([("outputs", real, outputs), ("ticks", np.uint32)], align=True)
        table = np.frombuffer(words, row, offset=12)
        frames = dict(re.findall(r":(\w+)\t(\d+)\t", (folder / f"{name}.su").read_text()))
        inner = max(int(frames.get(called, 0)) for called in ("evaluate", "accept"))
        return Measurement(
            outputs=table["outputs"],
            instructions=np.rint((table["ticks"] - empty_call) / TICKS).astype(np.int64),
            preparation=round(max(preparation - empty_call, 0) / TICKS),
            code=_size(folder, f"{name}.o"),
            stack=int(stack),
            declared_stack=int(frames[f"{name}_step"]) + inner,
            symbols=tuple(_call(folder, "arm-none-eabi-nm", "--format=just-symbols", "alone.elf").split()),
        )


def _size(folder: Path, file: str) -> int:
    """Bytes of code and constants."""
    return int(_call(folder, SIZE, file).splitlines()[1].split()[0])


def _call(folder: Path, *command: str) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)
    if done.returncode:
        raise RuntimeError(f"{command[0]}: {(done.stderr or done.stdout).strip()[:2000]}")
    return done.stdout
