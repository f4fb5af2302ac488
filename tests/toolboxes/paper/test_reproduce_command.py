import json
from pathlib import Path

import pytest

from dualwinch.cli import main


def test_reproduce_writes_what_it_promises(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--cases", "4", "--controllers", "fando-nftsm,nftsm", "--out", str(tmp_path))
    main(["reproduce", *words])
    said = capsys.readouterr().out
    assert "−74.4 %" in said
    assert "-93.5" in said
    written = {str(file.relative_to(tmp_path)) for file in tmp_path.rglob("*") if file.is_file()}
    figures = {f"figures/figure{number}.{suffix}" for number in (17, 18, 19, 20, 21) for suffix in ("png", "svg")}
    data = {f"data/case4-{kind}.parquet" for kind in ("fando-nftsm", "nftsm")}
    assert written == figures | data | {"metrics.json", "report.html"}
    metrics = json.loads((tmp_path / "metrics.json").read_text())
    assert metrics["reductions"]["mae"] == pytest.approx(-0.744, abs=5e-4)
    assert {run["controller"] for run in metrics["runs"]} == {"fando-nftsm", "nftsm"}


@pytest.mark.slow
def test_reproduce_compares_what_is_beyond_the_paper(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--cases", "4", "--controllers", "nftsm", "--extended", "--out", str(tmp_path))
    main(["reproduce", *words])
    said = capsys.readouterr().out
    assert "Beyond the paper" in said
    assert {
        "super-twisting",
        "adrc",
        "lqi",
        "eid",
        "mpc",
        "master-slave",
        "force-position",
        "proportional-tension",
        "scheduled-preload",
    } <= set(said.split())
    extended = json.loads((tmp_path / "metrics.json").read_text())["extended"]
    found = {(run["controller"], run["coordination"]): run["steady_mae"] for run in extended}
    assert len(found) == len(extended) == 13
    for law in ("adrc", "lqi", "eid", "rbf-sliding-mode", "mpc"):
        assert found[law, "differential-tension"] < found["fando-nftsm", "differential-tension"]
    assert found["fando-nftsm", "master-slave"] == pytest.approx(3.7e-3, rel=0.03)
