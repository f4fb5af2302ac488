"""Peers that step the same plant, and the scores of policies."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import policies, stepping
from benchmarks.case import Case
from benchmarks.peers.peer import UnavailableError
from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.controllers.paper_controller import paper_controller
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.settings import override


def short() -> Ensemble:
    sea = load_ensemble("sea")
    return replace(sea, experiment=override(sea.experiment, {"simulation.duration": 0.5}))


def test_peers_step_the_same_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stepping, "CHECKED", 100)
    try:
        assert stepping.check(Case(), 3) < 1e-9
    except UnavailableError as missing:
        pytest.skip(str(missing))
    monkeypatch.setattr(stepping, "TOLERANCE", 0.0)
    with pytest.raises(ValueError, match="positions of 3 environments are"):
        stepping.check(Case(), 3)


@pytest.mark.slow
def test_a_bound_step_costs_little_of_a_called_one() -> None:
    for called, bound in stepping.step_costs(1e-3, 5).values():
        assert 0 < bound < called / 4


def test_the_table_gives_rates_and_ratios() -> None:
    names = list(stepping.PEERS)
    rates = {1: dict.fromkeys(names, 2e4) | {names[0]: 5e4}, 64: dict.fromkeys(names, 1e6) | {names[0]: 1.25e7}}
    head, _, first, *_, last = stepping.table(rates).splitlines()
    assert head == "| environments | 1 | 64 | over JAX: 1 | over JAX: 64 |"
    assert first == f"| {names[0]} | 50 | 12 500 | 2.5 × | 12.5 × |"
    assert last == f"| {stepping.JAX} | 20 | 1 000 |  |  |"


def test_controllers_and_policies_are_scored_in_the_same_scenarios() -> None:
    ensemble = short()
    paper = policies.of_controller("paper", paper_controller(), ensemble, 7, 3)
    mass = ensemble.experiment.plant.vehicle.mass
    lesson = policies.of_policy("lesson", policies.proportional_derivative(mass), ensemble, 7, 3)
    chance = policies.of_policy("chance", policies.by_chance(5800.0), ensemble, 7, 3)
    assert paper.rewards.shape == lesson.rewards.shape == (3,)
    assert paper.rewards.max() < 0
    assert paper.rewards.mean() > chance.rewards.mean()
    assert lesson.rewards.mean() > chance.rewards.mean()


def test_who_is_lost_has_no_mean() -> None:
    score = policies.Score("some", np.array([-1.0, np.nan, -3.0]))
    assert policies.table([score]).splitlines()[-1] == "| some | -2 | -2 | -3 | 1 of 3 |"
    assert policies.Score("none", np.array([np.nan])).row() == ["none", "–", "–", "–", "1 of 1"]
