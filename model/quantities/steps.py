"""Steps of parts over symbols: an error in a user's part is one line that says what to write instead."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

import casadi as ca

from dualwinch.codegen.errors import DualwinchError
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import is_array
from dualwinch.model.quantities.tree import leaves
from dualwinch.model.scalar import Scalar

BRANCHES = "use where(condition, a, b) of dualwinch.model.scalar in place of if, and, or, not, min and max"

FUNCTIONS = "use functions of dualwinch.model.scalar or casadi in place of those of math and others"

HINTS = {
    "truth value": BRANCHES,
    "a symbol is no float": FUNCTIONS,
    "to_int not defined": FUNCTIONS,
    "interpreted as an integer": FUNCTIONS,
    "casadi SX does not support": FUNCTIONS,
}
"""Text in an error of Python, CasADi or this module → correction."""

AS_FLOAT = ca.SX.__float__


@contextmanager
def over_symbols(name: str) -> Iterator[None]:
    """Context for the call of a user's function over symbols; messages name it, e.g. ``mine: its step``.

    Converting a symbol to a float is an error in here; CasADi would silently return NaN.

    Raises:
        ConfigurationError: the function needs the value of a symbol.
    """
    ca.SX.__float__ = _float  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    except DualwinchError:
        raise
    except Exception as error:
        hint = next((hint for words, hint in HINTS.items() if words in str(error)), None)
        if hint is None:
            raise
        raise ConfigurationError(f"{name} asks for the value of a symbol; {hint}") from error
    finally:
        ca.SX.__float__ = AS_FLOAT


def _float(symbol: ca.SX) -> float:
    if not symbol.is_constant():
        raise TypeError("a symbol is no float")
    return AS_FLOAT(symbol)


def started(part: Any) -> Any:
    """The state of a part before the first sample.

    Raises:
        ConfigurationError: it is no dataclass of scalars, vectors and matrices.
    """
    with over_symbols(f"{part.kind}: its initial_state"):  # it may depend on the gains
        state = part.initial_state()
    if not is_dataclass(state) or isinstance(state, type):
        raise ConfigurationError(
            f"{part.kind}: its initial_state gives {_word(state)}; must give a dataclass of numbers, vectors and "
            "matrices, which may be empty"
        )
    _check_scalars(part, state, "initial_state")
    return state


def stepped(part: Any, state: Any, gives: type, *inputs: Any) -> tuple[Any, Any]:
    """The next state of a part and its output, of the type `gives`; inputs are the step's further arguments.

    Raises:
        ConfigurationError: the step needs the value of a symbol, or does not return a state like the given one and an
            output of scalars.
    """
    following, output = _given(part, state, inputs, gives.__name__)
    if not isinstance(output, gives):
        raise ConfigurationError(f"{part.kind}: its step gives {_word(output)} as output; must be a {gives.__name__}")
    _check_scalars(part, output, type(output).__name__, [field.name for field in fields(gives)])
    return following, output


def stepped_to_number(part: Any, state: Any, what: str, *inputs: Any) -> tuple[Any, Scalar]:
    """`stepped` of a part whose output is one number, such as a ``torque``.

    Raises:
        ConfigurationError: as in `stepped`.
    """
    following, output = _given(part, state, inputs, what)
    if not isinstance(output, (int, float, ca.SX, ca.DM)) or is_array(output):
        raise ConfigurationError(f"{part.kind}: its step gives {_word(output)} as {what}; must be a number")
    return following, output


def _given(part: Any, state: Any, inputs: Sequence[Any], gives: str) -> tuple[Any, Any]:
    """Next state, checked to be like the given one, and output of a step."""
    with over_symbols(f"{part.kind}: its step"):
        pair = part.step(state, *inputs)
    if not isinstance(pair, tuple) or len(pair) != 2:
        raise ConfigurationError(f"{part.kind}: its step gives {_word(pair)}; must give (state, {gives})")
    following, output = pair
    if type(following) is not type(state):
        raise ConfigurationError(
            f"{part.kind}: its step gives {_word(following)} as next state; must be a {type(state).__name__}"
        )
    _check_scalars(part, following, type(following).__name__)
    odd = leaves(state).keys() ^ leaves(following).keys()
    if odd:
        names = ", ".join(sorted(odd))
        raise ConfigurationError(f"{part.kind}: its step must give a state of the elements it was given, not {names}")
    return following, output


def _check_scalars(part: Any, group: Any, name: str, wanted: Sequence[str] = ()) -> None:
    """Raise `ConfigurationError` where a scalar field is None or an array; arrays in other fields are flattened."""
    for field, value in {**leaves(group), **{field: getattr(group, field) for field in wanted}}.items():
        if value is None or is_array(value):
            wrong = "None" if value is None else "an array"
            raise ConfigurationError(
                f"{part.kind}: {field} of its {name} is {wrong}; must be a number, as it is annotated"
            )


def _word(value: Any) -> str:
    return "None" if value is None else f"a {type(value).__name__}"
