import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dualwinch.config.experiment_file import load, loads, to_toml
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.coordinations.master_slave import MasterSlave
from dualwinch.controllers.estimators.kalman import Kalman, KalmanGains
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.nftsm import Nftsm, NftsmGains
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import owners
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, case
from dualwinch.simulation.settings import known_keys, override
from tests.tiers import pairwise


@pytest.mark.parametrize("number", CASES)
def test_what_is_printed_is_read_back(number: int, tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    file.write_text(to_toml(case(number)))
    assert load(file) == load(str(file)) == case(number)


@pytest.mark.parametrize(("law", "estimator", "coordination"), pairwise(POSITION_LAWS, ESTIMATORS, COORDINATIONS))
def test_every_controller_is_read_back(law: str, estimator: str, coordination: str, tmp_path: Path) -> None:
    controller = Controller(ESTIMATORS[estimator](), POSITION_LAWS[law](), coordination=COORDINATIONS[coordination]())
    file = tmp_path / "own.toml"
    file.write_text(to_toml(Experiment(controller=controller)))
    assert load(file) == Experiment(controller=controller)


def entries(text: str) -> dict[str, str]:
    """Key → line of a written experiment, with keys that are left open."""
    found, table = {}, ""
    for line in text.splitlines():
        if line.startswith("["):
            table = line.split("]")[0].strip("[")
        elif " = " in line:
            found[f"{table}.{line.removeprefix('# ').split(' ')[0]}".removeprefix(".")] = line
    return found


def test_every_key_is_printed_with_its_meaning_where_it_counts() -> None:
    """Gains stand where a part has them that is chosen, and nowhere else."""
    for key, leaf in known_keys().items():
        choice, kinds = owners(Experiment, key)
        for chosen in [{choice: kind} for kind in kinds] or [{}]:
            line = entries(to_toml(override(Experiment(), chosen)))[key]
            assert leaf.quantity.meaning in line.split("#", 1 + line.startswith("#"))[-1], (key, line)
    printed = entries(to_toml(Experiment()))
    assert "controller.nftsm.beta" in printed
    assert not [key for key in printed if key.startswith(("controller.adrc.", "controller.kalman."))]


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
    ("text", "message"),
    [
        ("[plant.vehicle]\n\nmass = -1\n", ":3: plant.vehicle.mass = -1"),
        ("plant.vehicle.mass = 0.0\n", ":1: plant.vehicle.mass = 0.0"),
        ("[plant.vehicle]\nmas = 1\n", ":2: unknown key 'plant.vehicle.mas'"),
        ("[plant\n", "line 1"),
        ("a = \n", "line 1"),
        ("[plant]\nvehicle = 3\n", ":2: plant.vehicle is a table"),
        ("[controller]\nkind = 'nftms'\n", ':2: controller.kind = "nftms": must be "fando-nftsm" or "nftsm"'),
        ("[controller.adrc]\n\ncontrol_bandwidth = -1\n", ":3: controller.adrc.control_bandwidth = -1: must be"),
        ("[controller.adrc]\nbandwidth = 1\n", ":2: unknown key 'controller.adrc.bandwidth'; did you mean"),
    ],
)
def test_wrong_files_name_file_and_line(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "case.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError) as caught:
        load(file)
    assert "case.toml" in str(caught.value)
    assert message in str(caught.value)


def test_a_byte_order_mark_is_none_of_the_text(tmp_path: Path) -> None:
    file = tmp_path / "marked.toml"
    file.write_text("plant.vehicle.mass = 9e3\n", encoding="utf-8-sig")
    assert load(file).plant.vehicle.mass == 9e3


def test_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot read .*none\.toml: No such file"):
        load(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigurationError, match="not UTF-8"):
        load(tmp_path / "binary.toml")
    with pytest.raises(ConfigurationError, match="cannot read"):
        load(tmp_path)


SEVERAL = """
[controller]
kind = "nftsm"
[controller.nftsm]
beta = 0.2
[controller.adrc]
control_bandwidth = 7
[controller.kalman]
bandwidth = 30
[controller.master_slave]
kp = 9
"""


def test_a_file_may_hold_gains_of_parts_that_are_not_chosen(tmp_path: Path) -> None:
    file = tmp_path / "several.toml"
    file.write_text(SEVERAL)
    assert load(file) == override(Experiment(), {"controller.kind": "nftsm", "controller.nftsm.beta": 0.2})


def test_they_count_where_settings_choose_their_part(tmp_path: Path) -> None:
    file = tmp_path / "several.toml"
    file.write_text(SEVERAL)
    assert load(file, settings={"controller.kind": "adrc"}).controller == Controller(law=Adrc(7.0))
    both = {"controller.estimator": "kalman", "controller.coordination.kind": "master-slave"}
    assert load(file, settings=both).controller == Controller(
        Kalman(KalmanGains(bandwidth=30.0)), Nftsm(NftsmGains(beta=0.2)), coordination=MasterSlave(kp=9.0)
    )
    over = {"controller.kind": "adrc", "controller.adrc.control_bandwidth": 5}
    assert load(file, settings=over).controller.law == Adrc(5.0)


def test_a_setting_must_count_though_a_files_key_need_not(tmp_path: Path) -> None:
    file = tmp_path / "several.toml"
    file.write_text(SEVERAL)
    with pytest.raises(ConfigurationError) as caught:
        load(file, settings={"controller.adrc.control_bandwidth": 5})
    assert str(caught.value) == (
        'controller.adrc.control_bandwidth: belongs to controller.kind = "adrc", here it is "nftsm"'
    )


@pytest.mark.parametrize("table", ["plnt", "plant.winch_3"])
def test_an_empty_table_that_there_is_not_is_refused(table: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^configuration:3: unknown table '{table}'; did you mean"):
        loads(f"[plant.vehicle]\n[plant]\n[{table}]\n")


def test_a_base_gives_what_a_file_does_not_have(tmp_path: Path) -> None:
    file = tmp_path / "several.toml"
    file.write_text("[controller.adrc]\ncontrol_bandwidth = 7\n")
    base = override(case(4, "adrc"), {"controller.adrc.observer_bandwidth": 33, "plant.vehicle.mass": 9e3})
    assert load(file, base) == override(base, {"controller.adrc.control_bandwidth": 7})


def test_a_files_motion_counts_where_its_kind_is_given_there_or_by_settings(tmp_path: Path) -> None:
    path = tmp_path / "motion.toml"
    path.write_text("[reference]\npoints = [10.0, 20.0]\n")
    with pytest.raises(ConfigurationError, match=r"motion\.toml:2: reference\.points: belongs to reference\.kind = "):
        load(path)
    assert load(path, settings={"reference.kind": "way-points"}).reference.points == (10.0, 20.0)
    path.write_text('[reference]\nkind = "way-points"\npoints = [10.0, 20.0]\n')
    assert load(path, settings={"reference.kind": "uniform"}).reference.kind == "uniform"
