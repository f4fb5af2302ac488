"""Steps of a controller's parts, carried out with what is wrong with one said in a line."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from typing import Any

import casadi as ca

from dualwinch.codegen.errors import DualwinchError
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.arrays import is_array
from dualwinch.model.quantities.tree import leaves

BRANCHES = "use where(condition, a, b) of dualwinch.model.scalar in place of if, and, or, not, min and max"
FUNCTIONS = "use functions of dualwinch.model.scalar or casadi in place of those of math and others"

HINTS = {
    "truth value": BRANCHES,
    "a symbol is no float": FUNCTIONS,
    "to_int not defined": FUNCTIONS,
    "interpreted as an integer": FUNCTIONS,
    "casadi SX does not support": FUNCTIONS,
}
"""What stands in the errors of a step that asks a symbol for its value → what to write instead."""

AS_FLOAT = ca.SX.__float__


def started(part: Any) -> Any:
    """The state of a part before the first sample.

    Raises:
        ConfigurationError: it is no dataclass.
    """
    state = part.initial_state()
    if not is_dataclass(state) or isinstance(state, type):
        raise ConfigurationError(
            f"{part.kind}: its initial_state gives {_word(state)}; must give a dataclass of numbers, vectors and "
            "matrices, which may be empty"
        )
    _check_scalars(part, state, "initial_state")
    return state


def stepped(part: Any, state: Any, gives: type, *inputs: Any) -> tuple[Any, Any]:
    """The next state of a part and its output.

    Args:
        part: of a controller.
        state: as the last sample left it.
        gives: what its output is.
        inputs: further arguments of its step.

    Raises:
        ConfigurationError: it asks a symbol for its value, or gives anything but a state like the one it was given and
            an output of scalars.
    """
    with symbols_without_values(part.kind):
        given = part.step(state, *inputs)
    if not isinstance(given, tuple) or len(given) != 2:
        raise ConfigurationError(f"{part.kind}: its step gives {_word(given)}; must give (state, {gives.__name__})")
    following, output = given
    if type(following) is not type(state):
        raise ConfigurationError(
            f"{part.kind}: its step gives {_word(following)} as next state; must be a {type(state).__name__}"
        )
    if not isinstance(output, gives):
        raise ConfigurationError(f"{part.kind}: its step gives {_word(output)} as output; must be a {gives.__name__}")
    _check_scalars(part, following, type(following).__name__)
    _check_scalars(part, output, type(output).__name__, [field.name for field in fields(gives)])
    odd = leaves(state).keys() ^ leaves(following).keys()
    if odd:
        names = ", ".join(sorted(odd))
        raise ConfigurationError(f"{part.kind}: its step must give a state of the elements it was given, not {names}")
    return following, output


def _check_scalars(part: Any, group: Any, name: str, wanted: Sequence[str] = ()) -> None:
    """Raise `ConfigurationError` where a field that is to be a number is none; of others vectors are taken apart."""
    for field, value in {**leaves(group), **{field: getattr(group, field) for field in wanted}}.items():
        if value is None or is_array(value):
            wrong = "None" if value is None else "an array"
            raise ConfigurationError(
                f"{part.kind}: {field} of its {name} is {wrong}; must be a number, as it is annotated"
            )


@contextmanager
def symbols_without_values(part: str) -> Iterator[None]:
    """Have it be an error, of a part by its name, where its step asks a symbol for its value.

    That holds for the float of a symbol too: CasADi gives NaN, of which `math` makes more.
    """
    ca.SX.__float__ = _float  # pyright: ignore[reportAttributeAccessIssue]
    try:
        yield
    except DualwinchError:
        raise
    except Exception as error:
        hint = _hint(error)
        if hint is None:
            raise
        raise ConfigurationError(f"{part}: its step asks for the value of a symbol; {hint}") from error
    finally:
        ca.SX.__float__ = AS_FLOAT


def _float(symbol: ca.SX) -> float:
    if not symbol.is_constant():
        raise TypeError("a symbol is no float")
    return AS_FLOAT(symbol)


def _word(value: Any) -> str:
    return "None" if value is None else f"a {type(value).__name__}"


def _hint(error: Exception) -> str | None:
    text = str(error)
    return next((hint for word, hint in HINTS.items() if word in text), None)
