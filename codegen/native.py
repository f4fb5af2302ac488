"""A CasADi function as a compiled NumPy function, vectorised over a batch."""

import ctypes
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.cache import loaded
from dualwinch.codegen.compiler import NON_FINITE, Compiler, find_compiler
from dualwinch.codegen.drivers.unit import recipe
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.source.c_source import PART, c_source

Floats = NDArray[np.float64]

RAW = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
"""Type of the compiled function, called by addresses."""


@dataclass(frozen=True)
class BoundFunction:
    """A compiled function with fixed arrays: a call reads `inputs` and overwrites `outputs`, without any check.

    Pickling binds it again: a copy has its own arrays with the same numbers.

    Attributes:
        inputs, outputs: name → array; fill the inputs in place, as in ``bound.inputs["state"][:] = state``.
    """

    inputs: dict[str, Floats]
    outputs: dict[str, Floats]
    _call: Callable[[], None] = field(repr=False)
    _made_of: "tuple[CompiledFunction, tuple[int, ...]]" = field(repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        return _bound_again, (*self._made_of, self.inputs, self.outputs)

    def __call__(self) -> None:
        """Evaluate without the global interpreter lock."""
        self._call()


@dataclass(frozen=True)
class CompiledFunction:
    """A compiled function, called like its CasADi function. Pickling compiles it again.

    Attributes:
        name: name of the function.
        inputs, outputs: name → shape ``(rows, columns)``.
    """

    name: str
    inputs: dict[str, tuple[int, int]]
    outputs: dict[str, tuple[int, int]]
    _call: "ctypes._NamedFuncPointer" = field(repr=False)
    _made_of: tuple[ca.Function, Compiler | None, tuple[str, ...]] = field(repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        function, compiler, flags = self._made_of
        return partial(compile, function, compiler, flags=flags), ()

    def bind(self, batch: tuple[int, ...] = (), **constants: ArrayLike) -> BoundFunction:
        """Allocate arrays of zeros for inputs and outputs, and a call between them with minimal overhead.

        For loops in Python, sample by sample.

        Args:
            batch: leading dimensions of every array; shapes are otherwise as in a call.
            constants: inputs that are constant, such as ``parameters=…``: expressions of these alone are computed once,
                and the rest is compiled anew.

        Raises:
            TypeError: unknown inputs.
            ValueError: a wrong shape.
        """
        if constants:
            return compile(self._with(constants), *self._made_of[1:2], flags=self._made_of[2]).bind(batch)
        count = math.prod(batch)
        sides = [
            {name: np.zeros((*batch, rows * columns)) for name, (rows, columns) in shapes.items()}
            for shapes in (self.inputs, self.outputs)
        ]
        steps = (ctypes.c_int64 * len(self.inputs))(*(rows * columns for rows, columns in self.inputs.values()))
        inputs, outputs = (
            (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays.values())) for arrays in sides
        )
        input_arrays = {name: _unshaped(array, self.inputs[name]) for name, array in sides[0].items()}
        output_arrays = {name: _unshaped(array, self.outputs[name]) for name, array in sides[1].items()}
        # addresses need no conversion; the attribute keeps their arrays alive
        raw = RAW(ctypes.cast(self._call, ctypes.c_void_p).value or 0)
        arguments = tuple(ctypes.addressof(array) for array in (inputs, steps, outputs))
        call = partial(raw, *arguments, count)
        call.arrays = inputs, steps, outputs, sides, self._call  # pyright: ignore[reportAttributeAccessIssue]
        return BoundFunction(input_arrays, output_arrays, call, (self, batch))

    def _with(self, constants: dict[str, ArrayLike]) -> ca.Function:
        """The function with some inputs constant."""
        self._bound((), constants, partly=True)
        function = self._made_of[0]
        values = {
            name: ca.reshape(ca.DM(_shaped(name, value, self.inputs[name]).ravel()), *self.inputs[name])
            for name, value in constants.items()
        }
        symbols = {name: ca.MX.sym(name, *shape) for name, shape in self.inputs.items() if name not in values}
        results = function.call([(values | symbols)[name] for name in self.inputs])
        return ca.Function(function.name(), list(symbols.values()), results, list(symbols), list(self.outputs))

    def __call__(self, *arguments: ArrayLike, **named: ArrayLike) -> Floats | tuple[Floats, ...]:
        """Evaluate for one set of arguments or for many, without the global interpreter lock.

        Args:
            arguments: in order; a scalar input takes (...), a column vector of n (..., n), a matrix (..., n, m). The
                leading dimensions are broadcast as in NumPy.
            named: arguments by name.

        Returns:
            The outputs in order, shaped likewise; a single output by itself.

        Raises:
            TypeError: missing, unknown or repeated arguments.
            ValueError: a wrong shape, or batches that do not broadcast.
        """
        inputs = self._bound(arguments, named)
        arrays = [_shaped(name, inputs[name], shape) for name, shape in self.inputs.items()]
        batch = np.broadcast_shapes(*(array.shape[:-1] for array in arrays))
        count = math.prod(batch)
        columns = [
            np.ascontiguousarray(np.broadcast_to(array, (*batch, array.shape[-1])) if array.ndim > 1 else array)
            for array in arrays
        ]
        results = [np.empty((*batch, rows * width)) for rows, width in self.outputs.values()]
        steps = (ctypes.c_int64 * len(columns))(*(0 if column.ndim == 1 else column.shape[-1] for column in columns))
        inputs, outputs = (
            (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays)) for arrays in (columns, results)
        )
        self._call(inputs, steps, outputs, count)
        shaped = [_unshaped(result, shape) for result, shape in zip(results, self.outputs.values(), strict=True)]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    def _bound(
        self, arguments: tuple[ArrayLike, ...], named: dict[str, ArrayLike], *, partly: bool = False
    ) -> dict[str, ArrayLike]:
        names = list(self.inputs)
        if len(arguments) > len(names):
            raise TypeError(f"{self.name}() takes {len(names)} arguments ({', '.join(names)}), {len(arguments)} given")
        values = dict(zip(names, arguments, strict=False))
        for name in named:
            if name not in self.inputs or name in values:
                what = "twice the argument" if name in values else "no argument"
                raise TypeError(f"{self.name}() takes {what} '{name}'; its arguments are {', '.join(names)}")
        values |= named
        absent = [name for name in names if name not in values]
        if absent and not partly:
            raise TypeError(f"{self.name}() misses {', '.join(absent)}")
        return values


