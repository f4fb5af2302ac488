"""Entries of the table ``[distributions]`` of ensemble files.

Every distribution can be written by its kind and its numbers, ``{ kind = "uniform", low = 0.9, high = 1.1 }``;
built-in ones also have a short form, ``{ uniform = [0.9, 1.1] }``.
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import annotated_types as at

from dualwinch.config.toml_text import toml_value
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Leaf, Mark, Quantity, numbers_of, unknown
from dualwinch.model.quantities.tree import leaves, shown, validated, with_leaves
from dualwinch.simulation.ensembles.ensemble import (
    DISTRIBUTIONS,
    Choice,
    Distribution,
    Drawn,
    LogUniform,
    Normal,
    Uniform,
)
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import leaf_of

SHAPES = ("uniform", "normal", "choice")
"""Distributions with a short form; an entry has one of these keys, or a kind."""

OPTIONS = ("of", "together")
"""Further keys of any entry."""


def is_entry(value: Any) -> bool:
    """Whether a table of a file is an entry, not a table of entries."""
    return isinstance(value, dict) and (isinstance(value.get("kind"), str) or not set(SHAPES).isdisjoint(value))


def drawn_from(key: str, entry: Any, experiment: Experiment) -> Drawn:
    """Read the distribution of a key from its entry, e.g. ``{"uniform": [0.9, 1.1], "of": "nominal"}``.

    Raises:
        ConfigurationError: the key is unknown or cannot be drawn, or the entry is no distribution of its values.
    """
    leaf = leaf_of(key, experiment)
    _check_leaf(leaf, experiment)
    try:
        distribution = _distribution(entry)
    except (ConfigurationError, ValueError) as error:  # a user's own distribution may raise either
        raise ConfigurationError(f"{key}: {error}") from error
    if isinstance(distribution, Choice):
        distribution = _checked(leaf, distribution, relative="of" in entry)
    quantity = Drawn(distribution, relative="of" in entry, together=entry.get("together"))
    numbers = all(type(end) in {int, float} for end in quantity.distribution.ends)
    if quantity.relative and not numbers:
        raise ConfigurationError(f'{key}: of = "nominal": needs a distribution of numbers')
    if leaf.kind is not float and (quantity.relative or isinstance(distribution, (Uniform, LogUniform, Normal))):
        raise ConfigurationError(f"{key}: is no decimal number, must be a choice, e.g. {{ choice = [...] }}")
    check_range(key, quantity, experiment)
    return quantity


def _check_leaf(leaf: Leaf, experiment: Experiment) -> None:
    if leaf.shapes_code:
        raise ConfigurationError(
            f"{leaf.key}: cannot be drawn, it shapes the compiled code; run one ensemble for each value"
        )
    if Mark.TIMING in leaf.marks:
        raise ConfigurationError(
            f"{leaf.key}: cannot be drawn, all scenarios share their sample times; set it outside [distributions]"
        )
    if leaf.key not in leaves(experiment):
        raise ConfigurationError(f"{leaf.key}: cannot be drawn, no part of this experiment has this key")


def _distribution(entry: Any) -> Distribution:
    """A distribution from the content of its entry."""
    if not isinstance(entry, dict) or sum(shape in entry for shape in (*SHAPES, "kind")) != 1:
        requirement = 'must be one distribution, e.g. { uniform = [0.9, 1.1], of = "nominal" }'
        words = entry if isinstance(entry, dict) else ()
        strange = next((word for word in words if word not in {*SHAPES, *OPTIONS, "within", "kind"}), None)
        raise ConfigurationError(
            requirement if strange is None else f"{requirement}; {unknown('word', strange, SHAPES)}"
        )
    part: Any = DISTRIBUTIONS.find(entry["kind"]) if "kind" in entry else None
    allowed = (*(tuple(field.name for field in fields(part)) if part else (*SHAPES, "within")), *OPTIONS)
    for word in entry:
        if word not in (*allowed, "kind"):
            raise ConfigurationError(unknown("word", word, allowed))
    if "of" in entry and entry["of"] != "nominal":
        raise ConfigurationError(f'of = {entry["of"]!r}: must be "nominal"')
    if not isinstance(entry.get("together", ""), str):
        raise ConfigurationError(f"together = {entry['together']!r}: must be a text, the name of a group")
    return _of_kind(part, entry) if part else _in_short(entry)


def _of_kind(part: Any, entry: Mapping[str, Any]) -> Distribution:
    """A distribution from its kind and numbers."""
    hints, arguments = get_type_hints(part, include_extras=True), {}
    for field in fields(part):
        if field.name in entry:
            arguments[field.name] = _number(field.name, hints[field.name], entry[field.name])
        elif field.default is MISSING and field.default_factory is MISSING:
            raise ConfigurationError(f"kind = \"{part.kind}\": needs '{field.name}' beside it")
    distribution = part(**arguments)
    for rule in getattr(distribution, "rules", ()):
        if not rule.holds(distribution):
            name = rule.fields[0]
            raise ConfigurationError(f"{name} = {getattr(distribution, name):g}: {rule.wanted(distribution, '')}")
    return distribution


def _number(name: str, hint: Any, value: Any) -> Any:
    """Validate a number of a distribution by its field's type and bounds; a list becomes a tuple."""
    kind, *metadata = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    if kind not in {float, int, bool, str}:
        return tuple(value) if isinstance(value, list) else value
    constraints = tuple(item for item in metadata if isinstance(item, at.BaseMetadata))
    return validated(Leaf(name, Quantity("1", ""), kind, constraints=constraints), value)


