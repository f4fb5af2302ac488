"""Description of numbers: unit, meaning, source and properties, written once beside the field.

Parameters and signals are frozen dataclasses whose fields are annotated with a `Quantity` and, for parameters, with
bounds from `annotated_types`. Validation, the annotated TOML, result columns, the C header and the search space read
names, units and bounds from there, as a `Leaf`. A field may also be a list of numbers (`Numbers`) or, in a state, a
vector or matrix (`elements`).
"""

import difflib
import heapq
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property, lru_cache
from numbers import Integral, Real
from operator import ge, gt, le, lt
from typing import Annotated, Any

import annotated_types as at
import casadi as ca
import numpy as np

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.scalar import Scalar


class Numbers(tuple[float, ...]):
    """A list of numbers of any length, as a field of a group that is hashed and compared often.

    The hash is computed once, and comparison with itself does not read the elements.
    """

    _hash: int | None = None

    def __hash__(self) -> int:
        if self._hash is None:
            self._hash = super().__hash__()
        return self._hash

    def __eq__(self, other: object) -> bool:
        return self is other or super().__eq__(other)

    def __ne__(self, other: object) -> bool:
        return not self == other


def numbers_of(values: Any) -> Any:
    """A list or tuple as `Numbers` of floats; invalid values unchanged, for a later check."""
    if isinstance(values, Numbers) or not isinstance(values, (list, tuple)):
        return values
    plain = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
    return Numbers(map(_as_float, values) if plain else values)


