"""What the site takes from the program: everything is there, and formulas are what is computed."""

import re

import numpy as np
import pytest

import dualwinch as dw
from docs.generated.columns import columns_markdown
from docs.generated.commands import commands_markdown
from docs.generated.keys import keys_markdown
from docs.generated.metrics import metrics_markdown
from docs.generated.public import public_markdown
from docs.pictures.__main__ import IMAGES, PICTURES
from dualwinch.cli.app import COMMANDS, app
from dualwinch.model.quantities.description import describe
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.metrics.metrics import metric_quantities
from tests.conftest import PaperRun


def test_every_command_has_its_section_with_examples() -> None:
    text = commands_markdown()
    sections = re.split(r"^## dualwinch ", text, flags=re.MULTILINE)[1:]
    assert [section.split("\n", 1)[0] for section in sections] == list(COMMANDS)
    without = [section.split("\n", 1)[0] for section in sections if "```sh\ndualwinch" not in section]
    assert without == [name for name in COMMANDS if "Examples:" not in (app[name].help_epilogue or "")]


def test_every_option_has_its_help() -> None:
    """It stands in a docstring, under the option's name."""
    options = re.findall(r"^\* `--.*$", commands_markdown(), re.MULTILINE)
    assert len(options) > 200
    assert [option for option in options if not re.match(r"\* `[^`]+`: [\w.]", option)] == []


def test_every_key_stands_in_its_table() -> None:
    text = keys_markdown()
    tables = dict(re.findall(r"^### `\[(\S+)\]`\n(.*?)(?=^##|\Z)", text, re.MULTILINE | re.DOTALL))
    for key in describe(Experiment):
        table, dot, name = key.rpartition(".")
        assert f"| `{name}` |" in (tables[table] if dot else text)


def test_columns_name_the_parts_that_give_them() -> None:
    rows = dict(re.findall(r"^\| `(\w+)` \|.*\| ([^|]*) \|$", columns_markdown(), re.MULTILINE))
    assert rows["L1"] == "`fando-nftsm`"
    assert rows["F1"] == "linear"
    assert rows["tau_1"] == "held"
    own = set(dw.simulate(dw.override(dw.case(4, "adrc"), {"simulation.duration": 0.01})).columns)
    assert own <= set(rows)


def test_every_figure_of_merit_has_a_formula() -> None:
    assert all(quantity.formula for quantity in metric_quantities().values())
    assert metrics_markdown().count("| $") == len(metric_quantities())


@pytest.mark.parametrize("number", [1, 4])
def test_the_formulas_are_what_is_computed(number: int, paper_run: PaperRun) -> None:
    """Those that follow from columns alone; tensions of Case 1 end a rope."""
    result = paper_run(number, "fando-nftsm")
    e, F, tau = result["e"], np.array([result["F1"], result["F2"]]), np.array([result["tau_1"], result["tau_2"]])
    samples, dt = len(e), result.experiment.simulation.sample_time
    expected = {
        "mae": np.abs(e).mean(),
        "mse": (e**2).mean(),
        "saturated_share": (result["u"] != result["u_sat"]).mean(),
        "slack_share": (F.min(axis=0) <= 0).mean(),
        "chatter": np.abs(np.diff(F)).sum() / (2 * (samples - 1)),
        "torque_rate": np.abs(np.diff(tau)).sum() / (2 * (samples - 1) * dt),
        "continuous_load": np.sqrt((tau**2).sum() / (2 * samples)),
        "energy": dt * np.abs(36 * tau * np.array([result["omega_1"], result["omega_2"]])).sum(),
    }
    for name, value in expected.items():
        assert result.metrics[name] == pytest.approx(value, rel=1e-9), name


def test_a_public_name_comes_with_signature_meaning_and_units() -> None:
    text = public_markdown("linearise Rope")
    assert "dualwinch.linearise(experiment, x=None, v=0.0, *, preload=None" in text
    assert "**Args**" in text
    assert "| `damping` | N s/m |" in text


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_are_what_their_command_draws(name: str) -> None:
    assert (IMAGES / name).read_text(encoding="utf-8") == PICTURES[name]()
