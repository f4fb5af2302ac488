"""Clocks for time budgets."""

import time

from dualwinch.codegen.cache import build_seconds


def now() -> float:
    """Time in s since the epoch, so that workers on several machines agree on the end of a study."""
    return time.time()


def without_compiling() -> float:
    """`now` minus the time that this process spent compiling, which does not count against a budget."""
    return now() - build_seconds()
