"""Scenarios as scenario_groups: columns of plain numbers, and all else in common."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.batch.scenarios import experiment_of, scenario_groups, suspect_members
from dualwinch.simulation.ensembles.ensemble import Choice, Drawn, Ensemble, Uniform
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.exogenous.signals import exogenous_signals, exogenous_sources
from dualwinch.simulation.loop.structure import parameters_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.settings import override

RIG = reset(load_ensemble("rig"), {"simulation.duration": 0.2})
SEA = reset(load_ensemble("sea"), {"simulation.duration": 0.2})


def drawing(ensemble: Ensemble, **distributions: Any) -> Ensemble:
    more = {key.replace("__", "."): Drawn(distribution) for key, distribution in distributions.items()}
    return replace(ensemble, distributions={**ensemble.distributions, **more})


@pytest.mark.parametrize("ensemble", [SEA, RIG], ids=["sea", "rig"])
def test_an_ensemble_is_one_family_with_the_parameters_of_its_scenarios(ensemble: Ensemble) -> None:
    scenarios = ensemble.chosen(range(9), 7)
    (family,) = scenario_groups(scenarios)
    assert family.experiment is ensemble.experiment
    assert family.members.tolist() == list(range(9))
    assert not any("experiment" in vars(scenario) for scenario in scenarios), "none was made"
    for scenario, vector in zip(scenarios, family.vectors, strict=True):
        assert vector.tolist() == list(parameters_of(scenario.experiment, scenario.nominal).values())


def test_scenarios_of_a_family_receive_the_signals_of_their_experiments() -> None:
    sea = drawing(
        RIG,
        disturbance__current_sigma=Choice((0.0, 0.05)),
        disturbance__current_time=Uniform(5.0, 30.0),
        sensors__outage_period=Uniform(0.02, 0.1),
        sensors__position_noise=Choice((0.0, 1e-3)),
        plant__vehicle__normal_force=Uniform(4e3, 5e3),
    )
    scenarios = sea.chosen(range(8), 7)
    (family,) = scenario_groups(scenarios)
    sources = exogenous_sources(family.experiment, family.columns, len(scenarios))
    for scenario, signals in zip(scenarios, sources, strict=True):
        alone = exogenous_signals(scenario.experiment)
        ours = np.empty_like(alone)
        signals.fill(ours, 0)
        assert np.array_equal(ours, alone)


def test_what_more_follows_from_is_the_same_in_a_family() -> None:
    apart = {
        "reference__speed": Choice((1.0, 1.5)),
        "disturbance__vortex": Choice((True, False)),
        "controller__observer__l0": Choice((5.0, 8.0)),
    }
    scenarios = [*drawing(SEA, **apart).chosen(range(40), 7), case(4), case(4)]
    found = scenario_groups(scenarios)
    assert len(found) == 2**3 + 2
    assert sorted(member for family in found for member in family.members) == list(range(42))
    for family in found:
        for place, vector in zip(family.members, family.vectors, strict=True):
            experiment = experiment_of(scenarios[place])
            assert family.experiment.reference == experiment.reference
            nominal = family.nominal
            assert vector.tolist() == list(parameters_of(experiment, nominal).values())


def test_a_batch_of_families_gives_every_scenario_what_it_gives_alone() -> None:
    drawn = drawing(SEA, controller__observer__l0=Choice((5.0, 8.0))).chosen(range(5), 7)
    scenarios = [*drawn, *SEA.chosen(range(5), 8), SEA.experiment]
    together = rollout([], [[]], scenarios).metrics["mse"][0]
    alone = [rollout([], [[]], [scenario]).metrics["mse"][0, 0] for scenario in scenarios]
    assert together.tolist() == alone


SPOILT = {
    "plant__vehicle__mass": (Uniform(-1e4, 1e4), "plant.vehicle.mass = -"),
    "plant__rope_1__modulus": (Choice((8e10, 1e18)), "simulation.sample_time = 0.001: must be <= "),
    "plant__winch_1__eccentricity": (Choice((0.0, 0.05)), ""),
    "plant__winch_2__drum_radius": (Choice((0.8, 1e-4)), "plant.winch_2.eccentricity = "),
    "plant__rope_2__modulus": (Choice((8e10, 1e-320)), "plant: values too extreme to start from"),
    "sensors__encoder_counts": (Choice((4096, 4096.5)), "sensors.encoder_counts = 4096.5: must be a whole number"),
    "sensors__position_noise": (Choice((0.0, float("nan"))), "sensors.position_noise = nan"),
    "plant__vehicle__height": (Choice((3.0, True)), "plant.vehicle.height = true"),
    "sensors__outage": (Choice(("held", "loud")), 'sensors.outage = "loud"'),
    "disturbance__strouhal": (Choice((0.2, -0.2)), "disturbance.strouhal = -0.2"),
}


@pytest.mark.parametrize("key", SPOILT)
def test_scenarios_that_nobody_may_run_are_found_and_named(key: str) -> None:
    distribution, message = SPOILT[key]
    ensemble = drawing(RIG, **{key: distribution})
    wrong = []
    for scenario in ensemble.chosen(range(12), 7):
        try:
            prepare(scenario.experiment)
        except ConfigurationError as error:
            wrong.append(f"scenario {scenario.index}: {error}")
    if not message:
        assert not wrong
        run_ensemble(ensemble, 12, 7, traces=False)
        return
    assert len(wrong) < 12
    with pytest.raises(ConfigurationError) as caught:
        run_ensemble(ensemble, 12, 7, traces=False)
    assert str(caught.value) in wrong
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_sound_scenarios_are_not_looked_at_one_by_one() -> None:
    (family,) = scenario_groups(RIG.chosen(range(64), 7))
    assert not suspect_members(family).any()


def test_an_ensemble_about_values_that_nobody_may_run_has_sound_scenarios() -> None:
    """The experiment that scenarios share need not be one: what is wrong with it may be drawn."""
    base = override(SEA.experiment, {"plant.winch_1.eccentricity": 0.1, "plant.winch_1.drum_radius": 0.3})
    with pytest.raises(ConfigurationError, match="eccentricity"):
        prepare(base)
    sound = Ensemble("", "", base, {"plant.winch_1.eccentricity": Drawn(Uniform(0, 1e-4))})
    result = rollout([], [[]], sound.chosen(range(3), 1))
    assert (result.outcomes == "completed").all()
