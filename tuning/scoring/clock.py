"""The time that budgets are measured in."""

import time

from dualwinch.codegen.cache import build_seconds


def now() -> float:
    """Time in s since the epoch: workers on several machines share the end of a study."""
    return time.time()


def without_compiling() -> float:
    """The same without the time that this process has compiled in: what comes on top of a budget, once."""
    return now() - build_seconds()
