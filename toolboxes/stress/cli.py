"""The command ``stress``: robustness margins of gains, as table, JSON and figure, and in the report of a study.

The computation itself is the function ``dualwinch.stress``.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import nullcontext
from dataclasses import replace
from json import loads
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from dualwinch.cli.options import (
    CheckpointingWorkerOptions,
    ExperimentOptions,
    Json,
    Whole,
    default_of,
    first,
    note_other_ensemble,
    own_default,
    sizes_of_ensemble,
    stated,
)
from dualwinch.cli.output import json_text, print_json, print_note, terminal, version_notes, wrote
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.simulation.ensembles.ensemble import Ensemble
    from dualwinch.simulation.experiment import Experiment
    from dualwinch.toolboxes.stress.result import RobustnessResult


def stress(
    file: Path | None = None,
    *,
    given: ExperimentOptions = ExperimentOptions(),
    ensemble: Annotated[str | None, default_of("stress", "ensemble")] = None,
    base: Annotated[str | None, default_of("stress", "base")] = None,
    constraint: list[str] | None = None,
    scenarios: Annotated[Whole, default_of("stress", "scenarios")] = None,
    seed: Annotated[Whole, default_of("stress", "seed")] = None,
    out: Path | None = None,
    where: CheckpointingWorkerOptions = CheckpointingWorkerOptions(),
    json: Json = False,
) -> None:
    """Find which imperfection breaks gains first, and at which size, beside the paper's gains.

    Everything that the ensemble draws or sets and the base does not is an imperfection. Each is scaled, alone and
    together with all others, from a thousandth to a hundred times its size in the ensemble, until the worst scenario
    violates a constraint.

    Args:
        file: Gains: best.toml of `dualwinch tune`, or any experiment as TOML.
        ensemble: Ensemble that gives the imperfections: `rig`, or a TOML file.
        base: Ensemble to which they are added: `sea`, a TOML file, or `none` for the experiment as it is.
        constraint: Constraints, e.g. worst.peak_tension<=6000, mean.chatter<=0.25*paper (a multiple of the value of the
            paper's gains in the base); may be repeated; none: only that runs are completed. Default: those of the study
            beside the file, no slack, no peak beyond tension_max, no more than 4 times the paper's MSE.
        scenarios: Scenarios, the same at every size and for all gains.
        seed: Seed of the draws.
        out: Folder for stress.json and stress.svg; a report of `dualwinch tune` there will show them.

    Examples:
        dualwinch stress tuned/best.toml
        dualwinch stress tuned/best.toml --out tuned
        dualwinch stress best.toml --ensemble my-rig.toml --base sea --scenarios 50 --seed 1
        dualwinch stress --case 4 --ensemble sea --base none
        dualwinch stress best.toml --constraint "worst.peak_tension<=5500" --constraint "worst.mse<=1*paper"
    """
    from dualwinch.config.ensemble_file import NO_ENSEMBLE, load_ensemble
    from dualwinch.config.folders import made_folder
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.toolboxes.stress.stress import NO_BASE, stress

    file = file or given.config
    if (file is None) == (given.case is None) or given.config not in {None, file}:
        raise ConfigurationError("give one of a file, such as best.toml of `dualwinch tune`, and --case")
    experiment = replace(given, config=file).experiment()
    around = own_default("stress", "base") if base is None else base
    if file:
        names = [NO_ENSEMBLE]
        if around != NO_BASE:
            beneath = load_ensemble(around, experiment)
            note_replaced(file, around, beneath, given.values)
            names = [beneath.name]
        added = load_ensemble(own_default("stress", "ensemble") if ensemble is None else ensemble, experiment)
        note_other_ensemble(file, *names, added.name)
    with (
        made_folder(out) if out else nullcontext(),
        ProgressLine("simulating", command="stress", patient=True) as progress,
        where.workers(progress) as workers,
    ):
        found = stress(
            experiment,
            base=around,
            settings=given.values,
            constraints=constraint,
            study_constraints=study_constraints(file, experiment) if file else (),
            name=file.name if file else f"case {given.case}",
            workers=workers,
            progress=progress,
            **stated(ensemble=ensemble, scenarios=scenarios, seed=seed),
        )
    if json:
        print_json(to_record(found))
    else:
        terminal(soft_wrap=True).print(repr(found), highlight=False)
    if out:
        for name in write_stress(out, found):
            wrote(out / name)


def note_replaced(file: Path, name: str, base: Ensemble, asked: Collection[str]) -> None:
    """Print notes on values of the gains' file that a base sets itself, and on sizes in it that do not follow.

    Keys that were `asked` for by ``--set`` are left out.
    """
    for words in filter(None, (replaced(file, name, base, asked), sizes_of_ensemble(file, name, base))):
        print_note(words, stderr=True)


def replaced(file: Path, name: str, base: Ensemble, asked: Collection[str] = ()) -> str:
    """Name the values of the gains' file that a base sets itself, those first that are no defaults; empty if none."""
    from dualwinch.config.experiment_file import given_keys, load
    from dualwinch.model.quantities.tree import leaves, shown
    from dualwinch.simulation.experiment import Experiment
    from dualwinch.simulation.settings import current
    from dualwinch.toolboxes.stress.imperfections import MACHINE, METHOD

    there, here, usual = (leaves(each) for each in (load(file), base.experiment, Experiment()))
    given = {current(key) for key in given_keys(file)} - METHOD - set(map(current, asked))
    keys = [key for key in here.keys() & there.keys() & given if key.startswith(MACHINE) and here[key] != there[key]]
    if not keys:
        return ""
    keys.sort(key=lambda key: (there[key] == usual.get(key), key))
    differences = [f"{key} = {shown(here[key])} (the file: {shown(there[key])})" for key in keys]
    return (
        f"the base '{base.name}' sets values of its own: {first(differences, 3)}; to judge the gains with those of "
        f"{file}: --base none, or edit a copy of the base (dualwinch config --ensemble {name} > my.toml)"
    )


STUDY = "study.json"
"""File of a study, beside its best gains, with their constraints."""


def study_constraints(file: Path, experiment: Experiment) -> dict[str, float | None]:
    """Constraints of the study beside a file, and their bounds there, if the file has the study's best gains."""
    from dualwinch.model.quantities.tree import leaves

    try:
        study = loads((file.parent / STUDY).read_text(encoding="utf-8"))
        settings = study["best"]["settings"]
        bounds = {constraint["text"]: _number(constraint.get("bound")) for constraint in study["constraints"]}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    values = leaves(experiment)
    return bounds if all(values.get(key) == value for key, value in settings.items()) else {}


def _number(value: Any) -> float | None:
    return value if isinstance(value, (int, float)) else None


def write_stress(out: Path, found: RobustnessResult) -> list[str]:
    """Write ``stress.json`` and ``stress.svg``, and add them to a study's report in the folder.

    Returns:
        Names of the files that were written.
    """
    from dualwinch.codegen.files import write_whole
    from dualwinch.reports.tuning import show_stress
    from dualwinch.simulation.plots.page import save

    write_whole(out / "stress.json", json_text(to_record(found)))
    save(found.plot(), out / "stress.svg")
    shown = ["report.html"] if show_stress(out / "report.html", found) else []
    return ["stress.json", "stress.svg", *shown]


def to_record(found: RobustnessResult) -> dict[str, Any]:
    """The result as plain data, with base and ensemble as TOML."""
    from dualwinch.config.ensemble_file import ensemble_to_toml

    scaling = found.scaling
    return {
        **found.to_dict(),
        "configuration": ensemble_to_toml(scaling.ensemble),
        "base_configuration": ensemble_to_toml(scaling.base),
        **version_notes(),
    }
