import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

import dualwinch
from dualwinch.cli import main
from tests.plant_points import linearise


def test_one_point_is_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, plot = tmp_path / "plant.json", tmp_path / "bode.png"
    main(["linearise", "--x", "10", "--v", "1.8", "--out", str(out), "--plot", str(plot)])
    said = capsys.readouterr().out
    for words in (
        "rope 1 – drum 1",
        "3606  N",
        "all limits are respected",
        "participation",
        "every mode can be seen: x\n",
    ):
        assert words in said
    written, system = json.loads(out.read_text()), linearise(x=10.0, v=1.8)
    np.testing.assert_array_equal(written["A"], system.A)
    assert (written["dt"], written["operating_point"]) == (None, dict(system.operating_point))
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_the_nominal_machine_of_an_ensemble_has_modes_of_ropes_gears_and_sag(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "site.json"
    main(["linearise", "--ensemble", "site", "--x", "10", "--v", "1", "--out", str(out)])
    said = " ".join(capsys.readouterr().out.split())
    assert "linear while the ropes stay taut and the teeth, which transmit 1480 N m in gearbox 1" in said
    figures = json.loads(out.read_text())["figures"]["modes"]
    assert {"rope 1 – drum 1", "gearbox 1", "sag of rope 1"} <= {row["mode"] for row in figures["rows"]}
    assert figures["units"]["natural_frequency"] == "Hz"
    main(["linearise", "--case", "4", "--set", "plant.rope_1.mass_per_length=2.36", "--loop", "closed", "--x", "5"])
    said = capsys.readouterr().out
    assert "rope 1, longitudinal" in said
    assert "drums' resonance on their ropes" in said


def test_a_broken_loop_is_an_open_one(capsys: pytest.CaptureFixture[str]) -> None:
    main(["linearise", "--loop", "broken", "--opening", "tau_1"])
    broken = capsys.readouterr().out
    main(["linearise", "--loop", "open", "--opening", "tau_1"])
    assert capsys.readouterr().out == broken
    assert "margins of the loop opened at tau_1" in broken


def test_a_sweep_is_printed_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("track.json", "track.npz", "track.mat"):
        main(["linearise", "--v", "2.5", "--sweep", "x=1:47:2", "--out", str(tmp_path / name)])
    said = capsys.readouterr().out
    assert "limits passed at 24 of 24 points; at x = 1: cruise at 2.5 m/s needs 6 315 N" in " ".join(said.split())
    assert "466 (0.0607)" in said
    x = [1.0 + 2 * k for k in range(24)]
    text = json.loads((tmp_path / "track.json").read_text())
    matlab = loadmat(tmp_path / "track.mat", simplify_cells=True)
    archive = np.load(tmp_path / "track.npz")
    assert text["operating_point"]["x"] == x == list(matlab["operating_point"]["x"])
    np.testing.assert_array_equal(text["A"], archive["A"])
    np.testing.assert_array_equal(np.moveaxis(matlab["A"], -1, 0), archive["A"])
    np.testing.assert_array_equal(archive["A"][3], linearise(x=7.0, v=2.5).A)


def test_values_of_the_experiment_are_used(tmp_path: Path) -> None:
    out = tmp_path / "plant.json"
    limits = ["--set", "controller.coordination.tension_min=300", "--set", "plant.vehicle.mass=2e4"]
    main(["linearise", "--v", "1.8", "--dt", "0.01", "--preload", "1500", "--out", str(out), *limits])
    written = json.loads(out.read_text())
    assert (written["dt"], written["operating_point"]["F2"], written["operating_point"]["preload"]) == (0.01, 300, 1500)
    assert written["B"][1][2] == pytest.approx(0.01 / 2e4, rel=0.01)


@pytest.mark.parametrize("figure", ["bode", "modes", "poles"])
def test_figures_of_a_sweep(figure: str, tmp_path: Path) -> None:
    plot = tmp_path / "figure.svg"
    main(["linearise", "--sweep", "v=-1:2:1", "--plot", str(plot), "--figure", figure])
    assert plot.read_text().startswith("<?xml")


def test_from_python() -> None:
    point = dualwinch.operating_point(dualwinch.case(2), 10, 1.8)
    fastest = dualwinch.modes(dualwinch.linearise(dualwinch.case(2), 10, 1.8))[-1]
    assert pytest.approx(200.0) == point.F2
    assert fastest.label == "rope 2 – drum 2"


@pytest.mark.external
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="needs GNU Octave")
def test_octave_reads_the_file_and_finds_the_same_poles(tmp_path: Path) -> None:
    system = linearise(x=10.0, v=1.8, dt=1e-3)
    system.save(tmp_path / "plant.mat")
    program = (
        "pkg load control; load plant.mat; sys = ss(A, B, C, D, dt, 'stname', states, 'inname', inputs, "
        "'outname', outputs); printf('%.17g %.17g\\n', [real(pole(sys)) imag(pole(sys))]'); "
        "printf('%s %s\\n', get(sys, 'outname'){3}, units.F1);"
    )
    words = ["octave-cli", "--norc", "--eval", program]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    if "control" in done.stderr and done.returncode:
        pytest.skip("needs Octave's control package")
    *poles, names = done.stdout.splitlines()
    found = np.array([complex(*map(float, line.split())) for line in poles])
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(system.poles()), rtol=1e-9)
    assert names == "F1 N"
