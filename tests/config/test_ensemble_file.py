import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dualwinch.config.ensemble_file import built_in_ensembles, ensemble_to_toml, load_ensemble, loads_ensemble, reset
from dualwinch.config.plugins import register
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.description import describe_parts
from dualwinch.model.quantities.quantity import Mark
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.simulation.ensembles.ensemble import Choice, Drawn, Ensemble, Normal, Uniform
from dualwinch.simulation.ensembles.result import save_ensemble
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.paper import case
from dualwinch.simulation.sensors import DELAYS, FAULTS
from dualwinch.simulation.settings import override
from tests.conftest import exit_code
from tests.own_distributions import Triangular

MASS = "plant.vehicle.mass"


def written(text: str, folder: Path) -> Path:
    path = folder / "my.toml"
    path.write_text(text)
    return path


def test_the_rig_is_the_sea_and_more() -> None:
    sea, rig = load_ensemble("sea"), load_ensemble("rig")
    assert {key: rig.distributions[key] for key in sea.distributions} == sea.distributions
    there, here, plain = (leaves(experiment) for experiment in (sea.experiment, rig.experiment, case(4)))
    of_the_sea = {key for key, value in there.items() if value != plain.get(key)}
    assert {key: here[key] for key in of_the_sea} == {key: there[key] for key in of_the_sea}
    for key in (*rig.distributions, *here):
        assert not key.startswith("controller.") or here[key] == there[key]


UNUSUAL = {f"sensors.{name}" for name in (*DELAYS, *FAULTS, "position_rate")}
UNUSUAL |= {f"plant.winch_{side}.{name}" for side in (1, 2) for name in ("sheave_friction", "cell_beyond")}
UNUSUAL |= {"plant.vehicle.cross_current"}
"""Late, slow and faulty sensors, sheaves, and a current across the track, which no built-in ensemble has."""


def test_the_rig_holds_every_imperfection() -> None:
    """All that is zero of a perfect machine is drawn, or set, but for what the site has."""
    assert _left_out("rig") - UNUSUAL == {
        *(f"plant.rope_{side}.{name}" for side in (1, 2) for name in ("mass_per_length", "submerged_weight")),
        *(f"plant.winch_{side}.{name}" for side in (1, 2) for name in ("gear_stiffness", "gear_loss")),
        *(f"plant.winch_{side}.transmission_error" for side in (1, 2)),
        *(f"plant.rope_{side}.hysteresis" for side in (1, 2)),
        *("plant.vehicle.stiction", "plant.vehicle.bristle_stiffness", "plant.vehicle.bristle_damping"),
        *("plant.track.roller_spacing", "plant.track.tilt", "plant.track.waviness"),
        *("sensors.speed_error", "sensors.load_cell_time_constant", "sensors.drum_speed_resolution"),
    }


def test_the_site_holds_the_rest() -> None:
    """Gears that rub are left out: they make the winches' friction larger, which the rig has."""
    assert _left_out("site") - UNUSUAL == {f"plant.winch_{side}.gear_loss" for side in (1, 2)}


def _left_out(name: str) -> set[str]:
    """Keys of what is zero of a perfect machine, and in all scenarios of an ensemble."""
    ensemble, marks = load_ensemble(name), {Mark.UNKNOWN, Mark.SHAPES_CODE_AT_ZERO}
    groups = ("plant.", "sensors.", "simulation.")
    zero = {
        key
        for key, leaf in describe_parts(case(4)).items()
        if key.startswith(groups) and leaf.default == 0 and (leaf.marks & marks or key.startswith("sensors."))
    }
    given = {key for key, value in leaves(ensemble.experiment).items() if value}
    return zero - given - set(ensemble.distributions)


