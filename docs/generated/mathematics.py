"""Formulas as MathML, made while the site is built: browsers show them without a script."""

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.errors import ExtensionError
from sphinx.writers.html5 import HTML5Translator

TAG = re.compile(r"\\tag\{(\w+)\}")
BAR = re.compile(r"<mo[^>]*>&#x0007C;</mo>")
"""A bar of an absolute value, which browsers would stretch like a fence and space like a relation."""
UNKNOWN = re.compile(r"<mi>(&|\\\w*)</mi>")
"""What the converter leaves of words that it does not know."""


def mathml(formula: str, display: str) -> str:
    """A formula in LaTeX's words as MathML, ``inline`` or ``block``.

    Raises:
        ExtensionError: it has words that have no MathML here.
    """
    text = convert(formula.replace("{aligned}", "{split}"), display=display)
    if unknown := UNKNOWN.search(text):
        raise ExtensionError(f"formula {formula!r}: no MathML of {unknown[1]!r}")
    text = re.sub(r'columnalign="(\w+)"', r'style="text-align:\1"', text)
    return BAR.sub('<mo stretchy="false" lspace="0" rspace="0">|</mo>', text)


def inline(translator: HTML5Translator, node: nodes.math) -> None:
    """A formula within a line."""
    translator.body.append(mathml(node.astext(), "inline"))
    raise nodes.SkipNode


def displayed(translator: HTML5Translator, node: nodes.math_block) -> None:
    """A formula of its own with its number, which scrolls where the page is narrower than it."""
    formula = node.astext()
    tag = TAG.search(formula)
    number = f'<span class="equation-number">({tag[1]})</span>' if tag else ""
    translator.body.append(f'<div class="math-block">{mathml(TAG.sub("", formula), "block")}{number}</div>')
    raise nodes.SkipNode
