"""Entries of the table ``[distributions]``: how a file says what a value is drawn from."""

import difflib
from collections.abc import Mapping
from typing import Any

from dualwinch.config.settings import leaf_of
from dualwinch.config.toml_text import toml_value
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import Leaf, Mark
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.quantities.validation import validated
from dualwinch.simulation.ensembles.distributions import Choice, Distribution, Normal, Uniform
from dualwinch.simulation.ensembles.ensemble import Drawn
from dualwinch.simulation.experiment import Experiment

SHAPES = ("uniform", "normal", "choice")
"""Kinds of distributions; an entry has one of these keys."""

OPTIONS = ("within", "of", "together")
"""What else an entry may have."""


def drawn_from(key: str, entry: Any, experiment: Experiment) -> Drawn:
    """How a value is drawn, from its entry in a file.

    Args:
        key: what is drawn.
        entry: the content of the entry, e.g. ``{"uniform": [0.9, 1.1], "of": "nominal"}``.
        experiment: the nominal values.

    Raises:
        ConfigurationError: the key names nothing or cannot be drawn, or the entry is no distribution of its values.
    """
    leaf = leaf_of(key, experiment)
    _check_leaf(leaf, experiment)
    _check_words(key, entry)
    drawn = Drawn(_distribution(leaf, entry), relative="of" in entry, together=entry.get("together"))
    numbers = all(type(end) in {int, float} for end in drawn.distribution.ends)
    if drawn.relative and not numbers:
        raise ConfigurationError(f'{key}: of = "nominal": must stand beside numbers')
    if leaf.kind is not float and (drawn.relative or not isinstance(drawn.distribution, Choice)):
        raise ConfigurationError(f"{key}: is no decimal number, must be a choice, e.g. {{ choice = [...] }}")
    check_range(key, drawn, experiment)
    return drawn


def _check_leaf(leaf: Leaf, experiment: Experiment) -> None:
    if leaf.shapes_code:
        raise ConfigurationError(
            f"{leaf.key}: cannot be drawn, it shapes the compiled code; run one ensemble for each value"
        )
    if Mark.TIMING in leaf.marks:
        raise ConfigurationError(f"{leaf.key}: cannot be drawn, all scenarios share their instants; set it outside")
    if leaf.key not in leaves(experiment):
        raise ConfigurationError(f"{leaf.key}: cannot be drawn, the controller of this ensemble has no such gain")


def _check_words(key: str, entry: Any) -> None:
    if not isinstance(entry, dict) or sum(shape in entry for shape in SHAPES) != 1:
        raise ConfigurationError(f'{key}: must be one distribution, e.g. {{ uniform = [0.9, 1.1], of = "nominal" }}')
    for word in entry:
        if word not in SHAPES + OPTIONS:
            near = difflib.get_close_matches(word, SHAPES + OPTIONS, n=1)
            hint = f"did you mean '{near[0]}'?" if near else f"must be one of {', '.join(SHAPES + OPTIONS)}"
            raise ConfigurationError(f"{key}: unknown word '{word}'; {hint}")
    if "of" in entry and entry["of"] != "nominal":
        raise ConfigurationError(f'{key}: of = {entry["of"]!r}: must be "nominal"')
    if not isinstance(entry.get("together", ""), str):
        raise ConfigurationError(f"{key}: together = {entry['together']!r}: must be a text, the name of a group")


def _distribution(leaf: Leaf, entry: Mapping[str, Any]) -> Distribution:
    key = leaf.key
    if "within" in entry and "normal" not in entry:
        raise ConfigurationError(f"{key}: within: must stand beside normal only")
    if "choice" in entry:
        values = entry["choice"]
        if not isinstance(values, list) or not values:
            raise ConfigurationError(f"{key}: choice = {values}: must be a list of one value or more")
        return Choice(tuple(values) if "of" in entry else tuple(validated(leaf, value) for value in values))
    if "uniform" in entry:
        return Uniform(*_bounds(key, "uniform", entry["uniform"]))
    mean, sigma = _pair(key, "normal", entry["normal"])
    if not sigma > 0:
        raise ConfigurationError(f"{key}: normal = [{mean:g}, {sigma:g}]: the standard deviation must be > 0")
    if "within" not in entry:
        around = f"[{mean - 2 * sigma:g}, {mean + 2 * sigma:g}]"
        raise ConfigurationError(f"{key}: normal: must have bounds beside it, e.g. within = {around}")
    low, high = _bounds(key, "within", entry["within"])
    if not low <= mean <= high:
        raise ConfigurationError(f"{key}: within = [{low:g}, {high:g}]: must hold the mean {mean:g}")
    return Normal(mean, sigma, low, high)


def _pair(key: str, word: str, value: Any) -> tuple[float, float]:
    numbers = isinstance(value, list) and all(type(end) in {int, float} and abs(end) < float("inf") for end in value)
    if not numbers or len(value) != 2:
        raise ConfigurationError(f"{key}: {word} = {value}: must be two finite numbers, [a, b]")
    return float(value[0]), float(value[1])


def _bounds(key: str, word: str, value: Any) -> tuple[float, float]:
    low, high = _pair(key, word, value)
    if not low < high:
        raise ConfigurationError(f"{key}: {word} = [{low:g}, {high:g}]: the first bound must be < the second")
    return low, high


def check_range(key: str, drawn: Drawn, experiment: Experiment) -> None:
    """Raise `ConfigurationError` where a draw may leave the range of its key."""
    nominal = leaves(experiment)[key]
    if drawn.relative and nominal is None:
        raise ConfigurationError(f'{key}: has no nominal value of its own; give bounds without of = "nominal"')
    for end in drawn.ends(nominal):
        try:
            with_leaves(experiment, {key: validated(leaf_of(key, experiment), end)})
        except ConfigurationError as error:
            raise ConfigurationError(f"{key}: its distribution reaches a value that is not allowed: {error}") from error


def entry_of(key: str, drawn: Drawn) -> str:
    """The entry of a file that `drawn_from` reads.

    Raises:
        ConfigurationError: a distribution that no entry stands for.
    """
    match drawn.distribution:
        case Uniform(low, high):
            words = [f"uniform = [{low!r}, {high!r}]"]
        case Normal(mean, sigma, low, high):
            words = [f"normal = [{mean!r}, {sigma!r}], within = [{low!r}, {high!r}]"]
        case Choice(values):
            words = [f"choice = [{', '.join(map(toml_value, values))}]"]
        case other:
            raise ConfigurationError(
                f"{key}: a distribution of type {type(other).__name__} cannot stand in a file; "
                f"must be one of {', '.join(SHAPES)}"
            )
    if drawn.relative:
        words.append('of = "nominal"')
    if drawn.together is not None:
        words.append(f"together = {toml_value(drawn.together)}")
    return f"{{ {', '.join(words)} }}"
