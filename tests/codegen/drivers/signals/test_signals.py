"""Signals that compiled C fills, against NumPy bit for bit; Gauss–Markov signals against their statistics."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.signal import lfilter, welch

from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.signals.draws import normals, uniforms, words
from dualwinch.codegen.drivers.signals.signals import (
    FILL_PARTS,
    Drawn,
    OutageSignal,
    RandomSignal,
    Signals,
    UniformSignal,
    compile_fill,
    fill,
)
from dualwinch.codegen.drivers.unit import unit
from dualwinch.codegen.errors import CompilerNotFoundError
from tests.codegen.drivers.test_rollout import SANITISERS

COMPILERS = [*filter(shutil.which, ("gcc", "clang")), pytest.param("zig", marks=pytest.mark.external)]

MIXED = (
    *(RandomSignal(1, 2, 0.7), RandomSignal(1, 3, 2.0, 0.99), None),
    *(RandomSignal(2**64 - 1, 2**64 - 1, 3.0, 0.9, 1.5), RandomSignal(1, 4, 1.0, 1e-300), None),
    RandomSignal(1, 5, 2.0, 0.99, from_zero=True),
    *(UniformSignal(1, 5), UniformSignal(2**64 - 1, 2**64 - 1), OutageSignal(1, 6, 70, 9)),
    *(OutageSignal(2**64 - 1, 2**64 - 1, 3, 7), OutageSignal(1, 7, 1, 1), OutageSignal(1, 8, 2**32 - 1, 2**31 - 1)),
)
GIVEN = (
    *(np.linspace(0, 1, 1000), None, np.sin(np.arange(1000)), np.full(1000, -2.0), None, None, None),
    *(None, np.arange(1000) / 3, None, np.arange(1000) / 7, None, None),
)


def filled(lengths: list[int]) -> np.ndarray:
    signals, table, first = Signals(MIXED), np.full((sum(lengths), len(MIXED)), np.nan), 0
    for length in lengths:
        given = [None if values is None else values[first : first + length] for values in GIVEN]
        signals.give(given, first)
        signals.fill(table[first : first + length], first)
        first += length
    return table


def drawn(signal: Drawn, samples: int) -> np.ndarray:
    table = np.empty((samples, 1))
    Signals([signal]).fill(table, 0)
    return table[:, 0]


def autocorrelation(signal: np.ndarray, lag: int) -> float:
    return float(np.mean(signal[lag:] * signal[:-lag]) / np.mean(signal**2))


@pytest.fixture
def without_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DUALWINCH_CC", os.devnull)


@pytest.mark.parametrize("flags", [(), ("-O0",)])
@pytest.mark.parametrize("name", COMPILERS)
def test_every_compiler_gives_the_bits_of_numpy(name: str, flags: tuple[str, ...]) -> None:
    found = find_compiler(name)
    compiled = compile_fill(Compiler(found.name, (*found.command, *flags), found.version))
    signals, reference = Signals(MIXED).records, Signals(MIXED).records
    ours, theirs = np.empty((2, 1000, len(MIXED)))
    for first, end in ((0, 1), (1, 90), (90, 1000)):
        for filler, states, table in ((compiled, signals, ours), (fill, reference, theirs)):
            filler(states, first, table[first:end])
    assert ours.tobytes() == theirs.tobytes()
    assert signals.tobytes() == reference.tobytes()


@given(st.lists(st.integers(1, 300), min_size=1, max_size=3))
def test_pieces_are_the_whole(lengths: list[int]) -> None:
    assert filled(lengths).tobytes() == filled([sum(lengths)]).tobytes()


@pytest.mark.usefixtures("without_compiler")
def test_without_a_compiler_numpy_gives_the_bits() -> None:
    with pytest.raises(CompilerNotFoundError):
        find_compiler()
    alone = filled([700, 300])
    assert np.isfinite(alone).all()
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("DUALWINCH_CC")
        assert filled([1000]).tobytes() == alone.tobytes()


def test_given_and_random_add_up() -> None:
    table = filled([1000])
    white = 0.7 * normals(words(1, 2, 0, 1000))
    assert np.array_equal(table[:, 0], GIVEN[0] + white)
    assert (table[:, 2] == GIVEN[2]).all()
    assert (table[:, 5] == 0).all()


def test_the_random_part_is_limited() -> None:
    limited = filled([1000])[:, 3] + 2.0
    assert np.abs(limited).max() == 1.5
    assert 0.2 < np.mean(np.abs(limited) < 1.5) < 0.6


def test_gauss_markov_is_filtered_noise() -> None:
    draws = normals(words(1, 3, 0, 5000))
    draws[1:] *= np.sqrt(1 - 0.99**2)
    assert drawn(RandomSignal(1, 3, 2.0, 0.99), 5000) == pytest.approx(2 * lfilter([1], [1, -0.99], draws), abs=1e-12)


def test_gauss_markov_has_the_standard_deviation_and_the_correlation_time() -> None:
    signal = drawn(RandomSignal(1, 0, 2.0, np.exp(-0.01)), 400_000)
    assert signal.std() == pytest.approx(2, rel=0.05)
    assert signal.mean() == pytest.approx(0, abs=0.15)
    assert autocorrelation(signal, 100) == pytest.approx(np.exp(-1), abs=0.04)
    assert autocorrelation(signal, 200) == pytest.approx(np.exp(-2), abs=0.04)


def test_gauss_markov_is_stationary_from_its_first_sample() -> None:
    signals = np.array([drawn(RandomSignal(seed, 0, 3.0, np.exp(-0.02)), 50) for seed in range(4000)])
    assert signals.std(axis=0) == pytest.approx(np.full(50, 3.0), rel=0.08)


def test_gauss_markov_may_begin_at_zero() -> None:
    signals = np.array([drawn(RandomSignal(seed, 0, 3.0, 0.99, from_zero=True), 400) for seed in range(4000)])
    expected = 3 * np.sqrt(1 - 0.99 ** (2 * np.arange(1, 401)))
    assert signals.std(axis=0) == pytest.approx(expected, rel=0.08)


def test_gauss_markov_has_the_spectrum_of_its_decay() -> None:
    decay, segments = 0.9, 2 * 400_000 / 512 * 0.53  # half-overlapping Hann windows
    frequency, power = welch(drawn(RandomSignal(1, 0, 2.0, decay), 400_000), nperseg=512)
    expected = 2 * 4 * (1 - decay**2) / (1 - 2 * decay * np.cos(2 * np.pi * frequency) + decay**2)
    assert (power / expected)[8:-1] == pytest.approx(np.ones(248), abs=6 / segments**0.5)


def test_a_decay_of_zero_is_white_noise() -> None:
    assert np.array_equal(drawn(RandomSignal(1, 4, 1.0, 1e-300), 500), drawn(RandomSignal(1, 4, 1.0), 500))


def test_white_noise_may_be_uniform() -> None:
    signal = drawn(UniformSignal(1, 5), 100_000)
    exact = (words(1, 5, 0, 100_000).astype(np.uint32).view(np.int32) + 0.5) / 2**31
    assert signal == pytest.approx(exact, rel=1e-7, abs=0)
    assert stats.kstest(signal, "uniform", (-1, 2)).pvalue > 1e-3
    assert np.mean(signal**2) == pytest.approx(1 / 3, abs=5 * np.sqrt(4 / 45 / 100_000))


def test_uniform_noise_stays_within_one() -> None:
    ends = uniforms(np.array([0, 2**31 - 1, 2**31, 2**32 - 1], np.uint64))
    assert ends.tolist() == [2.0**-32, 1.0, -1.0, -(2.0**-32)]


@pytest.mark.skipif(not shutil.which("gcc"), reason="no gcc")
def test_sanitisers_find_nothing(tmp_path: Path) -> None:
    source = unit({}, [], *FILL_PARTS) + Path(__file__).with_name("sanitised.c").read_text()
    (tmp_path / "unit.c").write_text(source)
    command = ["gcc", "-std=c99", "-O1", "-g", *SANITISERS, "unit.c", "-o", "unit", "-lm"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr[:2000]
    done = subprocess.run([str(tmp_path / "unit")], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert np.isfinite(float(done.stdout))


def windows(period: int, length: int, count: int = 20_000) -> np.ndarray:
    return drawn(OutageSignal(1, 6, period, length), period * count).reshape(count, period)


@given(period=st.integers(1, 200), length=st.integers(1, 200))
def test_each_window_has_one_outage_within_it(period: int, length: int) -> None:
    table = windows(period, length, 20)
    assert np.isin(table, (0, 1)).all()
    changes = np.abs(np.diff(table, axis=1, prepend=0, append=0)).sum(axis=1)
    assert (changes == 2).all()
    shortest, longest = (min(limit, period) for limit in (length - length // 2, length + length // 2))
    assert table.sum(axis=1).min() >= shortest
    assert table.sum(axis=1).max() <= longest


def test_outages_are_of_all_lengths_alike() -> None:
    lengths, counts = np.unique(windows(100, 9).sum(axis=1), return_counts=True)
    assert lengths.tolist() == list(range(5, 14))
    assert stats.chisquare(counts).pvalue > 1e-3
    assert windows(8, 9).sum(axis=1).max() == 8


def test_outages_begin_anywhere_alike() -> None:
    table = windows(40, 5)
    lengths, begins = table.sum(axis=1), table.argmax(axis=1)
    for length in (3, 7):
        found, counts = np.unique(begins[lengths == length], return_counts=True)
        assert found.tolist() == list(range(40 - length + 1))
        assert stats.chisquare(counts).pvalue > 1e-3


def test_an_outage_tells_nothing_of_the_next() -> None:
    table = windows(40, 5)
    for values in (table.sum(axis=1), table.argmax(axis=1)):
        assert np.corrcoef(values[1:], values[:-1])[0, 1] == pytest.approx(0, abs=5 / np.sqrt(len(values)))
    assert np.corrcoef(table.sum(axis=1), table.argmax(axis=1))[0, 1] == pytest.approx(0, abs=0.1)
