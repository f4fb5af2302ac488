"""A default stands once: an option either leaves it to the function that its command calls, or has the same."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import pytest

import dualwinch as dw
from dualwinch.analysis.preload import preloads
from dualwinch.cli import main
from dualwinch.cli.app import COMMANDS, app
from dualwinch.cli.options import default_of, own_default, stated
from dualwinch.export import export_c, generate_c
from dualwinch.simulation.batch.sensitivities import sensitivities
from dualwinch.toolboxes.fmu.export import export_fmu
from dualwinch.toolboxes.identification.options import DEFAULTS
from dualwinch.toolboxes.plc.export import export_st
from dualwinch.toolboxes.server.plant import PORT, ServedPlant, ServerSettings
from dualwinch.tuning.optimisers import METHODS
from dualwinch.tuning.options import TRIALS, TuningOptions

CALLED: dict[str, tuple[Callable[..., Any], ...]] = {
    "compare": (dw.compare,),
    "excite": (dw.excite,),
    "export c": (export_c, generate_c),
    "export fmu": (export_fmu,),
    "export st": (export_st,),
    "identify": (dw.identify,),
    "linearise": (dw.linearise,),
    "preload": (preloads,),
    "race": (dw.race,),
    "sensitivities": (sensitivities,),
    "serve": (ServerSettings, ServedPlant),
    "simulate": (dw.simulate, dw.run_ensemble),
    "stress": (dw.stress,),
    "sweep": (dw.sweep,),
    "tune": (dw.tuning_problem, dw.tune),
}
"""Command → what it calls, whose arguments bear the names of the options."""

OTHER = {"preload error", "race out"}
"""Options that are something else than the argument of that name."""


def commands() -> dict[str, Callable[..., Any]]:
    """Every command with the function that has its options."""
    found = {}
    for name in COMMANDS:
        below = [word for word in app[name] if not word.startswith("-")]
        for words, each in [("", app[name]), *((f" {word}", app[name][word]) for word in below)]:
            if command := each.default_command:
                found[name + words] = command
    return found


def options(holder: Any) -> Iterator[tuple[str, Any]]:
    """Names of a command's options and their defaults, those of its groups, too."""
    if is_dataclass(holder):
        given = [(field.name, field.default) for field in fields(holder)]
    else:
        given = [(name, each.default) for name, each in inspect.signature(holder).parameters.items()]
    for name, default in given:
        yield from options(default) if is_dataclass(default) else [(name.rstrip("_"), default)]


def test_the_commands_are_all_looked_at() -> None:
    """Those that are not have no option with a default that a function has, too."""
    own = {"certify", "config", "doctor", "export casadi", "export mex", "lab", "reproduce", "show"}
    assert set(commands()) == {*CALLED, *own}


@pytest.mark.parametrize("command", CALLED)
def test_an_option_has_the_default_of_its_function(command: str) -> None:
    for name, default in options(commands()[command]):
        for function in CALLED[command]:
            arguments = inspect.signature(function).parameters
            theirs = arguments[name].default if name in arguments else inspect.Parameter.empty
            if not (default is None or theirs is inspect.Parameter.empty or f"{command} {name}" in OTHER):
                assert default == theirs, f"{command} --{name}"


def test_the_defaults_that_are_shown_stand_where_they_are_said_to() -> None:
    assert own_default("race", "rollouts") == 30_000
    assert own_default(lambda: TRIALS) == TRIALS
    shown = default_of(lambda: TuningOptions, "violation", "{:.1%}").show_default
    assert callable(shown)
    assert shown(None) == f"{TuningOptions().violation:.1%}"
    assert stated(a=None, b=0, c=False) == {"b": 0, "c": False}


def helped(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The help of a command, on one line."""
    main([*words.split(), "--help"])
    return " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize("command", CALLED)
def test_the_help_of_every_command_finds_them(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "[default: " in helped(command, capsys)


def test_help_shows_the_defaults_of_functions(capsys: pytest.CaptureFixture[str]) -> None:
    tune = helped("tune", capsys)
    assert f"[default: {TRIALS}, or as many as the gains need, without --time and --rollouts]" in tune
    assert f"[default: {TuningOptions.draws}]" in tune
    assert f"Optimiser: {', '.join(METHODS)}." in tune
    assert f"[default: {PORT}]" in helped("serve", capsys)
    assert f"[default: {DEFAULTS.excitation.max_trials} without --time]" in helped("excite", capsys)
