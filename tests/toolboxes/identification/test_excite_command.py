"""The command ``excite``: a run that tells, as a file that ``simulate`` takes."""

from pathlib import Path
from typing import Any

import pytest

from dualwinch.cli.app import main
from dualwinch.config.experiment_file import load
from dualwinch.toolboxes.identification import experiment_design
from tests.conftest import Refused

SEARCH = ["--case", "4", "--set", "sensors.tension_noise=10", "--duration", "20s", "--trials", "10"]


def test_an_experiment_comes_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, figure, run = tmp_path / "exciting.toml", tmp_path / "exciting.svg", tmp_path / "run.parquet"
    main(["excite", "--fit", "plant.vehicle.mass", *SEARCH, "--out", str(out), "--plot", str(figure)])
    printed = capsys.readouterr().out
    assert "motions of 20 s, D-criterion, seed 0" in printed
    assert "plant.vehicle.mass" in printed
    assert load(out).reference.kind == "way-points"
    assert figure.read_text().startswith("<?xml")
    main(["simulate", "--config", str(out), "--out", str(run)])
    assert run.exists()


def test_an_interrupt_keeps_the_best_motion_so_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    motions, expected_covariance = list[object](), experiment_design.expected_covariance

    def interrupted(*words: Any) -> Any:
        motions.append(words)
        if len(motions) > 20:
            raise KeyboardInterrupt
        return expected_covariance(*words)

    monkeypatch.setattr(experiment_design, "expected_covariance", interrupted)
    with pytest.raises(SystemExit) as ended:
        main(["excite", "--fit", "plant.vehicle.mass", *SEARCH[:-1], "1000", "--out", str(tmp_path / "exciting.toml")])
    assert ended.value.code == 130
    assert "interrupted; this is the best of 1" in capsys.readouterr().err
    assert load(tmp_path / "exciting.toml").reference.kind == "way-points"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--duration", "long"], "--duration long: must be a time such as 60s"),
        (["--duration", "0s"], "--duration 0s: must be >= 5 s and <= 3600 s"),
        (["--duration", "1e9s"], "--duration 1e9s: must be >= 5 s and <= 3600 s"),
        (["--time", "0s"], "--time 0s: must be > 0 s and <= 1e+07 s"),
        (["--seed", "-1"], "seed = -1: must be a whole number from 0 to 4294967295"),
        (["--track", "60"], "track = 60: must be > 0 and <= plant.track.length = 50 m"),
        (["--speed", "0"], "speed = 0: must be > 0"),
        (["--out", "run.csv"], "run.csv: unknown suffix '.csv'; must be .toml"),
        (["--fit", "controller.nftsm.beta"], "no parameter that a log determines"),
    ],
)
def test_wrong_words_are_one_line(words: list[str], message: str, refused: Refused) -> None:
    assert message in refused("excite --fit plant.vehicle.mass", *words)
