"""Escaping of external texts, one function per format.

HTML has its own escaping (`markupsafe` in reports, `html.escape` elsewhere), figures `simulation.plots.style.plain`.
"""

import codecs
import os
import re
import unicodedata
from collections.abc import Sequence

LONGEST_WORD, LONGEST_LINE = 200, 1500
"""Largest number of characters of a word and of a whole line in messages: less than a screen."""

BREAKS = {"\u2028", "\u2029"}
"""Line breaks that are not control characters."""

SECRET_VARIABLES = ("PGPASSWORD",)
"""Environment variables whose values are never shown."""


def unicode_text(content: bytes) -> str:
    """A file's content in UTF-8, or in UTF-16 with a byte order mark, as PowerShell writes it.

    Raises:
        UnicodeDecodeError: it is neither.
    """
    wide = content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    return content.decode("utf-16" if wide else "utf-8-sig").replace("\r\n", "\n")


def one_line(text: object) -> str:
    """A text in one line that every encoding can represent: for TOML comments, metadata of files, and terminals.

    Line breaks, other control characters and surrogates are written as Python escapes.
    """
    return "".join(
        _escaped(letter) if unicodedata.category(letter) in {"Cc", "Cs"} or letter in BREAKS else letter
        for letter in str(text)
    )


def enumeration(words: Sequence[str]) -> str:
    """Words as an enumeration: ``a``, ``a and b``, ``a, b and c``; empty without any."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def c_comment(text: object) -> str:
    """A text in one line for a C comment, without comment delimiters."""
    return one_line(text).replace("*/", "* /").replace("/*", "/ *")


def c_string(text: object) -> str:
    """The content of a C string literal (no format string), without trigraphs."""
    plain = one_line(text).replace("\\", "\\\\").replace('"', '\\"')
    return plain.replace("?", "\\?")


def markdown(text: object) -> str:
    """A text in one line of Markdown or a table cell, with special characters escaped."""
    return re.sub(r"([\\`*\[\]<>|&])", r"\\\1", one_line(text))


def xml_text(text: object) -> str:
    """A text in one line of characters valid in XML; the XML writer escapes markup."""
    return re.sub("[\ufffe\uffff]", lambda letter: _escaped(letter[0]), one_line(text))


def shortened(text: str) -> str:
    """A one-line message that fits a screen: very long words lose their middle, a very long line its end."""
    half = LONGEST_WORD // 2
    words = (word if len(word) <= LONGEST_WORD else f"{word[:half]}…{word[-half:]}" for word in text.split())
    cut = " ".join(words)
    return cut if len(cut) <= LONGEST_LINE else f"{cut[: LONGEST_LINE - 1]}…"


def without_secrets(text: str) -> str:
    """A text without possible passwords: in URLs and their queries, after ``password=``, and from the environment."""
    text = re.sub(r"([a-zA-Z][\w.+-]*://[^\s'\":@/]*):(?!\*\*\*@)[^\s'\"]*@", r"\1:***@", text)
    text = re.sub(r"(postgres[\w+]*:[^\s'\"?]*)\?(?!\*\*\*)[^\s'\"]*", r"\1?***", text, flags=re.IGNORECASE)
    text = re.sub(r"(?i)(passw\w*|pwd|secret)(\s*=\s*)('[^']*'|\"[^\"]*\"|[^\s&;,'\"]+)", r"\1\2***", text)
    for name in SECRET_VARIABLES:
        if value := os.environ.get(name):
            text = text.replace(value, "***")
    return text


def _escaped(letter: str) -> str:
    return letter.encode("unicode_escape", errors="backslashreplace").decode("ascii")
