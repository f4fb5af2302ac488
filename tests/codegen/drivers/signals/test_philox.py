"""Philox4x32-10 against the vectors its authors publish with Random123 (``tests/kat_vectors``), and its streams."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.drivers.signals.draws import blocks, philox, words
from dualwinch.codegen.drivers.unit import c_file

KNOWN = [  # counter, key, block; lowest word first
    ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
    ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]
WORD = st.integers(0, 2**64 - 1)
WIDTH = 16


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    source = c_file("driver.h") + c_file("signals/philox.h")
    source += """
EXPORT void draw(uint64_t *seeds, uint64_t *streams, uint64_t number, uint32_t *words) {
  Keys keys;
  for (int l = 0; l < WIDTH; ++l) set_keys(&keys, l, seeds[l]);
  draw_words(&keys, streams, number, words);
}
"""
    target: Path = tmp_path_factory.mktemp("philox") / "philox.so"
    find_compiler().build(source, target)
    loaded = ctypes.CDLL(str(target))
    loaded.draw.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint64, ctypes.c_void_p]
    return loaded


def compiled_blocks(library: ctypes.CDLL, seeds: list[int], streams: list[int], number: int) -> np.ndarray:
    """(16, 4): of 16 streams the block of a number."""
    drawn, names = np.empty((4, WIDTH), np.uint32), np.array([seeds, streams], np.uint64)
    library.draw(names[0].ctypes.data, names[1].ctypes.data, number, drawn.ctypes.data)
    return drawn.T


@pytest.mark.parametrize(("counter", "key", "block"), KNOWN)
def test_known_answers(counter: tuple[int, ...], key: tuple[int, int], block: tuple[int, ...]) -> None:
    a, b, c, d = (np.array([word], np.uint64) for word in counter)
    assert tuple(int(word[0]) for word in philox((a, b, c, d), key)) == block


@pytest.mark.parametrize(("counter", "key", "block"), KNOWN)
def test_known_answers_of_the_compiled_code(
    counter: tuple[int, ...], key: tuple[int, int], block: tuple[int, ...], library: ctypes.CDLL
) -> None:
    number, stream = (low + (high << 32) for low, high in (counter[:2], counter[2:]))
    drawn = compiled_blocks(library, [key[0] + (key[1] << 32)] * WIDTH, [stream] * WIDTH, number)
    assert {tuple(row) for row in drawn.tolist()} == {block}


@given(seeds=st.lists(WORD, min_size=16, max_size=16), streams=st.lists(WORD, min_size=16, max_size=16), number=WORD)
def test_numpy_draws_the_words_of_the_compiled_code(
    seeds: list[int], streams: list[int], number: int, library: ctypes.CDLL
) -> None:
    number = min(number, 2**62)
    ours = np.concatenate([blocks(seed, stream, number, 1) for seed, stream in zip(seeds, streams, strict=True)])
    assert np.array_equal(ours, compiled_blocks(library, seeds, streams, number))


@given(seed=WORD, stream=WORD, first=st.integers(0, 1000), samples=st.integers(1, 300))
def test_any_sample_is_drawn_without_those_before_it(seed: int, stream: int, first: int, samples: int) -> None:
    whole = words(seed, stream, 0, first + samples)
    assert np.array_equal(words(seed, stream, first, samples), whole[first:])


def test_every_bit_is_set_in_half_of_the_words() -> None:
    drawn = words(1, 2, 0, 200_000).astype(np.uint32)
    set_bits = (drawn[:, np.newaxis] >> np.arange(32, dtype=np.uint32)) & 1
    assert np.abs(set_bits.mean(axis=0) - 0.5).max() < 5 * 0.5 / np.sqrt(len(drawn))


def test_neighbouring_seeds_and_streams_share_no_words() -> None:
    """Of 5 times 4000 words of 32 bits, less than one pair is equal by chance on average in twenty draws."""
    drawn = [words(*name, 0, 4000) for name in ((0, 0), (1, 0), (0, 1), (2**32, 0), (0, 2**32))]
    assert len(np.unique(np.concatenate(drawn))) >= 5 * 4000 - 2
