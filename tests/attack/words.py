"""Words for command lines: from what each command takes, right and wrong ones."""

import tomllib
import types
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Literal, Union, get_args, get_origin

from cyclopts import App
from hypothesis import strategies as st

from dualwinch.cli.app import app
from dualwinch.config.experiment_file import experiment_from, to_toml
from dualwinch.config.toml_text import flattened, read_source
from dualwinch.simulation.ensembles import __file__ as ensembles

LITERALS = [
    *("0", "1", "2", "-1", "3.5", "1e-320", "1e308", "1e999", "-1e999", "nan", "inf", "-inf", "-0.0", "1e-5", "1e30"),
    *(
        "9" * 20,
        "9" * 5000,
        "1" + "0" * 400,
        "0x10",
        "1_000",
        "１２",
        "1e5000",
        "18446744073709551616",
        "-9223372036854775809",
    ),
    *("true", "false", '""', '"\\u0000"', "[]", "[1, 2]", '["a"]', "[nan]", "{}", "{a = 1}", "[" * 60 + "]" * 60),
    *(
        "none",
        "kalman",
        "fando-nftsm",
        "mpc",
        "file",
        "1979-05-27",
        "'a b'",
        '"a\\nb = 3"',
        "=",
        "*",
        "%s",
        "{0}",
        "../x",
    ),
    *(
        "paper",
        "1:2",
        "1:2:1",
        "2:1:1",
        "1:2:0",
        "0:1e308:1e-320",
        "1:2:3:log",
        "0:1:3:log",
        "nan:1:2",
        "1,2",
        "1,",
        ",",
        "1±1",
    ),
]
"""Values as they are written in files and after ``=``."""

TEXTS = st.one_of(
    st.sampled_from(
        ["", " ", "\n", "\t", "-", "--", "-x", "--nonsense", "\x00", "\x1b[31m", "a\u2028b", "😀", "[bold]", "a" * 3000]
    ),
    st.text(st.characters(exclude_characters="/\\", exclude_categories=["Cs"]), max_size=20),
)
"""Words of any kind that name no other folder."""

FILES = [
    "f.toml",
    "good.toml",
    "sea.toml",
    "log.csv",
    "law.py",
    "missing.toml",
    "folder",
    "folder/x.json",
    "",
    ".",
    "no/such.csv",
]
OUTPUTS = [
    "o",
    "o.csv",
    "o.json",
    "o.npz",
    "o.mat",
    "o.parquet",
    "o.svg",
    "o.fmu",
    "o.toml",
    "O.CSV",
    "o.",
    ".json",
    "a" * 300 + ".csv",
]
"""Names of files in the folder of the call."""

STATISTICS = [
    "mean.mse",
    "worst.peak_tension",
    "p95.chatter",
    "median.x",
    "worst.delay_margin",
    "mse",
    "mean",
    "mean.mse.mse",
]
BOUNDS = ["<=1", "<=0.25*paper", ">=5ms", "<=nan", "=1", "<=", "<=1e999", ">=6dB", "<=" + "9" * 400]

WRONG_KEYS = ["controller.winch.*", "plant.*", "controller", "nonsense", "plant.vehicle.mas", "", "a.b.c.d", "."]


def commands(parent: App = app, name: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], App]]:
    """Every command of the application, by its words."""
    if parent.default_command is not None:
        yield name, parent
    for word in parent:
        if not word.startswith("-"):
            yield from commands(parent[word], (*name, word))


@cache
def all_keys() -> list[str]:
    """Keys of experiments and of ensembles, and some that are none."""
    tables = (
        tomllib.loads(to_toml(experiment_from(4, None, None, []))),
        read_source(Path(ensembles).parent / "sea.toml").table(),
    )
    known = {key for table in tables for key, _ in flattened(table)}
    return sorted({*known, *WRONG_KEYS})


def assignments() -> st.SearchStrategy[str]:
    """``key=value`` as after ``--set``, with right and wrong keys and values."""
    key = st.sampled_from(all_keys())
    return st.one_of(st.builds("{}={}".format, key, st.sampled_from(LITERALS)), key, TEXTS)


def values(name: str, hint: Any) -> st.SearchStrategy[str]:
    """What may be given for a parameter: of its type, and of others."""
    kinds = {hint}
    while any(_inner(kind) for kind in kinds):
        kinds = {inner for kind in kinds for inner in (_inner(kind) or (kind,))}
    found: list[st.SearchStrategy[str]] = [TEXTS, st.sampled_from(LITERALS)]
    for kind in kinds:
        if get_origin(kind) is Literal:
            found += [st.sampled_from([str(choice) for choice in get_args(kind)])] * 3
        elif kind is Path:
            found += [st.sampled_from(FILES + OUTPUTS)] * 3
    if name in {"--set", "OVER", "--space", "--prior", "--column", "--sweep"}:
        found += [assignments()] * 3
    if name in {"--objective", "--constraint", "--metric"}:
        found.append(st.builds("{}{}".format, st.sampled_from(STATISTICS), st.sampled_from(["", *BOUNDS])))
    if name in {"--ensemble", "--base", "FILES", "--plugin", "--storage"}:
        found.append(st.sampled_from([*FILES, "sea", "rig", "paper", "none"]))
    if name == "--fit":
        found.append(st.sampled_from(all_keys()))
    if name == "--storage":
        addresses = [
            "postgresql://",
            "postgresql://h:x/d",
            "sqlite:///x",
            "postgresql://u:secret@127.0.0.1:9/d",
            "://",
            "a://b",
        ]
        found.append(st.sampled_from(addresses))
    return st.one_of(found)


def _inner(kind: Any) -> tuple[Any, ...]:
    return get_args(kind) if get_origin(kind) in {Union, types.UnionType, list, tuple} else ()


def options(command: App) -> st.SearchStrategy[list[str]]:
    """One parameter of a command with a value, or a word that is none."""
    found: list[st.SearchStrategy[list[str]]] = [TEXTS.map(lambda word: [word])]
    for argument in command.assemble_argument_collection():
        name = argument.name
        if argument.hint is bool:
            found.append(st.just([name]))
        elif name.startswith("-") and "POSITIONAL" not in argument.field_info.kind.name:
            found.append(values(name, argument.hint).map(lambda value, name=name: [name, value]))
        else:
            found.append(values(name, argument.hint).map(lambda value: [value]))
    return st.one_of(found)