def test_sea_is_what_its_documentation_says() -> None:
    sea = load_ensemble("sea")
    ends = {key: (*drawn.distribution.ends, drawn.relative, drawn.together) for key, drawn in sea.distributions.items()}
    assert ends == {
        MASS: (0.9, 1.1, True, None),
        "plant.vehicle.drag_coefficient": (0.8, 1.2, True, None),
        "plant.vehicle.friction_coefficient": (0.5, 1.5, True, None),
        "plant.rope_1.modulus": (0.9, 1.1, True, None),
        "plant.rope_2.modulus": (0.9, 1.1, True, None),
        "plant.rope_1.damping": (0.7, 1.3, True, None),
        "plant.rope_2.damping": (0.7, 1.3, True, None),
        "plant.winch_1.inertia": (0.9, 1.1, True, None),
        "plant.winch_2.inertia": (0.9, 1.1, True, None),
        "disturbance.strouhal": (0.18, 0.22, False, None),
    }
    set_values = {
        "disturbance.current_sigma": 0.05,
        "disturbance.normal_force_sigma": 0.1,
        "sensors.position_noise": 5e-4,
        "sensors.position_resolution": 1e-3,
        "sensors.speed_noise": 2e-3,
        "sensors.tension_noise": 10.0,
        "sensors.encoder_counts": 4096,
        "simulation.delay_samples": 1,
        "plant.winch_1.coulomb_friction": 96.0,
        "plant.winch_2.coulomb_friction": 96.0,
    }
    assert sea.experiment == override(case(4), set_values)  # current 20 s, ±0.154 m/s; rail load 5 s: the defaults


@pytest.mark.parametrize("name", built_in_ensembles())
def test_what_is_printed_is_read_back(name: str, tmp_path: Path) -> None:
    ensemble = load_ensemble(name)
    assert load_ensemble(str(written(ensemble_to_toml(ensemble), tmp_path))) == ensemble


def test_every_kind_of_entry_is_read_and_printed(tmp_path: Path) -> None:
    text = """
        [distributions]
        "plant.vehicle.mass" = { normal = [1, 0.05], within = [0.9, 1.1], of = "nominal", together = "load" }
        [distributions.plant.vehicle]
        height = { uniform = [2, 3], together = "load" }
        water_density = { choice = [1000, 1025] }
        [distributions.disturbance]
        vortex = { choice = [true, false] }
    """
    ensemble = load_ensemble(written(text, tmp_path))
    assert dict(ensemble.distributions) == {
        MASS: Drawn(Normal(1.0, 0.05, 0.9, 1.1), relative=True, together="load"),
        "plant.vehicle.height": Drawn(Uniform(2.0, 3.0), together="load"),
        "plant.vehicle.water_density": Drawn(Choice((1000.0, 1025.0))),
        "disturbance.vortex": Drawn(Choice((True, False))),
    }
    assert ensemble.name == "my"
    assert load_ensemble(written(ensemble_to_toml(ensemble), tmp_path)) == ensemble


TRIANGULAR = 'plant.vehicle.mass = { kind = "triangular", low = 0.9, mode = 1.05, high = 1.1'


def test_a_distribution_that_is_not_registered_is_drawn_and_not_saved() -> None:
    ensemble = replace(load_ensemble("sea"), distributions={MASS: Drawn(Triangular(8e3, 1e4, 1.2e4))})
    assert 8e3 < float(ensemble.scenario(0, 0).draws[MASS]) < 1.2e4
    with pytest.raises(ConfigurationError) as caught:
        ensemble_to_toml(ensemble)
    assert str(caught.value) == (
        "plant.vehicle.mass: a distribution of type Triangular cannot be written to a file, it is not registered; "
        "must be one of uniform, log-uniform, normal, choice"
    )