def _as_float(value: float) -> float:
    """A number as a float; a whole number beyond the range of floats is infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf


NONE = Numbers()
"""No numbers."""

Positive = Annotated[float, at.Gt(0)]
NonNegative = Annotated[float, at.Ge(0)]
UnitInterval = Annotated[float, at.Ge(0), at.Le(1)]


@dataclass(frozen=True)
class Quantity:
    """Unit, meaning and source of one number ("1" is the unit of a pure number)."""

    unit: str
    meaning: str
    source: str = ""


def behind_number(unit: str) -> str:
    """A unit to follow a number, with a space; empty for a pure number."""
    return "" if unit == "1" else f" {unit}"


@dataclass(frozen=True)
class Tunable:
    """Search range of a gain in tuning, in its own unit.

    Attributes:
        lower, upper: bounds of the search, at the default values of the keys in `of`.
        log: whether the search is logarithmic.
        standard: whether the gain is tuned if no search space is given.
        of: a product of keys that scales the bounds, such as ``1/plant.vehicle.mass`` (a name without a dot stands in
            the gain's own table, whose name is ``{table}``), or one for each bound; empty: the same bounds on any
            machine.
    """

    lower: float
    upper: float
    log: bool = True
    standard: bool = True
    of: str | tuple[str, str] = ""

    @property
    def followed(self) -> tuple[str, str]:
        """The products of keys that scale the lower and the upper bound."""
        return (self.of, self.of) if isinstance(self.of, str) else self.of


@dataclass(frozen=True)
class TunableRatio:
    """A whole number that is tuned as a ratio with another field of its group.

    Attributes:
        denominator: name of the other field.
        choices: default ratios to choose from, such as ``5/3``.
    """

    denominator: str
    choices: tuple[str, ...]


@dataclass(frozen=True)
class Key:
    """Name of a field in keys, if not its own name."""

    name: str


@dataclass(frozen=True)
class Tied:
    """A group that is one of several of a kind: their gains may be tuned as one, under this name."""

    name: str


class Mark(Enum):
    """A property of a field."""

    PART = "the kind of a part"
    PARTS = "the kinds of several parts"
    SHAPES_CODE = "a number that is a constant of the compiled code"
    TIMING = "sets the sampling instants"
    FILE = "the path of a file to read; in a file, relative to that file"
    CONTENT = "the content of a file: no scalar, and without a key"
    DIGEST = "the digest of the content of a file, updated when another file is read"
    DRAWN_AHEAD = "a parameter of signals drawn before a run; no input of the closed loop"
    SHAPE_PARAMETER = "a shape parameter of an effect: sets its form over time, angle or speed, not its size"
    SWITCH = "a truth value that is a number, 0 or 1, in the closed loop"
    OFF_AT_ZERO = "often zero: specialised code leaves out the terms it multiplies"
    SCALES_DRAWS = "scales signals drawn before a run: at zero nothing is drawn"
    SHAPES_CODE_AT_ZERO = "a number that is left out of the compiled code at zero"
    UNKNOWN = "a deviation of the real machine from its data sheet, unknown to controllers"
    READS_IN_STEPS = "quantises measurements: derivatives neglect it"
    POSITION = "a state that starts at the vehicle's position, and equals it in steady motion"
    SPEED = "a state that equals the vehicle's speed in steady motion"
    RATE = "a state that is the rate of another mechanical state"
    SETTLES = "a friction state, which settles within an integration step"
    HELD = "a signal that is constant from one sample to the next"
    BOOKKEEPING = "a state without effect while sensors are perfect and no vortices are shed"
    INTERVAL = "the number of samples between updates of a slow part; analysis of the loop takes 1"
    GATE = "rejects measurements, at zero none; analysis of the loop takes 0"
    PHASE = "a state that counts samples: a slow part is updated where it is 0; nothing else depends on it"
    LEARNT = "an estimate of the machine's constants, converging over thousands of samples; held in linearised loops"


AHEAD = frozenset({Mark.DRAWN_AHEAD, Mark.FILE, Mark.DIGEST})
"""Marks of fields used before a run, which are no inputs of the closed loop."""


@dataclass(frozen=True)
class Rule:
    """A constraint between the values of a group; a group lists its constraints as ``rules``.

    Attributes:
        fields: the fields involved, the one that errors name first.
        holds: group → whether it holds, element by element for fields that are arrays, as an expression for symbols:
            exported code checks it too. Conditions are joined by `both` and `either` of `model.scalar`.
        wanted: group, prefix of its keys → requirement on the first field, in words.
    """

    fields: tuple[str, ...]
    holds: Callable[[Any], Any]
    wanted: Callable[[Any, str], str]


COMPARISONS = {at.Gt: (">", gt), at.Ge: (">=", ge), at.Lt: ("<", lt), at.Le: ("<=", le)}
"""Constraint → its sign and comparison."""


def bound_of(constraint: at.BaseMetadata) -> Any:
    """The number in a constraint."""
    return getattr(constraint, type(constraint).__name__.lower())


@dataclass(frozen=True)
class Leaf:
    """One scalar of a group: its dotted key, its quantity, its type and its bounds.

    Attributes:
        key: dotted path below the group, e.g. ``vehicle.mass``.
        quantity: unit, meaning and source.
        kind: the Python type (``float``, ``int``, ``bool``, ``str``, or ``tuple`` for a list of numbers), without
            ``None``.
        choices: the allowed words; empty for numbers.
        optional: whether ``None`` (a default taken from elsewhere) is allowed.
        constraints: the bounds from `annotated_types`.
        tunable: its search range in tuning; ``None``: it is no gain.
        ratio: the ratio by which it is tuned.
        tied: the common key when several groups are tuned as one.
        marks: its properties.
        default: the field's default; ``None`` without any.
    """

    key: str
    quantity: Quantity
    kind: Any
    choices: tuple[str, ...] = ()
    optional: bool = False
    constraints: tuple[at.BaseMetadata, ...] = ()
    tunable: Tunable | None = None
    ratio: TunableRatio | None = None
    tied: str | None = None
    marks: frozenset[Mark] = frozenset()
    default: Any = None

    @property
    def allowed(self) -> str:
        """The allowed range in words, e.g. ``> 0``; empty if unrestricted."""
        words = [f"{COMPARISONS[type(each)][0]} {bound_of(each):g}" for each in self.constraints]
        words += ["true or false"] if self.kind is bool else []
        words += [f'"{choice}"' for choice in self.choices]
        return (" or " if self.choices else " and ").join(words)

    @property
    def wanted(self) -> str:
        """Type, range and unit of a valid value, in words."""
        if Mark.PARTS in self.marks:
            return (
                f"a list of {self.allowed}, each once" if self.choices else "an empty list: no such part is registered"
            )
        if self.choices or self.kind is bool:
            return self.allowed
        if self.kind is str:
            return "a text"
        noun = {int: "a whole number", tuple: "a list of finite numbers"}.get(self.kind, "a finite number")
        unit = "" if self.quantity.unit == "1" else self.quantity.unit
        return " ".join(word for word in (noun, self.allowed, unit) if word)

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper end of the allowed range, infinite without a bound."""
        lower, upper = (0.0, 1.0) if self.kind is bool else (-math.inf, math.inf)
        for constraint in self.constraints:
            if isinstance(constraint, (at.Gt, at.Ge)):
                lower = max(lower, bound_of(constraint))
            else:
                upper = min(upper, bound_of(constraint))
        return lower, upper

    @cached_property
    def is_number(self) -> bool:
        """Whether the value is a number at run time, not a choice of structure."""
        if Mark.SHAPES_CODE in self.marks or not self.marks.isdisjoint(AHEAD):
            return False
        return self.kind in {float, int, Any} or Mark.SWITCH in self.marks

    @property
    def shapes_code(self) -> bool:
        """Whether another value requires other compiled code."""
        return not self.is_number and self.marks.isdisjoint({*AHEAD, Mark.TIMING})

    @property
    def some_value(self) -> float:
        """An allowed number, always the same."""
        lower, upper = self.bounds
        for candidate in (1, 0.5, lower, upper, lower + 1, upper - 1, (lower + upper) / 2):
            if self.admits(candidate):
                return candidate
        raise ValueError(f"{self.key}: no simple number is {self.allowed}")

    def admits(self, value: Any) -> bool:
        """Whether a value is of the right type and within the bounds."""
        if self.kind is float and type(value) is float:  # the common case, first for speed
            return math.isfinite(value) and self._within(value)
        if value is None:
            return self.optional
        if self.choices or Mark.PARTS in self.marks:
            return self._is_chosen(value)
        if self.kind in {bool, str} or isinstance(value, bool):
            return self.kind in {bool, str} and isinstance(value, self.kind)
        if self.kind is tuple:
            return isinstance(value, (list, tuple)) and _all_kept(numbers_of(value), self.constraints)
        right = isinstance(value, Integral if self.kind is int else Real) and _finite(value)
        return right and self._within(value)

    def _within(self, value: Any) -> bool:
        return all(compare(value, bound) for compare, bound in self._comparisons)

    @cached_property
    def _comparisons(self) -> tuple[tuple[Callable[[Any, Any], bool], Any], ...]:
        return tuple((COMPARISONS[type(each)][1], bound_of(each)) for each in self.constraints)

    def _is_chosen(self, value: Any) -> bool:
        if Mark.PARTS not in self.marks:
            return value in self.choices
        kinds = [value] if isinstance(value, str) else value
        if not isinstance(kinds, (list, tuple)):
            return False
        return all(kind in self.choices and kinds.count(kind) == 1 for kind in kinds)


def _finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond the range of floats
        return False


@lru_cache(maxsize=64)
def _all_kept(values: Numbers, constraints: tuple[at.BaseMetadata, ...]) -> bool:
    numbers = Leaf("", Quantity("", ""), float, constraints=constraints)
    return all(map(numbers.admits, values))


def nearest(key: str, keys: Iterable[str], count: int = 1) -> list[str]:
    """The keys most similar to a mistaken one, in descending order of similarity.

    The similarity is the sum of those of the whole keys and of their last parts, so that a wrong section matters less
    than a wrong name. Names that begin with the mistaken one come first: ``pid-cascade`` for ``pid``.
    """
    word = key.lower()

    def parts(name: str) -> tuple[str, str]:
        return name.lower(), name.lower().rsplit(".", 1)[-1]

    matchers = [difflib.SequenceMatcher(b=part) for part in parts(key)]

    def likeness(name: str) -> tuple[bool, float, str]:
        for matcher, part in zip(matchers, parts(name), strict=True):
            matcher.set_seq1(part)
        begins = bool(word) and name.lower().startswith(word)
        return begins, sum(matcher.ratio() for matcher in matchers), name.lower()

    return heapq.nlargest(count, keys, key=likeness)


NEAR, NEAR_ALONE = 0.5, 0.6
"""Least similarities of near names: of whole keys and last parts, and of last parts alone."""


def is_near(key: str, name: str) -> bool:
    """Whether a mistaken key resembles a name so much that it may be meant, or one is the beginning of the other."""
    (text, last), (other, other_last) = ((text.lower(), text.lower().rpartition(".")[2]) for text in (key, name))
    if last and (other_last.startswith(last) or last.startswith(other_last)):
        return True
    similarity = difflib.SequenceMatcher(a=other_last, b=last).ratio()
    return similarity >= NEAR_ALONE or (similarity >= NEAR and difflib.SequenceMatcher(a=other, b=text).ratio() >= NEAR)


def meant(name: Any, known: Iterable[str]) -> str:
    """Question whether the nearest of the known names is meant; empty where none is near."""
    suggestion = next(iter(nearest(str(name), known)), "")
    return f"did you mean '{suggestion}'?" if suggestion and is_near(str(name), suggestion) else ""


def with_point(text: Any) -> str:
    """Hint for a number with a decimal comma; empty for anything else."""
    number = str(text).strip()
    return f"; decimals take a point: {number.replace(',', '.')}" if DECIMAL_COMMA.fullmatch(number) else ""


DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)

