"""Terminals on which text is only ever text."""

from rich.console import Console
from rich.text import Text


def terminal(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console for which brackets in the names of files, studies and parts mean nothing."""
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False)


def styled(style: str, words: str, *plain: str) -> Text:
    """Words in a style such as ``bold`` or ``red``, and plain ones behind them."""
    return Text.assemble((words, style), *plain)