def test_a_distribution_of_a_users_own_stands_in_files(tmp_path: Path) -> None:
    register(Triangular)
    path = written(f'[distributions]\n{TRIANGULAR}, of = "nominal", together = "load" }}\n', tmp_path)
    ensemble = load_ensemble(path)
    assert dict(ensemble.distributions) == {
        MASS: Drawn(Triangular(0.9, 1.05, 1.1), relative=True, together="load"),
    }
    assert load_ensemble(written(ensemble_to_toml(ensemble), tmp_path)) == ensemble
    drawn = [float(scenario.draws[MASS]) for scenario in ensemble.scenarios(400, 1)]
    assert min(drawn) > 9e3
    assert np.mean(drawn) == pytest.approx(1e4 * (0.9 + 1.05 + 1.1) / 3, rel=5e-3)
    nested = "[distributions.plant.vehicle]\nmass = { kind = 'triangular', low = 9e3, mode = 1e4, high = 2e4 }\n"
    assert load_ensemble(written(nested, tmp_path)).distributions[MASS] == Drawn(Triangular(9e3, 1e4, 2e4))


def test_a_scenario_of_a_users_own_distribution_is_kept_with_the_result(tmp_path: Path) -> None:
    short = override(case(4), {"simulation.duration": 0.1})
    ensemble = Ensemble("loads", "", short, {MASS: Drawn(Triangular(0.9, 1.0, 1.1), relative=True)})
    result = run_ensemble(ensemble, 3, 5, traces=False)
    save_ensemble(result, tmp_path / "loads.json")
    kept = json.loads((tmp_path / "loads.json").read_text())
    assert kept["distributions"][MASS]["kind"] == "triangular"
    assert kept["distributions"][MASS]["distribution"] == {"low": 0.9, "mode": 1.0, "high": 1.1}


@pytest.mark.parametrize(
    ("long", "short"),
    [
        ('kind = "uniform", low = 9e3, high = 1e4', "uniform = [9e3, 1e4]"),
        ('kind = "normal", mean = 9e3, sigma = 10, low = 8e3, high = 1e4', "normal = [9e3, 10], within = [8e3, 1e4]"),
        ('kind = "choice", values = [9e3, 1e4]', "choice = [9e3, 1e4]"),
    ],
)
def test_built_in_distributions_have_a_long_form_too(long: str, short: str) -> None:
    ours, theirs = (loads_ensemble(f"[distributions]\n{MASS} = {{ {words} }}\n") for words in (long, short))
    assert ours.distributions == theirs.distributions
    assert ensemble_to_toml(ours) == ensemble_to_toml(theirs)


def test_a_case_gives_what_the_file_does_not_say() -> None:
    on_case_1 = load_ensemble("sea", case(1)).experiment
    assert on_case_1.reference.kind == "uniform"
    assert on_case_1.disturbance.vortex  # the file says so