MOST_LISTED = 24
"""Largest number of names listed in an error; of more only the nearest are listed."""


def another(what: str) -> str:
    """The noun with "another" or "other": another seed, other constraints."""
    return f"{'other' if what.endswith('s') else 'another'} {what}"


def suggestion(name: Any, known: Iterable[str], more: str = "") -> str:
    """Hint of an error about an unknown name: the one that may be meant, and the known, with `more` in words."""
    names = list(known)
    if not names:
        return "there is none" + more
    listed = f"must be one of {', '.join(names)}"
    if len(names) > MOST_LISTED:
        listed = f"the nearest of {len(names)} are {', '.join(nearest(str(name), names, 6))}"
    question = meant(name, names)
    return f"{question} {listed[0].upper()}{listed[1:]}{more}" if question else listed + more


LONGEST_NAME = 100
"""Largest number of characters of a name shown in an error."""


def unknown(what: str, name: Any, known: Iterable[str], more: str = "") -> str:
    """Message about an unknown name, as ``unknown metric 'ms'; did you mean 'mse'? Must be one of ...``."""
    text = repr(name)
    text = text if len(text) <= LONGEST_NAME else f"{text[:LONGEST_NAME]}..."
    return f"unknown {what} {text}; {suggestion(name, known, more)}"


