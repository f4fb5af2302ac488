"""A C package on this machine, called from Python: what emulated processors and tests are compared with."""

import ctypes
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.block import Block
from dualwinch.codegen.export.package import prepared
from dualwinch.codegen.source.operations import Precision

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Wshadow", "-Werror")
PRECISE = ("-Wdouble-promotion", "-Wfloat-conversion")
"""Flags of a package in single precision: no operation in double, not by accident either."""


def build(folder: Path, package: Mapping[str, str], name: str, compiler: Sequence[str], *flags: str) -> Path:
    """Write a package's files to a folder and build it as a shared library, with every warning an error."""
    for file, text in package.items():
        (folder / file).write_text(text)
    library = folder / f"{name}.so"
    command = [*compiler, *STRICT, "-O1", "-ffp-contract=off", *flags, "-shared", "-fPIC", f"{name}.c"]
    done = subprocess.run([*command, "-o", library, "-lm"], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[:2000])
    return library


class Host:
    """One instance of a package in a shared library.

    Attributes:
        state: the states, then the output that belongs to them; may be written to.
        input, output: likewise, in the block's order.
        lost: what rounding took from states that are sums, in single precision.
        parameters: in the block's order; what is written to them has its effect with `prepare`.
        prepared: what a step needs of them.
    """

    def __init__(
        self, library: Path, name: str, block: Block, precision: Precision = "double", *, freeze: bool = False
    ) -> None:
        """Load and initialise an instance."""
        kind = np.float32 if precision == "float" else np.float64
        self.input, self.output = np.zeros(len(block.inputs), kind), np.zeros(len(block.outputs), kind)
        self.parameters = np.zeros(len(block.parameters), kind)
        apart, states = prepared(block, precision), len(block.states) + len(block.outputs)
        self._memory = np.zeros(states + apart.lost, kind)
        self.state, self.lost = self._memory[:states], self._memory[states:]
        numbers = (
            0 if freeze else len(apart.parameters) + apart.derived + 2
        )  # the last two have room for checksum and mark
        self.prepared = np.zeros(numbers, kind)
        self._library, self._name = ctypes.CDLL(str(library)), name
        self._constants: tuple[ctypes.c_void_p, ...] = (
            () if freeze else (self._pointer(self.parameters), self._pointer(self.prepared))
        )
        self._step: Any = self._function("step")
        self._step_arguments = (
            self._pointer(self.state),
            self._pointer(self.input),
            *self._constants[1:],
            self._pointer(self.output),
        )
        self.status = self._function("init")(self._pointer(self.state), *self._constants)
        self._function("rest")(self._pointer(self.input))

    def _function(self, part: str) -> Any:
        return self._library[f"{self._name}_{part}"]

    @staticmethod
    def _pointer(array: NDArray[Any]) -> ctypes.c_void_p:
        return ctypes.c_void_p(array.ctypes.data)

    def step(self) -> int:
        """One sample from `input` to `output`; its status."""
        return self._step(*self._step_arguments)

    def prepare(self) -> int:
        """Let the following calls know of changed `parameters`; the status."""
        return self._function("prepare")(*self._constants)

    def invalid_parameter(self) -> int:
        """Position of the first invalid one of `parameters`, from 1; 0: none."""
        return self._function("invalid_parameter")(self._constants[0])

    def checksum(self) -> int:
        """CRC-32 of the `parameters`."""
        checksum = self._function("checksum")
        checksum.restype = ctypes.c_uint32
        return checksum(self._constants[0])

    def reset(self) -> int:
        """The state before the first sample; its status."""
        return self._function("reset")(self._pointer(self.state), *self._constants[1:])

    def run(self, inputs: NDArray[Any]) -> NDArray[Any]:
        """Outputs (samples, outputs) of a step for every line of inputs."""
        outputs = np.empty((len(inputs), len(self.output)), self.output.dtype)
        for line, output in zip(inputs, outputs, strict=True):
            self.input[:] = line
            self.step()
            output[:] = self.output
        return outputs
