"""Ratios of the table's rows beside what they are to reach."""

import platform

from benchmarks.measure import Timing
from benchmarks.peers import ADAPTIVE_LIMIT, DEFAULT, ENSEMBLES, SENSITIVE
from dualwinch.codegen.compiler import vector_features

ASKED_OF_LANES = {"avx512f": 8.0, "avx2": 4.0}
"""Widest vector instructions → how many times the hand-written scalar loop's rate a batch is to reach on a core."""

MOST_TIME = 1.3
"""How many times the time of its compiled code `run_ensemble` is to take at most."""

HEADINGS = ["what", "over", "rate", "at least", "", "apart, m"]


def rows(timings: list[Timing], cores: int) -> list[list[str]]:
    """One row for each ratio of rates: what, over what, measured, asked, whether it holds, and its positions' error.

    Args:
        timings: of all peers.
        cores: threads of the widest batch.
    """
    by_key = {timing.peer.key: timing for timing in timings if timing.seconds}
    widest = next((name for name in ASKED_OF_LANES if name in vector_features()), None)
    asked = [
        (DEFAULT, ADAPTIVE_LIMIT, 1.0),
        (SENSITIVE, DEFAULT, 0.25),
        ("batch-1", ADAPTIVE_LIMIT, ASKED_OF_LANES.get(widest or "")),
        (f"batch-{cores}", "batch-1", 0.9 * cores),
        ("sea-1", "batch-1", 0.75),
        ("rig-1", "batch-1", 0.5),
        *((f"{name}-ensemble", f"{name}-kernel", 1 / MOST_TIME) for name in ENSEMBLES),
    ]
    found = []
    for key, yardstick, least in asked:
        if key == yardstick or key not in by_key or yardstick not in by_key:
            continue
        ratio = by_key[yardstick].middle / by_key[key].middle
        holds = "" if least is None else "yes" if ratio >= least else "no"
        limit = f"none for {platform.machine()}" if least is None else f"{least:.2g} ×"
        apart = f"{by_key[key].deviation:.1e}"
        found.append([by_key[key].peer.title, by_key[yardstick].peer.title, f"{ratio:.2f} ×", limit, holds, apart])
    return found
