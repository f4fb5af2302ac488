"""Values that do not fit together: one line that names the key and what is allowed."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from dualwinch.codegen.errors import DualwinchError
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import owners
from dualwinch.model.reference import Reference
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, CONTROLLERS, case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.results.outcomes import WORDS
from dualwinch.simulation.settings import known_keys, override
from dualwinch.simulation.simulate import simulate

FAST = Reference(kind="uniform", speed=2.1)


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