def _shaped(name: str, value: ArrayLike, shape: tuple[int, int]) -> Floats:
    """The value as (..., elements), in column-major order."""
    array, (rows, columns) = np.asarray(value, float), shape
    if shape == (1, 1):
        return array[..., np.newaxis]
    if columns == 1 and array.shape[-1:] == (rows,):
        return array
    if columns != 1 and array.shape[-2:] == shape:
        return np.swapaxes(array, -1, -2).reshape(*array.shape[:-2], rows * columns)
    shape_text = f"(..., {rows})" if columns == 1 else f"(..., {rows}, {columns})"
    raise ValueError(f"{name}: shape {array.shape} must be {shape_text}")


def _unshaped(result: Floats, shape: tuple[int, int]) -> Floats:
    if shape == (1, 1):
        return result[..., 0]
    if shape[1] == 1:
        return result
    return np.swapaxes(result.reshape(*result.shape[:-1], shape[1], shape[0]), -1, -2)


def compile(  # noqa: A001
    function: ca.Function, compiler: Compiler | None = None, *, flags: tuple[str, ...] = ()
) -> CompiledFunction:
    """Compile a CasADi function to a NumPy function, vectorised over a batch.

    The library is kept in the cache folder and reused.

    Args:
        function: SX or MX expressions; sparse inputs and outputs become dense. A function beyond elementary operations
            (e.g. with a solver) uses CasADi's own C, with a `CodegenWarning`.
        compiler: default: that of `find_compiler`.
        flags: additional flags for the compiler.

    Raises:
        CodegenError: the function has no inputs or outputs, or CasADi generates no C for it.
        CompilerNotFoundError: there is no C compiler.
        CompileError: it failed.
        CacheError: the cache folder cannot be used.

    Example:
        >>> import casadi as ca
        >>> import dualwinch as dw
        >>> x = ca.SX.sym("x", 2)
        >>> length = dw.compile(ca.Function("length", [x], [ca.norm_2(x)]))
        >>> length([[3.0, 4.0], [5.0, 12.0]])
        array([ 5., 13.])
    """
    if not isinstance(function, ca.Function):
        raise CodegenError(f"function: must be a CasADi Function, not {type(function).__name__}")
    if not (function.n_in() and function.n_out()):
        raise CodegenError(f"{function.name()}: must have an input and an output")
    made_of = recipe((function,), "native", PART)
    native_library = loaded(
        lambda: _source(function), compiler or find_compiler(), (*NON_FINITE, *flags), made_of, run="pppn"
    )
    return CompiledFunction(
        name=function.name(),
        inputs={name: (function.size1_in(name), function.size2_in(name)) for name in function.name_in()},
        outputs={name: (function.size1_out(name), function.size2_out(name)) for name in function.name_out()},
        _call=native_library.run,
        _made_of=(function, compiler, flags),
    )


def _bound_again(
    function: CompiledFunction, batch: tuple[int, ...], inputs: dict[str, Floats], outputs: dict[str, Floats]
) -> BoundFunction:
    """A function bound to new arrays with copies of the numbers of `inputs` and `outputs`."""
    bound = function.bind(batch)
    for bound_arrays, arrays in ((bound.inputs, inputs), (bound.outputs, outputs)):
        for name, array in bound_arrays.items():
            array[...] = arrays[name]
    return bound


def _source(function: ca.Function) -> str:
    """C99 translation unit that evaluates a function for a batch, with arrays in column-major order."""
    ins, outs = ([f"{word}{k}" for k in range(n)] for word, n in (("in", function.n_in()), ("out", function.n_out())))
    kind: Any = ca.SX
    try:
        called = function.expand()
    except RuntimeError:
        kind, called = ca.MX, function
    symbols = [kind.sym(name, function.numel_in(index)) for index, name in enumerate(ins)]
    shaped = [ca.reshape(symbol, *function.size_in(index)) for index, symbol in enumerate(symbols)]
    results = [ca.vec(ca.densify(result)) for result in called.call(shaped)]
    name = f"{function.name()}_"  # avoids names of the C library and `run`
    definition = c_source([ca.Function(name, symbols, results, ins, outs, {"cse": True})], part=PART)
    arguments = [f"inputs[{index}] + k * steps[{index}]" for index in range(len(ins))]
    arguments += [f"outputs[{index}] + k * {result.numel()}" for index, result in enumerate(results)]
    return f"""{definition}
#include <stdint.h>
#if defined(_WIN32)
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
void run(const double *const *inputs, const int64_t *steps, double *const *outputs, int64_t count) {{
  for (int64_t k = 0; k < count; ++k)
    {name}({", ".join(arguments)});
}}
"""
