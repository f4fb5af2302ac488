"""Named alternatives: chosen by name, compared by a criterion, and a user's own."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from dualwinch.config.plugins import register
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.settings import override
from dualwinch.toolboxes.identification.alternatives import ALTERNATIVES, Alternative, selected
from dualwinch.toolboxes.identification.estimate import PredictionErrorMethod
from dualwinch.toolboxes.identification.identify import identify
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
    with pytest.raises(ConfigurationError, match=r"--without -see: unknown alternative 'see'; did you mean 'sea'"):
        selected(["-see"], "--without")


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
