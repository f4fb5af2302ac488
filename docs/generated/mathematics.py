"""Formulas as MathML, made while the site is built: browsers show them without a script."""

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.writers.html5 import HTML5Translator

TAG = re.compile(r"\\tag\{(\w+)\}")
BAR = "<mo>&#x0007C;</mo>"
"""A bar of an absolute value, which browsers would stretch like a fence and space like a relation."""


def mathml(formula: str, display: str) -> str:
    """A formula in LaTeX's words as MathML, ``inline`` or ``block``."""
    return convert(formula, display=display).replace(BAR, '<mo stretchy="false" lspace="0" rspace="0">|</mo>')


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
