"""What a study writes: no password, however its URL is written, and no text that changes what a file means."""

import traceback
from dataclasses import replace
from pathlib import Path

import pytest

from dualwinch.cli.tune import StudyOptions, write
from dualwinch.codegen.errors import DualwinchError
from dualwinch.config.ensemble_file import ensemble_to_toml, loads_ensemble
from dualwinch.config.experiment_file import load
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.tuning.result import TuningResult
from dualwinch.tuning.storage.connection import StorageError, check_storage, connected, shown
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import tuning_problem
from tests.tiers import all_but

SECRET = "hush-hush"  # noqa: S105

URLS = [
    f"postgresql://me:{SECRET}@127.0.0.1:9/db",
    f"postgresql+psycopg://me:{SECRET}@127.0.0.1:9/db",
    f"postgresql://me:1/{SECRET}@127.0.0.1:9/db",
    f"postgresql://127.0.0.1:9/db?user=me&password={SECRET}",
    f"postgresql://127.0.0.1:9/db?user=me&p%61ssword={SECRET}",
    "postgresql://127.0.0.1:9/db?password=h%75sh-hush",
    "postgresql://me:h%75sh-hush@127.0.0.1:9/db",
    f"postgresql://127.0.0.1:9/db?sslpassword={SECRET}&sslmode=disable",
    f"postgresql://127.0.0.1:9/db?password={SECRET}&password={SECRET}",
    f"postgresql://127.0.0.1:9/db?options=-c%20{SECRET}",
    f"postgresql:///?dbname=postgresql://me:{SECRET}@127.0.0.1:9/db",
    f"postgresql:///host=127.0.0.1%20port=9%20password={SECRET}",
    f"postgresql:///host=127.0.0.1 port=9 password={SECRET}",
]

NO_URLS = [
    f"postgresql://me:p@{SECRET}@127.0.0.1:9/db",
    f"postgresql://me:{SECRET}@127.0.0.1:port/db",
    f"postgresql://me:{SECRET}@[::1/db",
    f"POSTGRESQL://me:{SECRET}@127.0.0.1/db",
    f"postgresql:me:{SECRET}@127.0.0.1/db",
    f"me:{SECRET}@postgresql://127.0.0.1/db",
    f"host=127.0.0.1 password={SECRET}",
]


@pytest.mark.parametrize("url", URLS + NO_URLS)
def test_what_is_shown_of_a_url_holds_no_secret(url: str) -> None:
    assert "hush" not in shown(url)


@pytest.mark.parametrize("url", URLS)
def test_a_database_that_is_not_there_is_told_without_secrets(url: str) -> None:
    check_storage(url)
    with pytest.raises(StorageError) as caught:
        connected(url)
    assert "hush" not in "".join(traceback.format_exception(caught.value))


@pytest.mark.parametrize("url", NO_URLS)
def test_what_is_no_url_is_not_repeated(url: str) -> None:
    with pytest.raises(DualwinchError) as caught:
        check_storage(url)
    assert "hush" not in "".join(traceback.format_exception(caught.value))


@pytest.fixture(scope="module")
def tuned() -> TuningResult:
    settings = ["simulation.duration=0.1"]
    return tune(tuning_problem(case=4, settings=settings, space=["controller.nftsm.beta"], constraints=[]), trials=4)


@pytest.mark.parametrize("url", all_but(URLS[2::4], URLS))
def test_no_file_of_a_study_holds_a_secret(url: str, tmp_path: Path, tuned: TuningResult) -> None:
    write(tuned, StudyOptions(storage=url, out=tmp_path))
    files = list(tmp_path.iterdir())
    assert len(files) == 3
    for file in files:
        assert "hush" not in file.read_text(encoding="utf-8"), file.name


NAMES = ["x\n[plant.vehicle]\nmass = 5", "x\r\nplant = 3", "\x85 \u2028 \x00 \ud800", "<script>*/"]


@pytest.mark.parametrize("name", all_but(NAMES[::2], NAMES))
def test_a_name_changes_nothing_of_what_a_file_says(name: str, tmp_path: Path, tuned: TuningResult) -> None:
    """As the name of a study, of its ensemble and of its storage."""
    ensemble = Ensemble(name, f"of {name}", tuned.problem.experiment, {})
    named = replace(tuned, training=replace(tuned.training, problem=replace(tuned.problem, ensemble=ensemble)))
    write(named, StudyOptions(storage=f"a{name}.journal", study=name, out=tmp_path))
    assert leaves(load(tmp_path / "best.toml")) == leaves(tuned.best)
    report = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<script>*/" not in report


def test_the_ensemble_of_a_study_keeps_its_name(tuned: TuningResult) -> None:
    name = 'a\nplant = 3 "quoted" \x7f \\'
    ensemble = Ensemble(name, "", tuned.problem.experiment, {})
    assert loads_ensemble(ensemble_to_toml(ensemble)).name == name
