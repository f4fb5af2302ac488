"""What ``dualwinch sweep`` varies: keys with their values, from the words of the command line."""

import re
from collections.abc import Sequence
from typing import Any

from dualwinch.commands.ranges import numbers_between
from dualwinch.config.toml_text import parse_assignment
from dualwinch.model.errors import ConfigurationError

MOST_KEYS = 2
"""Keys that a table or a figure can show."""


def axes_from(texts: Sequence[str]) -> dict[str, list[Any]]:
    """Key → values of some texts.

    Args:
        texts: each ``key=value,value``, ``key=first:last:step``, ``key=first:last:count:log`` or, as in TOML,
            ``key=[value, value]``.

    Raises:
        ConfigurationError: none, more than two, one key twice, or a text that is none of these.
    """
    if not 1 <= len(texts) <= MOST_KEYS:
        raise ConfigurationError(
            f"give one or two keys with values, e.g. controller.observer.l0=1:20:1, not {len(texts)}"
        )
    found: dict[str, list[Any]] = {}
    for text in texts:
        key, equals, values = (word.strip() for word in text.partition("="))
        if not (key and equals and values):
            raise ConfigurationError(
                f"{text!r}: must be key=value,value or key=first:last:step, e.g. controller.observer.l0=1:20:1"
            )
        if key in found:
            raise ConfigurationError(f"{key}: is given twice")
        found[key] = _values(key, values)
    return found


def _values(key: str, text: str) -> list[Any]:
    if text.startswith("["):
        listed = parse_assignment(f"{key}={text}")[1]
        if not isinstance(listed, list):
            raise ConfigurationError(f"{key}={text}: must be a list as in TOML, e.g. {key}=[1, 2]")
        return listed
    if re.match(r"[\d.+-][^,]*:", text):
        wrong = f"{key}={text}: must be first:last:step or first:last:count:log, e.g. {key}=1:9:2"
        return [*numbers_between(text, wrong)]
    return [parse_assignment(f"{key}={word}")[1] for word in text.split(",")]
