"""An error about a name that there is not says which is the nearest, and what there is: the same for every kind."""

from pathlib import Path

import pytest

from dualwinch.cli import main
from dualwinch.model.quantities.quantity import MOST_LISTED, suggestion, unknown

WRONG = {
    "command": (["simulat"], "simulate"),
    "case": (["reproduce", "--cases", "3,44"], "4"),
    "controller of the paper": (["reproduce", "--controllers", "nftms"], "nftsm"),
    "position law": (["simulate", "--controller", "adcr"], "adrc"),
    "estimator": (["simulate", "--estimator", "kalmann"], "kalman"),
    "coordination": (["simulate", "--coordination", "master"], "master-slave"),
    "key": (["simulate", "--set", "plant.vehicle.mas=1"], "plant.vehicle.mass"),
    "swept key": (["sweep", "controller.observer.lo=1,2"], "controller.observer.l0"),
    "number to differentiate by": (["sensitivities", "plant.vehicle.mas"], "plant.vehicle.mass"),
    "column": (["sensitivities", "plant.vehicle.mass", "--column", "F3"], "F2"),
    "metric": (["sweep", "controller.observer.l0=1,2", "--metric", "ms"], "mse"),
    "metric of a statistic": (["tune", "--case", "4", "--objective", "mean.ms"], "mse"),
    "statistic": (["tune", "--case", "4", "--objective", "men.mse"], "mean"),
    "margin": (["tune", "--case", "4", "--constraint", "worst.dealy_margin>=5ms"], "delay_margin"),
    "gain": (["tune", "--case", "4", "--space", "controller.nftsm.bta"], "controller.nftsm.beta"),
    "method": (["tune", "--case", "4", "--method", "cmase"], "cmaes"),
    "ensemble": (["simulate", "--ensemble", "see"], "sea"),
    "ensemble to compare in": (["compare", "paper", "--ensemble", "rigg"], "rig"),
    "name to sweep": (["linearise", "--sweep", "pre=1:2:1"], "preload"),
    "parameter to fit": (["identify", "log.csv", "--fit", "plant.vehicle.mas"], "plant.vehicle.mass"),
    "reading": (["identify", "log.csv", "--fit", "plant.vehicle.mass", "--column", "tau1=left"], "tau_1"),
    "study": (["tune", "--resume", "--storage", "studies.journal", "--study", "see"], "sea"),
    "platform": (["export", "fmu", "--platforms", "linux46", "--out", "a.fmu"], "linux64"),
}


STUDY = '{"op_code": 0, "worker_id": "w", "study_name": "sea", "directions": [1]}'
"""Optuna's line for a study that was begun."""


@pytest.mark.parametrize("kind", WRONG)
def test_the_nearest_and_what_there_is_are_named(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text("t,tau_1,tau_2,x\n0,1,1,0\n0.001,1,1,0\n0.002,1,1,0\n")
    (tmp_path / "studies.journal").write_text(f"{STUDY}\n")
    words, near = WRONG[kind]
    with pytest.raises(SystemExit) as ended:
        main(words)
    error = capsys.readouterr().err.splitlines()[-1]
    assert ended.value.code == 2
    assert f"id you mean '{near}'?" in error.replace('"', "'").replace(f"mean {near}?", f"mean '{near}'?")
    assert any(
        listed in error
        for listed in ("Must be one of ", "must be ", "The nearest of ", "There are ", "Available commands")
    )


def test_long_lists_are_cut_to_the_nearest() -> None:
    many = [f"name_{number}" for number in range(MOST_LISTED + 1)]
    assert unknown("name", "nam_3", many).startswith(
        "unknown name 'nam_3'; did you mean 'name_3'? The nearest of 25 are"
    )
    assert suggestion("nam_3", many[:2]) == "did you mean 'name_1'? Must be one of name_0, name_1"
    assert suggestion("anything", []) == "there is none"


@pytest.mark.parametrize(
    ("name", "known"),
    [
        ("foo", ["controller.observer.kf", "plant.vehicle.mass"]),
        ("controller.observer.l0", ["plant.track.tilt", "plant.vehicle.mass"]),
        ("nope", ["fando-nftsm", "rbf-sliding-mode"]),
        ("5", ["1", "2", "3", "4"]),
        ("name", ["plant.rope_2.diameter"]),
        ("", ["x"]),
    ],
)
def test_a_name_that_is_far_from_all_is_not_guessed(name: str, known: list[str]) -> None:
    assert suggestion(name, known) == f"must be one of {', '.join(known)}"
    many = known + [f"key_{number}" for number in range(100, 200)]
    assert suggestion(name, many, "; see the list").startswith(f"the nearest of {len(many)} are ")