def test_relative_distributions_follow_the_nominal_value_and_others_refuse_it() -> None:
    heavy = reset(load_ensemble("sea"), {MASS: 2e4})
    assert 1.8e4 < float(heavy.scenario(0, 0).draws[MASS]) < 2.2e4
    assert heavy.scenario(0, 0).nominal.vehicle.mass == 2e4
    with pytest.raises(ConfigurationError, match=r"disturbance\.strouhal: is drawn in the ensemble 'sea'"):
        reset(heavy, {"disturbance.strouhal": 0.3})


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("plant.vehicle.mas = { uniform = [1, 2] }", ":2: unknown key 'plant.vehicle.mas'; did you mean 'plant.v"),
        ('"plant.vehicle.mas" = { uniform = [1, 2] }', ":2: unknown key 'plant.vehicle.mas'"),
        ("plant.vehicle = { uniform = [1, 2] }", ":2: plant.vehicle is a table"),
        ("plant.vehicle.mass = { uniform = [1.1, 0.9] }", ":2: plant.vehicle.mass: uniform = [1.1, 0.9]: the first"),
        ("plant.vehicle.mass = { uniform = [1] }", "must be two finite numbers"),
        ("plant.vehicle.mass = { uniform = [1, inf] }", "must be two finite numbers"),
        ("plant.vehicle.mass = { uniform = 3 }", "must be two finite numbers"),
        (
            'plant.vehicle.mass = { kind = "log-uniform", low = 0, high = 2 }',
            "plant.vehicle.mass: low = 0: must be a finite number > 0",
        ),
        (
            'plant.vehicle.mass = { kind = "log-uniform", low = 3, high = 2 }',
            "plant.vehicle.mass: low = 3: must be < high = 2",
        ),
        (
            "plant.vehicle.mass = { uniform = [-1, 2] }",
            "reaches a value that is not allowed: plant.vehicle.mass = -1.0",
        ),
        ('plant.vehicle.mass = { uniform = [-0.1, 2], of = "nominal" }', "must be a finite number > 0 kg"),
        ("plant.vehicle.mass = { normal = [1, 0.1] }", "within = [0.8, 1.2]"),
        ("plant.vehicle.mass = { normal = [1, 0], within = [0, 2] }", "standard deviation must be > 0"),
        ("plant.vehicle.mass = { normal = [1, 1], within = [2, 3] }", "must contain the mean 1"),
        ("plant.vehicle.mass = { normal = [1, 1], within = [3, 2] }", "within = [3, 2]: the first bound"),
        ("plant.vehicle.mass = { uniform = [1, 2], within = [1, 2] }", "within: goes with normal only"),
        ("plant.vehicle.mass = { choice = [] }", "a list of one value or more"),
        ("plant.vehicle.mass = { choice = [1, -1] }", "plant.vehicle.mass = -1"),
        ('plant.vehicle.mass = { choice = ["a"], of = "nominal" }', "needs a distribution of numbers"),
        ('plant.vehicle.mass = { uniform = [1, 2], of = "truth" }', 'must be "nominal"'),
        ("plant.vehicle.mass = { uniform = [1, 2], together = 3 }", "name of a group"),
        ("plant.vehicle.mass = { unifrom = [1, 2] }", "must be one distribution"),
        ("plant.vehicle.mass = { uniforn = [1, 2] }", "unknown word 'uniforn'; did you mean 'uniform'?"),
        ("plant.vehicle.mass = { uniform = [1, 2], choice = [1] }", "must be one distribution"),
        ("plant.vehicle.mass = { uniform = [1, 2], withn = [1, 2] }", "did you mean 'within'"),
        ("plant.vehicle = 3", "plant.vehicle is a table"),
        ("plant.vehicle.mass = 3", "must be one distribution"),
        ('controller.kind = { choice = ["nftsm"] }', "controller.kind: cannot be drawn, it shapes the compiled code"),
        ("simulation.delay_samples = { choice = [0, 1] }", "cannot be drawn, it shapes the compiled code"),
        ("simulation.duration = { uniform = [1, 2] }", "all scenarios share their sample times"),
        ("simulation.jitter = { uniform = [1e-5, 2e-5] }", "must be > 0, in [distributions] and outside"),
        ("sensors.encoder_counts = { uniform = [1, 2] }", "must be a choice"),
        ('plant.vehicle.mass = { kind = "triangle", low = 1 }', "unknown distribution 'triangle'; did you mean 'tri"),
        ("plant.vehicle.mass = { kind = 3 }", "unknown distribution 3"),
        ('plant.vehicle.mass = { kind = "triangular", low = 1, high = 2 }', "needs 'mode' beside it"),
        (f"{TRIANGULAR}, hihg = 2 }}", "unknown word 'hihg'; did you mean 'high'"),
        ('plant.vehicle.mass = { kind = "triangular", low = 1, mode = "a", high = 2 }', 'mode = "a": must be a finite'),
        ('plant.vehicle.mass = { kind = "triangular", low = 1, mode = 3, high = 2 }', "mode = 3: must be between low"),
        (
            'plant.vehicle.mass = { kind = "triangular", low = -1, mode = 1, high = 2 }',
            "its distribution reaches a value that is not allowed: plant.vehicle.mass = -1.0: must be a finite number",
        ),
        ('plant.vehicle.mass = { kind = "uniform", low = 2, high = 1 }', "low = 2: must be < high = 1"),
        (
            'plant.vehicle.mass = { kind = "normal", mean = 1, sigma = 0, low = 1, high = 2 }',
            "sigma = 0: must be a finite number > 0",
        ),
        (
            'plant.vehicle.mass = { kind = "normal", mean = 0.5, sigma = 1, low = 1, high = 2 }',
            "mean = 0.5: must be 1 to 2 (low to high)",
        ),
        ('plant.vehicle.mass = { kind = "choice", values = [] }', "a list of one value or more"),
        ('plant.vehicle.mass = { kind = "choice", values = 3 }', "a list of one value or more"),
        ('controller.nominal.mass = { uniform = [1, 2], of = "nominal" }', "no nominal value of its own"),
    ],
)
def test_wrong_entries_are_one_line_with_file_and_line(entry: str, message: str, tmp_path: Path) -> None:
    register(Triangular)
    with pytest.raises(ConfigurationError) as caught:
        load_ensemble(written(f"[distributions]\n{entry}\n", tmp_path))
    assert message in str(caught.value)
    assert "my.toml:2: " in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[plant.vehicle]\nmas = 1\n", ":2: unknown key 'plant.vehicle.mas'"),
        (
            "[ensemble]\nnam = 'x'\n",
            ":2: unknown key 'ensemble.nam'; did you mean 'ensemble.name'?",
        ),
        ("[ensemble]\nname = 3\n", ":2: ensemble.name = 3: must be a text"),
        ("distributions = 3\n", "distributions: must be a table"),
        ("# mine\nname = 'mine'\n", "my.toml:2: name: belongs below a line [ensemble]"),
        ("description = 'mine'\n", "my.toml:1: description: belongs below a line [ensemble]"),
        ("[distributions\n", "not valid TOML"),
        ("[plant.vehicle]\nmass = 25,5  # kg\n", "(at line 2, column 10); decimals take a point: 25.5"),
    ],
)
def test_wrong_files_are_one_line(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError) as caught:
        load_ensemble(written(text, tmp_path))
    assert message in str(caught.value)