@dataclass(frozen=True, init=False)
class Elements:
    """Quantities of the elements of a vector, in place of one `Quantity` for all.

    ``z: Annotated[Any, Elements((Quantity("m", "position"), Mark.POSITION), Quantity("m/s", "drift"))]``

    Attributes:
        quantities, marks: those of each element; of a matrix, row by row.
    """

    quantities: tuple[Quantity, ...]
    marks: tuple[frozenset[Mark], ...]

    def __init__(self, *each: Quantity | tuple[Quantity | Mark, ...]) -> None:
        """Take for each element its quantity, or a tuple of quantity and marks."""
        groups = [item if isinstance(item, tuple) else (item,) for item in each]
        quantities = tuple(item for group in groups for item in group if isinstance(item, Quantity))
        marks = tuple(frozenset(item for item in group if isinstance(item, Mark)) for group in groups)
        if len(quantities) != len(groups) or not groups:
            raise ConfigurationError("Elements: must be one Quantity for each element, or a tuple of it and its marks")
        object.__setattr__(self, "quantities", quantities)
        object.__setattr__(self, "marks", marks)


def is_array(value: Any) -> bool:
    """Whether a value is a vector or a matrix, of floats or of symbols."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, (ca.SX, ca.MX, ca.DM)) and value.shape != (1, 1)


def vector(values: Sequence[Scalar]) -> Any:
    """Numbers or symbols as a vector of a state."""
    symbolic = any(isinstance(value, (ca.SX, ca.MX)) for value in values)
    return ca.vertcat(*values) if symbolic else np.array(values, dtype=float)


def elements(value: Any) -> dict[str, Any]:
    """Suffix of the key → element of a vector (``.0``, ``.1``, …) or a matrix (``.0.0``, ``.0.1``, …), row by row.

    A single element has no suffix, as a symbol of one element is a scalar.
    """
    rows, columns = (*value.shape, 1)[:2]
    matrix = value.reshape(rows, columns) if isinstance(value, np.ndarray) else value
    if rows == columns == 1:
        return {"": matrix[0, 0]}
    if columns == 1:
        return {f".{row}": matrix[row, 0] for row in range(rows)}
    return {f".{row}.{column}": matrix[row, column] for row in range(rows) for column in range(columns)}


def rebuilt(value: Any, element: Callable[[str], Any]) -> Any:
    """An array shaped like `value`, from the suffixes of its elements' keys: NumPy for floats, else CasADi.

    Elements that are NumPy arrays, of many runs, append their axes.
    """
    items = [element(end) for end in elements(value)]
    if any(isinstance(item, (ca.SX, ca.MX)) for item in items):
        rows, columns = (*value.shape, 1)[:2]
        return ca.reshape(ca.vertcat(*items), columns, rows).T
    stacked = np.array(items, float)
    return stacked.reshape(value.shape + stacked.shape[1:])
