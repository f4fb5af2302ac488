"""Texts from outside, escaped for the place where they stand: one function for each kind of place.

HTML has its own escaping (`markupsafe` in reports, `html.escape` elsewhere), figures `simulation.plots.style.plain`.
"""

import os
import re
import unicodedata

LONGEST_WORD, LONGEST_LINE = 200, 1500
"""Characters of what is quoted in a line, and of the whole line: less than a screen."""

BREAKS = {"\u2028", "\u2029"}
"""Line breaks that are no control characters."""

SECRET_VARIABLES = ("PGPASSWORD",)
"""Environment variables whose values are never shown."""


def one_line(text: object) -> str:
    """A text in one line that any encoding can hold: for comments of TOML files, facts in files, and terminals.

    Line breaks, other control characters and halves of characters are written as Python's escapes.
    """
    return "".join(_escaped(letter) if _unfit(letter) else letter for letter in str(text))


def c_comment(text: object) -> str:
    """A text in one line that does not end the C comment it stands in, nor seems to begin another."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *")


def c_string(text: object) -> str:
    """A text between the quotes of a C string that is no format, without trigraphs."""
    plain = one_line(text).replace("\\", "\\\\").replace('"', '\\"')
    return plain.replace("?", "\\?")


def markdown(text: object) -> str:
    """A text in one line of Markdown, in a cell of a table, too, with signs that mean something there escaped."""
    return re.sub(r"([\\`*\[\]<>|&])", r"\\\1", one_line(text))


def xml_text(text: object) -> str:
    """A text in one line of letters that XML can hold; what writes XML escapes its signs."""
    return re.sub("[\ufffe\uffff]", lambda letter: _escaped(letter[0]), one_line(text))


def shortened(text: str) -> str:
    """A message of one line that fits a screen: very long words lose their middle, a very long line its end."""
    cut = re.sub(rf"\S{{{LONGEST_WORD + 1},}}", lambda word: _without_middle(word[0]), " ".join(text.split()))
    return cut if len(cut) <= LONGEST_LINE else f"{cut[: LONGEST_LINE - 1]}…"


def without_secrets(text: str) -> str:
    """A text without what could be a password: in URLs, in their queries, after ``password=``, in the environment."""
    text = re.sub(r"([a-zA-Z][\w.+-]*://[^\s'\":@/]*):(?!\*\*\*@)[^\s'\"]*@", r"\1:***@", text)
    text = re.sub(r"(postgres[\w+]*:[^\s'\"?]*)\?(?!\*\*\*)[^\s'\"]*", r"\1?***", text, flags=re.IGNORECASE)
    text = re.sub(r"(?i)(passw\w*|pwd|secret)(\s*=\s*)('[^']*'|\"[^\"]*\"|[^\s&;,'\"]+)", r"\1\2***", text)
    for name in SECRET_VARIABLES:
        if value := os.environ.get(name):
            text = text.replace(value, "***")
    return text


def _unfit(letter: str) -> bool:
    return unicodedata.category(letter) in {"Cc", "Cs"} or letter in BREAKS


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape", errors="backslashreplace").decode("ascii")


def _without_middle(word: str) -> str:
    half = LONGEST_WORD // 2
    return f"{word[:half]}…{word[-half:]}"
