"""Keys under their old names, wherever a key enters."""

from pathlib import Path

import pytest

from dualwinch.config.ensemble_file import ensemble_to_toml, load_ensemble, reset
from dualwinch.config.experiment_file import load, to_toml
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.paper import case
from dualwinch.simulation.settings import RENAMED, known_keys, override


def test_every_new_name_is_a_key_and_no_old_one_is() -> None:
    assert set(RENAMED.values()) <= set(known_keys())
    assert not set(RENAMED) & set(known_keys())


def test_the_seed_of_before_is_understood(tmp_path: Path) -> None:
    asked = override(case(4), {"disturbance.seed": 7})
    assert asked == override(case(4), {"simulation.seed": 7})
    assert "\nseed = 7 " in to_toml(asked)
    file = tmp_path / "old.toml"
    file.write_text("[disturbance]\nvortex = true\nseed = 7\n")
    assert load(file).simulation.seed == 7
    file.write_text("[disturbance]\nseed = -1\n")
    with pytest.raises(ConfigurationError, match=r"old\.toml:2: simulation\.seed = -1: must be a whole number >= 0"):
        load(file)


def test_an_ensemble_that_draws_the_seed_of_before(tmp_path: Path) -> None:
    file = tmp_path / "old.toml"
    file.write_text("[distributions]\ndisturbance.seed = { choice = [3, 4] }\n")
    ensemble = load_ensemble(file)
    assert {scenario.experiment.simulation.seed for scenario in ensemble.scenarios(20, 0)} == {3, 4}
    assert "simulation.seed = { choice = [3, 4] }" in ensemble_to_toml(ensemble)
    with pytest.raises(ConfigurationError, match=r"disturbance\.seed: is drawn in the ensemble 'old'"):
        reset(ensemble, {"disturbance.seed": 5})
    assert reset(load_ensemble("sea"), {"disturbance.seed": 5}).experiment.simulation.seed == 5
