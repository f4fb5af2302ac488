"""How tangents pass through a function: its slopes, computed once, and products with them, once a direction."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class Tangents:
    """The tangents of an input: their array in C, and which elements of the input they belong to (None: all)."""

    array: str
    elements: Sequence[int] | None = None


@dataclass(frozen=True)
class Spread:
    """The derivative of a function, in two parts.

    Attributes:
        sloped: ``sloped_NAME(...) -> ..., slopes``: the function itself with one more output, the elements of its
            Jacobian that are not constant.
        statements: C statements that make the tangents of the outputs, ``OUTPUT_tangent``, of those of the inputs and
            the slopes, for one lane.
    """

    sloped: ca.Function
    statements: list[str]


def spread(
    function: ca.Function,
    smooth: ca.Function,
    along: Mapping[str, Tangents],
    outputs: Sequence[str],
    joints: int = 0,
) -> Spread:
    """Split the derivative of a function into its slopes and products with them.

    Where everything goes through a few signals, cutting a function there makes its Jacobian far sparser: `smooth` may
    have one more input ``cut`` and output ``returned``, of values each of which depends on those before it alone.

    Args:
        function: of SX expressions.
        smooth: what is differentiated in its place, of the same inputs and outputs.
        along: input name → its tangents.
        outputs: names of the outputs that are differentiated.
        joints: number of signals `smooth` is cut at.
    """
    inputs = {name: ca.SX.sym(name, function.size1_in(name)) for name in function.name_in()}
    symbols, true = dict(inputs), dict(inputs)
    if joints:
        symbols["cut"], true["cut"] = ca.SX.sym("cut", joints), ca.SX(joints, 1)
        for _ in range(joints):
            true["cut"] = smooth.call(true)["returned"]
    values = smooth.call(symbols)
    columns = [symbols[name] if t.elements is None else symbols[name][list(t.elements)] for name, t in along.items()]
    rows = ["returned", *outputs] if joints else [*outputs]
    by = ca.vertcat(*columns, *([symbols["cut"]] if joints else []))
    slopes_at = ca.Function(
        "slopes_at", list(symbols.values()), [ca.jacobian(ca.vertcat(*(values[o] for o in rows)), by)]
    )
    jacobian = slopes_at(*(true[name] for name in symbols))

    varying = [place for place in range(jacobian.nnz()) if not jacobian.nz[place].is_constant()]
    called = function.call(inputs)
    results = {name: called[name] for name in function.name_out()}
    results["slopes"] = ca.densify(ca.vertcat(*(jacobian.nz[place] for place in varying)))
    sources = [f"{t.array}[{k}*LANES]" for t, c in zip(along.values(), columns, strict=True) for k in range(c.numel())]
    sources += [f"joint_{k}" for k in range(joints)]
    targets = [f"const double joint_{k}" for k in range(joints)]
    targets += [f"{name}_tangent[{k}*LANES]" for name in outputs for k in range(values[name].numel())]
    return Spread(
        sloped=ca.Function(
            f"sloped_{function.name()}",
            list(inputs.values()),
            list(results.values()),
            list(inputs),
            list(results),
            {"cse": True},
        ),
        statements=_products(jacobian, varying, sources, targets),
    )


def _products(jacobian: ca.SX, varying: list[int], sources: list[str], targets: list[str]) -> list[str]:
    """One statement a row: constants stand in it, the other elements are those of the array `slopes`."""
    terms: list[list[str]] = [[] for _ in targets]
    factors = {place: f"slopes[{k}]" for k, place in enumerate(varying)}
    for place, (row, column) in enumerate(zip(jacobian.sparsity().row(), jacobian.sparsity().get_col(), strict=True)):
        if place in factors:
            terms[row].append(f"{factors[place]} * {sources[column]}")
        elif constant := float(jacobian.nz[place]):
            terms[row].append(sources[column] if constant == 1 else f"{constant!r} * {sources[column]}")
    return [f"{target} = {' + '.join(row) or '0.0'};" for target, row in zip(targets, terms, strict=True)]
