"""Values that do not fit together: one line that names the key and what is allowed."""

from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from dualwinch.codegen.errors import DualwinchError
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.nftsm import Nftsm, NftsmGains
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import owners
from dualwinch.model.reference import Reference
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.experiment import Experiment, Simulation
from dualwinch.simulation.paper import CASES, CONTROLLERS, case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.results.outcomes import WORDS
from dualwinch.simulation.settings import known_keys, override
from dualwinch.simulation.simulate import simulate

FAST = Reference(kind="uniform", speed=2.1)
OUT_OF_RANGE: dict[str, tuple[Callable[[], Experiment], str]] = {
    "plant": (
        lambda: Experiment(plant=Plant(vehicle=Vehicle(mass=-1.0))),
        "plant.vehicle.mass = -1.0: must be a finite number > 0 kg",
    ),
    "gain": (
        lambda: Experiment(controller=Controller(law=Nftsm(NftsmGains(beta=0.0)))),
        "controller.nftsm.beta = 0.0: must be a finite number > 0 m^(p/q-1)/s^(p/q)",
    ),
    "gain of a part": (
        lambda: Experiment(controller=Controller(law=Adrc(observer_bandwidth=float("nan")))),
        "controller.adrc.observer_bandwidth = nan: must be a finite number > 0 rad/s",
    ),
    "limit": (
        lambda: replace(case(1), controller=Controller(limits=Limits(reserve=-1.0))),
        "controller.coordination.reserve = -1.0: must be a finite number >= 0 N",
    ),
    "what is not given": (
        lambda: replace(case(1), controller=Controller(nominal=Nominal(mass=0.0))),
        "controller.nominal.mass = 0.0: must be a finite number > 0 kg",
    ),
    "whole number": (
        lambda: replace(case(1), simulation=Simulation(substeps=257)),
        "simulation.substeps = 257: must be a whole number >= 1 and <= 256",
    ),
    "type": (
        lambda: replace(case(1), simulation=Simulation(delay_samples=1.5)),  # pyright: ignore[reportArgumentType]
        "simulation.delay_samples = 1.5: must be a whole number >= 0 and <= 100",
    ),
    "word": (
        lambda: Experiment(reference=Reference(kind="ramp")),  # pyright: ignore[reportArgumentType]
        'reference.kind = "ramp": must be "uniform" or "profile" or "way-points" or "file"',
    ),
}


@pytest.mark.parametrize(("build", "message"), OUT_OF_RANGE.values(), ids=OUT_OF_RANGE)
def test_no_experiment_is_built_with_a_value_out_of_its_range(build: Callable[[], Experiment], message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        build()
    assert str(caught.value) == message


def test_values_that_only_do_not_go_together_may_be_built() -> None:
    """They may be set one after the other."""
    between = override(case(1), {"controller.coordination.tension_min": 1500.0})
    with pytest.raises(ConfigurationError, match=r"^controller\.coordination\.preload = 2000: must be > 3000"):
        prepare(between)
    prepare(override(between, {"controller.coordination.preload": 4000.0}))


@pytest.mark.parametrize("kind", POSITION_LAWS)
@pytest.mark.parametrize("estimator", ESTIMATORS)
@pytest.mark.parametrize("coordination", COORDINATIONS)
def test_every_controller_there_is_is_sound_as_it_comes(kind: str, estimator: str, coordination: str) -> None:
    law, filtered, shared = POSITION_LAWS[kind](), ESTIMATORS[estimator](), COORDINATIONS[coordination]()
    prepare(Experiment(controller=Controller(filtered, law, coordination=shared)))


@pytest.mark.parametrize("number", CASES)
def test_the_papers_cases_are_sound(number: int) -> None:
    for kind in CONTROLLERS:
        prepare(case(number, kind))


def test_a_reference_may_end_at_the_tracks_end() -> None:
    prepare(Experiment(reference=replace(FAST, speed=2.0)))


def outcome_of(values: dict[str, Any]) -> str:
    """Outcome of a short run, or what the error says."""
    try:
        return simulate(override(Experiment(), {"simulation.duration": 0.02} | values)).outcome
    except DualwinchError as error:
        return str(error)


@pytest.mark.slow
@pytest.mark.parametrize("quarter", range(4))
def test_every_number_at_its_extremes_gives_an_outcome_or_one_line(quarter: int) -> None:
    """Gains in the parts that have them, of whatever kind."""
    numbers = [key for key, leaf in known_keys().items() if leaf.kind is float]
    for key in np.array_split(numbers, 4)[quarter].tolist():  # keys of a part, and all values of a key, share code
        choice, kinds = owners(Experiment, key)
        for chosen, value in product([{choice: kind} for kind in kinds] or [{}], (1e-300, 1e-30, 1e30, 1e300)):
            words = outcome_of(chosen | {key: value})
            assert words in WORDS.values() or "must be" in words or "too extreme" in words, (key, value, chosen, words)
            assert "\n" not in words, key
