"""The public names: signature and documentation, as the program itself has them."""

import inspect
import re
from dataclasses import is_dataclass
from typing import Any

import dualwinch
from docs.generated.text import code, table, unit
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe

SECTIONS = ("Args", "Returns", "Raises", "Attributes", "Yields")


def _signature(name: str, thing: Any) -> str:
    """A call as a reader writes it, without the metadata of annotations."""
    try:
        parameters = inspect.signature(thing).parameters.values()
    except (TypeError, ValueError):
        return ""
    words: list[str] = []
    for parameter in parameters:
        if parameter.kind is parameter.KEYWORD_ONLY and "*" not in words and not any(w.startswith("*") for w in words):
            words.append("*")
        stars = {parameter.VAR_POSITIONAL: "*", parameter.VAR_KEYWORD: "**"}.get(parameter.kind, "")
        default = "" if parameter.default is parameter.empty else f"={_default(parameter.default)}"
        words.append(f"{stars}{parameter.name}{default}")
    return f"```python\ndualwinch.{name}({', '.join(words)})\n```\n"


def _default(value: Any) -> str:
    return repr(value) if isinstance(value, (bool, int, float, str, type(None), tuple)) else "..."


def _documented(thing: Any) -> str:
    """A docstring as Markdown: sections become lists."""
    lines, found, inside = inspect.cleandoc(thing.__doc__ or "").splitlines(), [], ""
    for line in lines:
        title = line.rstrip(":")
        if line.endswith(":") and title in SECTIONS:
            inside = title
            found += ["", f"**{title}**", ""]
        elif not inside or (line and not line.startswith(" ")):
            inside = ""
            found.append(line)
        elif re.match(r" {4}\S", line):
            name, colon, rest = line.strip().partition(": ")
            known = colon and inside in {"Args", "Attributes", "Raises"}
            found.append(f"- {code(name)}: {rest}" if known else f"- {line.strip()}" if not found[-1] else line.strip())
        else:
            found.append(f"  {line.strip()}")
    return "\n".join(found).replace("``", "`")


def _numbers(thing: Any) -> str:
    """The fields of a group of numbers as a table; nothing for other things."""
    if not (inspect.isclass(thing) and is_dataclass(thing)):
        return ""
    try:
        leaves = describe(thing)
    except (ConfigurationError, TypeError, AttributeError):
        return ""
    rows = [[code(key), unit(leaf.quantity.unit), leaf.quantity.meaning, leaf.allowed] for key, leaf in leaves.items()]
    return "\n" + table(["field", "unit", "meaning", "allowed"], rows) + "\n" if rows and len(rows) < 30 else ""


def public_markdown(names: str) -> str:
    """A section for each of some public names."""
    text = []
    for name in names.split():
        thing = getattr(dualwinch, name)
        text += [f"### `{name}`\n", _signature(name, thing), _documented(thing), _numbers(thing), ""]
    return "\n".join(text)