def _checked(leaf: Leaf, choice: Choice, *, relative: bool) -> Choice:
    """Validate the values of a choice by their key; factors on the nominal value are left as they are."""
    if not isinstance(choice.values, tuple) or not choice.values:
        raise ConfigurationError(f"{leaf.key}: choice = {choice.values}: must be a list of one value or more")
    return choice if relative else Choice(tuple(validated(leaf, value) for value in choice.values))


def _in_short(entry: Mapping[str, Any]) -> Distribution:
    """A built-in distribution from its short form."""
    if "within" in entry and "normal" not in entry:
        raise ConfigurationError("within: goes with normal only")
    if "choice" in entry:
        values = entry["choice"]
        return Choice(tuple(values) if isinstance(values, list) else values)
    if "uniform" in entry:
        return Uniform(*_bounds("uniform", entry["uniform"]))
    mean, sigma = _pair("normal", entry["normal"])
    if not sigma > 0:
        raise ConfigurationError(f"normal = [{mean:g}, {sigma:g}]: the standard deviation must be > 0")
    if "within" not in entry:
        around = f"[{mean - 2 * sigma:g}, {mean + 2 * sigma:g}]"
        raise ConfigurationError(f"normal: needs bounds beside it, e.g. within = {around}")
    low, high = _bounds("within", entry["within"])
    if not low <= mean <= high:
        raise ConfigurationError(f"within = [{low:g}, {high:g}]: must contain the mean {mean:g}")
    return Normal(mean, sigma, low, high)


def _pair(word: str, value: Any) -> tuple[float, float]:
    ends = numbers_of(value) if isinstance(value, list) else ()
    if len(ends) != 2 or not all(type(end) is float and math.isfinite(end) for end in ends):
        raise ConfigurationError(f"{word} = {shown(value)}: must be two finite numbers, [a, b]")
    return ends


def _bounds(word: str, value: Any) -> tuple[float, float]:
    low, high = _pair(word, value)
    if not low < high:
        raise ConfigurationError(f"{word} = [{low:g}, {high:g}]: the first bound must be < the second")
    return low, high


def check_range(key: str, drawn: Drawn, experiment: Experiment) -> None:
    """Raise `ConfigurationError` if a draw may leave the range of its key."""
    nominal, leaf = leaves(experiment)[key], leaf_of(key, experiment)
    if drawn.relative and nominal is None:
        raise ConfigurationError(f'{key}: has no nominal value of its own; give bounds without of = "nominal"')
    for end in drawn.ends(nominal):
        try:
            with_leaves(experiment, {key: validated(leaf, end)})
        except ConfigurationError as error:
            raise ConfigurationError(f"{key}: its distribution reaches a value that is not allowed: {error}") from error
    if Mark.SHAPES_CODE_AT_ZERO in leaf.marks and 0 in {nominal, *drawn.ends(nominal)}:
        raise ConfigurationError(f"{key}: must be > 0, in [distributions] and outside: zero shapes the compiled code")


def entry_of(key: str, drawn: Drawn) -> str:
    """The entry of a file that `drawn_from` reads.

    Raises:
        ConfigurationError: a distribution that is not registered.
    """
    words = _words(key, drawn.distribution)
    if drawn.relative:
        words.append('of = "nominal"')
    if drawn.together is not None:
        words.append(f"together = {toml_value(drawn.together)}")
    return f"{{ {', '.join(words)} }}"


def _words(key: str, distribution: Distribution) -> list[str]:
    if DISTRIBUTIONS.get(distribution.kind) is not type(distribution):
        raise ConfigurationError(
            f"{key}: a distribution of type {type(distribution).__name__} cannot be written to a file, it is not "
            f"registered; must be one of {', '.join(DISTRIBUTIONS)}"
        )
    match distribution:
        case Uniform(low, high):
            return [f"uniform = [{low!r}, {high!r}]"]
        case Normal(mean, sigma, low, high):
            return [f"normal = [{mean!r}, {sigma!r}], within = [{low!r}, {high!r}]"]
        case Choice(values):
            return [f"choice = {toml_value(values)}"]
    numbers = {field.name: getattr(distribution, field.name) for field in fields(distribution)}  # pyright: ignore[reportArgumentType]
    return [f'kind = "{distribution.kind}"', *(f"{name} = {toml_value(value)}" for name, value in numbers.items())]