SHORT = ("--ensemble", "sea", "--set", "simulation.duration=0.3", "--scenarios", "6", "--seed", "7")


def test_simulate_runs_an_ensemble_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "sea.json", tmp_path / "sea.png"
    assert exit_code("simulate", *SHORT, "--controller", "nftsm", "--out", out, "--plot", plot) == 0
    said = capsys.readouterr().out
    assert "nftsm in 'sea', seed 7: 6 completed" in said
    for word in ("mean", "median", "95 %", "worst", "steady_max_abs_error", "chatter"):
        assert word in said
    content = json.loads(out.read_text())
    assert len(content["scenarios"]) == 6
    assert plot.read_bytes().startswith(b"\x89PNG")
    # what is kept with the result makes the same result
    again, copy = tmp_path / "again.json", written(content["configuration"], tmp_path)
    assert exit_code("simulate", "--ensemble", copy, "--scenarios", 6, "--seed", 7, "--out", again) == 0
    assert json.loads(again.read_text())["scenarios"] == content["scenarios"]


def test_config_prints_an_ensemble_that_simulate_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("config", "--ensemble", "sea") == 0
    assert load_ensemble(written(capsys.readouterr().out, tmp_path)) == load_ensemble("sea")


def test_an_interrupt_writes_what_was_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from dualwinch.simulation.ensembles import run

    rollout = run.rollout

    def interrupted(*arguments: Any, **options: Any) -> BatchResult:
        found = rollout(*arguments, **options)
        outcomes = found.outcomes.copy()
        outcomes[:, 3:] = "not_run"
        return replace(found, outcomes=outcomes, interrupted=True)

    monkeypatch.setattr(run, "rollout", interrupted)
    out = tmp_path / "sea.json"
    assert exit_code("simulate", *SHORT, "--out", out) == 130
    said = capsys.readouterr()
    assert "3 of 6 scenarios were finished and are kept" in said.out
    assert said.err.splitlines()[-1].startswith(f"dualwinch: error: interrupted; {out} had been written")
    content = json.loads(out.read_text())
    assert (len(content["scenarios"]), content["scenarios_asked"]) == (3, 6)
