import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.config.experiment_file import load, to_toml
from dualwinch.config.settings import known_keys, override
from dualwinch.config.toml_text import parse_assignment
from dualwinch.controllers.coordinations.registry import COORDINATIONS
from dualwinch.controllers.estimators.registry import ESTIMATORS
from dualwinch.controllers.laws.registry import POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, case


@pytest.mark.parametrize("number", CASES)
def test_what_is_printed_is_read_back(number: int, tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    file.write_text(to_toml(case(number)))
    assert load(file) == load(str(file)) == case(number)


CHOICES = [
    *({"controller.kind": kind} for kind in POSITION_LAWS),
    *({"controller.estimator": kind} for kind in ESTIMATORS),
    *({"controller.coordination.kind": kind} for kind in COORDINATIONS),
]


def test_every_key_is_printed_with_its_meaning() -> None:
    written = [to_toml(override(Experiment(), choices)) for choices in CHOICES]
    text = "\n".join(written)
    for key, leaf in known_keys().items():
        line = next(
            line for line in text.splitlines() if line.removeprefix("# ").startswith(key.rsplit(".", 1)[1] + " ")
        )
        assert line.count("#") >= 1
        assert leaf.quantity.meaning in text


@given(
    mass=st.floats(1e-3, 1e12),
    beta=st.floats(1e-9, 1e9),
    vortex=st.booleans(),
    delay=st.integers(0, 100),
)
def test_any_value_survives_the_round_trip(mass: float, beta: float, vortex: bool, delay: int) -> None:
    values = {
        "plant.vehicle.mass": mass,
        "controller.nftsm.beta": beta,
        "disturbance.vortex": vortex,
        "simulation.delay_samples": delay,
        "controller.nominal.mass": mass / 2,
    }
    table = tomllib.loads(to_toml(override(Experiment(), values)))
    assert table["plant"]["vehicle"]["mass"] == mass
    assert table["controller"]["nftsm"]["beta"] == beta
    assert table["controller"]["nominal"]["mass"] == mass / 2
    assert table["disturbance"]["vortex"] is vortex
    assert table["simulation"]["delay_samples"] == delay


def test_a_file_may_hold_only_what_differs(tmp_path: Path) -> None:
    file = tmp_path / "heavy.toml"
    file.write_text("[plant.vehicle]\nmass = 11000\n")
    experiment = load(file)
    assert experiment.plant.vehicle.mass == 11000.0
    assert {key for key, value in leaves(experiment).items() if value != leaves(Experiment())[key]} == {
        "plant.vehicle.mass"
    }


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("plant.vehicle.mas=3", "did you mean 'plant.vehicle.mass'"),
        ("mass=3", "did you mean 'plant.vehicle.mass'"),
        ("plant.vehicle=3", "plant.vehicle is a table"),
        ("completely.different=1", "unknown key 'completely.different'; did you mean"),
        ("plant.vehicle.mass=-1", "plant.vehicle.mass = -1: must be a finite number > 0 kg"),
        ("plant.vehicle.mass=nan", "finite number > 0"),
        ("plant.vehicle.mass=inf", "finite number > 0"),
        ("plant.vehicle.mass=heavy", "finite number > 0"),
        ("plant.vehicle.mass=true", "finite number > 0"),
        ("plant.vehicle.mass=[1]", "finite number > 0"),
        ("controller.nftsm.p=5.0", "whole number >= 3"),
        ("simulation.sample_time=0", "> 0 and <= 0.1 s"),
        ("simulation.duration=-3", "simulation.duration = -3: must be a finite number > 0 s"),
        ("simulation.substeps=0", ">= 1 and <= 256"),
        ("reference.kind=unform", '"uniform" or "profile"'),
        ("controller.kind=pid", '"fando-nftsm" or "nftsm" or "pid-cascade"'),
        ("disturbance.vortex=1", "true or false"),
        ("just words", "key=value"),
    ],
)
def test_wrong_input_is_one_line_that_helps(assignment: str, message: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        override(Experiment(), dict([parse_assignment(assignment)]))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[plant.vehicle]\n\nmass = -1\n", ":3: plant.vehicle.mass = -1"),
        ("plant.vehicle.mass = 0.0\n", ":1: plant.vehicle.mass = 0.0"),
        ("[plant.vehicle]\nmas = 1\n", ":2: unknown key 'plant.vehicle.mas'"),
        ("[plant\n", "line 1"),
        ("a = \n", "line 1"),
        ("[plant]\nvehicle = 3\n", ":2: plant.vehicle is a table"),
    ],
)
def test_wrong_files_name_file_and_line(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load(file)
    assert "case.toml" in str(caught.value)
    assert message in str(caught.value)


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot read .*none\.toml: No such file"):
        load(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigurationError, match="not UTF-8"):
        load(tmp_path / "binary.toml")
    with pytest.raises(ConfigurationError, match="cannot read"):
        load(tmp_path)
