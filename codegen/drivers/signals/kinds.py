"""What the random part of a signal may be."""

import sys
from dataclasses import dataclass
from typing import TypeAlias

NO_LIMIT = sys.float_info.max
"""Limit of a signal without one."""


@dataclass(frozen=True)
class RandomSignal:
    """A first-order Gauss–Markov signal, stationary from its first sample, or from zero before it.

    Attributes:
        seed: a whole number below 2^64.
        stream: its number, below 2^64: signals of one seed with different numbers are independent.
        sigma: standard deviation.
        decay: of the autocorrelation from sample to sample; 0 is white noise.
        limit: largest magnitude.
        from_zero: whether it is zero before its first sample.
    """

    seed: int
    stream: int
    sigma: float
    decay: float = 0.0
    limit: float = NO_LIMIT
    from_zero: bool = False


@dataclass(frozen=True)
class UniformSignal:
    """White noise, uniform in [-1, 1].

    Attributes:
        seed, stream: as of a `RandomSignal`.
    """

    seed: int
    stream: int


@dataclass(frozen=True)
class OutageSignal:
    """1 in an outage, else 0; each window of time has one outage, somewhere within it.

    Attributes:
        seed, stream: as of a `RandomSignal`.
        period: samples of a window, from 1 to 2^32 - 1.
        length: of an outage in samples, on average, below 2^31: all lengths from half as long to half as long again are
            as likely, but none is longer than its window. Where it begins is as likely anywhere that it ends in time.
    """

    seed: int
    stream: int
    period: int
    length: int


Drawn: TypeAlias = RandomSignal | UniformSignal | OutageSignal

NORMAL, UNIFORM, OUTAGES = 1, 2, 3
"""Their kinds in fill.c; 0 is nothing random."""

KINDS: dict[type[Drawn], int] = {RandomSignal: NORMAL, UniformSignal: UNIFORM, OutageSignal: OUTAGES}
