"""Named alternatives: chosen by name, compared by a criterion, and a user's own."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from dualwinch.config.ensemble_file import load_ensemble
from dualwinch.config.plugins import register
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.alternatives import ALTERNATIVES, Alternative, selected
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.identify import identify
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.identification.screening import LogScreening, lighter_ropes, ropes_of
from dualwinch.toolboxes.identification.unknowns import nuisance_parameters
from tests.toolboxes.identification.conftest import logged, machine


@pytest.mark.parametrize(
    ("names", "kinds"),
    [
        ([], set(ALTERNATIVES)),
        (["all,-sea"], set(ALTERNATIVES) - {"sea"}),
        (["-sea", "-vortex-phase"], set(ALTERNATIVES) - {"sea", "vortex-phase"}),
        (["sea, load-cell-lag"], {"sea", "load-cell-lag"}),
        (["-all", "sea"], {"sea"}),
    ],
)
def test_names_add_and_leave_out(names: list[str], kinds: set[str]) -> None:
    assert selected(names) == kinds


def test_a_name_of_no_alternative_is_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"--alternatives -see: unknown alternative 'see'; did you mean 'sea'"):
        selected(["-see"])


@pytest.mark.slow
def test_an_alternative_of_ones_own_is_compared_and_chosen() -> None:
    @register
    @dataclass(frozen=True)
    class RubbingSheaves(Alternative):
        """Friction of both sheaves."""

        kind: ClassVar = "rubbing-sheaves"
        meaning: ClassVar = "ropes rub on their sheaves"

        def effect(self, experiment: Experiment) -> Mapping[str, float]:  # noqa: ARG002
            return {f"plant.winch_{side}.sheave_friction": 0.02 for side in (1, 2)}

    nominal = machine(simulation__duration=8.0)
    right = override(nominal, {f"plant.winch_{side}.sheave_friction": 0.03 for side in (1, 2)})
    found = identify(logged(right), "plant.vehicle.mass", nominal, alternatives="rubbing-sheaves")
    assert [each.alternatives for each in found.models] == [(), ("rubbing-sheaves",)]
    described, rubbing = found.models
    assert rubbing.criterion == 0
    assert described.criterion > 10
    assert rubbing.parameters == described.parameters + 2
    assert rubbing.weight == pytest.approx(1)
    for side in (1, 2):
        value, deviation = found.along[f"plant.winch_{side}.sheave_friction"]
        assert abs(value - 0.03) < 4 * deviation
    assert abs(found.values[0] - 1e4) < 4 * found.deviations[0]
    assert "rubbing-sheaves" in repr(found)
    record = found.to_record()["models"]
    assert [each["alternatives"] for each in record] == [(), ("rubbing-sheaves",)]
    assert np.isclose(sum(each["weight"] for each in record), 1)


@pytest.mark.slow
def test_an_interruption_keeps_the_fits_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    nominal = machine(simulation__duration=8.0)
    right = override(nominal, {f"plant.winch_{side}.inertia": 2.2 for side in (1, 2)})
    run, runs = PredictionErrorMethod.run, list[int]()

    def interrupted(*arguments: Any, **named: Any) -> Any:
        runs.append(1)
        if len(runs) > 1:
            raise KeyboardInterrupt
        return run(*arguments, **named)

    monkeypatch.setattr(PredictionErrorMethod, "run", interrupted)
    found = identify(logged(right), "plant.vehicle.mass", nominal, unrecorded=1.0)
    assert found.interrupted
    assert [each.alternatives for each in found.models] == [()]
    assert "interrupted: other alternatives were not compared" in found.notes


@pytest.mark.parametrize(("density", "sea"), [(1000.0, True), (1.2, False)])
def test_a_sea_is_an_alternative_in_water_alone(density: float, sea: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds: list[frozenset[str]] = []

    def screening(*arguments: Any) -> None:
        kinds.append(arguments[-1])
        raise InterruptedError

    monkeypatch.setattr("dualwinch.toolboxes.identification.identify.LogScreening", screening)
    plant = machine(simulation__duration=1.0, plant__vehicle__water_density=density)
    with pytest.raises(InterruptedError):
        identify(logged(plant), "plant.vehicle.mass", plant)
    assert ("sea" in kinds[0]) == sea


def test_without_a_share_there_are_no_nuisance_parameters() -> None:
    assert not nuisance_parameters([], machine(), replace(DEFAULTS.search, nuisance_share=0.0))
    assert nuisance_parameters([], machine(), DEFAULTS.search)


ROPES = {"plant.rope_*.mass_per_length": 2.36, "plant.rope_*.submerged_weight": 20.2, "plant.track.roller_spacing": 1.0}


def test_lighter_ropes_are_without_weight_and_then_without_mass() -> None:
    heavy = override(machine(), ROPES)
    described, weightless, light = lighter_ropes(heavy, ["plant.vehicle.mass"])
    assert described == heavy
    assert (weightless.plant.rope_1.mass_per_length, weightless.plant.rope_2.submerged_weight) == (2.36, 0.0)
    assert set(ropes_of(light).values()) == {0.0}
    assert lighter_ropes(heavy, ["plant.rope_1.mass_per_length"]) == [heavy], "which is estimated"
    assert lighter_ropes(machine(), []) == [machine()], "which are light as described"


@pytest.mark.slow
@pytest.mark.parametrize("is_heavy", [False, True])
def test_ropes_without_weight_are_likelier_where_the_log_shows_none(is_heavy: bool) -> None:
    """Also where mass and moduli are off."""
    site = override(load_ensemble("site").experiment, {"simulation.duration": 4.0, "simulation.readings": True})
    light = override(site, dict.fromkeys(ropes_of(site), 0.0))
    log = logged(site if is_heavy else light).from_zero()
    nominal = override(site, {"plant.vehicle.mass": 1.05e4, "plant.rope_*.modulus": 9e10})
    screening = LogScreening([log], nominal, (), None, frozenset(ALTERNATIVES))
    likeliest = screening.likeliest_ropes(nominal, DEFAULTS)
    assert ropes_of(likeliest) == ropes_of(site if is_heavy else light)
