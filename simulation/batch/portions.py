"""Scenarios in portions: enough at a time to keep all cores and lanes busy, few enough to be done in a moment."""

import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import islice

from dualwinch.codegen.drivers.batch import LANES
from dualwinch.model.disturbance import given_signals
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.cores import cores
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import exogenous_names

BLOCKS = 2
"""Blocks of lanes a thread runs in a portion: with one, a thread that is done early would wait for the others."""


def in_portions(scenarios: Iterable[Scenario], size: int) -> Iterator[list[Scenario]]:
    """Scenarios in lists of `size`, the last one shorter; each is drawn while the one before is run."""
    stream = iter(scenarios)
    with ThreadPoolExecutor(1) as pool:
        following = pool.submit(lambda: list(islice(stream, size)))
        while portion := following.result():
            following = pool.submit(lambda: list(islice(stream, size)))
            yield portion


def portion_size(experiment: Experiment, threads: int | None) -> tuple[int, int]:
    """How many scenarios like `experiment` are run at a time, and on how many threads.

    Args:
        experiment: one of them.
        threads: at most; default: one a core. Fewer where reference and given signals would take more than half of
            the memory.

    Raises:
        ConfigurationError: not even one thread's would fit.
    """
    wanted = threads or cores()
    if hasattr(os, "sysconf"):
        room = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2
        given = sum(signal.given for signal, _ in given_signals(experiment.disturbance).values())
        signals = len(exogenous_names(experiment.controller))
        sample = 8 * (signals + LANES * given)  # what is random is drawn while it is used
        if experiment.samples * sample > room:
            raise ConfigurationError(
                f"simulation.duration = {experiment.duration:g}: must be <= "
                f"{room // sample * experiment.simulation.sample_time:.6g} s in an ensemble, to keep reference and "
                "given signals within half of the memory"
            )
        wanted = min(wanted, room // (experiment.samples * sample))
    return BLOCKS * LANES * wanted, wanted
