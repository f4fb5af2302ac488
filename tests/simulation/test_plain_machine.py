"""A machine without AVX: the same batch, built for plain x86-64, gives the same answers."""

import platform
from dataclasses import dataclass

import numpy as np
import pytest

from dualwinch.codegen import compiler
from dualwinch.codegen.compiler import Compiler, find_compiler
from dualwinch.codegen.drivers.batch import LANES
from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.simulate import simulate


@dataclass(frozen=True)
class Plain(Compiler):
    """A compiler that knows nothing of this machine's processor."""

    @property
    def flags(self) -> tuple[str, ...]:
        """Flags of a library for any x86-64."""
        return tuple("-march=x86-64" if flag == "-march=native" else flag for flag in super().flags)


@pytest.fixture(scope="module")
def scenarios() -> list[Scenario]:
    sea = reset(load_ensemble("sea"), {"simulation.duration": 3.0})
    return list(sea.scenarios(LANES + 1, 7))


@pytest.fixture(scope="module")
def native(scenarios: list[Scenario]) -> BatchResult:
    return rollout([], np.empty((1, 0)), scenarios, stride=1)


@pytest.mark.skipif(platform.machine().lower() not in {"x86_64", "amd64"}, reason="-march=x86-64")
def test_a_machine_without_vector_instructions_gives_the_same_answers(
    scenarios: list[Scenario], native: BatchResult, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = find_compiler()
    plain = Plain(found.name, found.command, found.version)
    assert plain.identity != found.identity
    with monkeypatch.context() as patched:
        patched.setattr(compiler, "find_compiler", lambda: plain)
        fallback = rollout([], np.empty((1, 0)), scenarios, stride=1)
    assert (fallback.outcomes == native.outcomes).all()
    assert np.abs(fallback.columns["x"] - native.columns["x"]).max() < 1e-9
    assert not np.array_equal(fallback.columns["x"], native.columns["x"])  # it is another build
    for j in (0, LANES):
        alone = simulate(scenarios[j].experiment, nominal=scenarios[j].nominal)
        assert np.abs(fallback.columns["x"][0, j] - alone["x"]).max() < 1e-9
