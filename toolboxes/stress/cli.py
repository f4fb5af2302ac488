"""The command ``stress``: robustness margins of gains, as table, JSON and figure, and in the report of a study.

The computation itself is the function ``dualwinch.stress``.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import nullcontext
from dataclasses import replace
from json import loads
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Annotated, Any

from dualwinch.toolbox import ProgressLine, notes, options, output

if TYPE_CHECKING:
    from dualwinch.toolbox import Ensemble, Experiment
    from dualwinch.toolboxes.stress.result import StressResult


def stress(
    file: Path | None = None,
    *,
    given: options.ExperimentOptions = options.ExperimentOptions(),
    ensemble: Annotated[str | None, options.default_of("stress", "ensemble")] = None,
    base: Annotated[str | None, options.default_of("stress", "base")] = None,
    constraint: list[str] | None = None,
    scenarios: Annotated[options.Whole, options.default_of("stress", "scenarios")] = None,
    seed: Annotated[options.Whole, options.default_of("stress", "seed")] = None,
    out: Path | None = None,
    where: options.CheckpointingWorkerOptions = options.CheckpointingWorkerOptions(),
    json: options.Json = False,
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
        out: Folder for stress.json and stress.svg; a report of `dualwinch tune` there will show them. Until it is
            finished, its portions are kept there, too, unless --checkpoint names another folder.

    Examples:
        dualwinch stress tuned/best.toml
        dualwinch stress tuned/best.toml --out tuned
        dualwinch stress best.toml --ensemble my-rig.toml --base sea --scenarios 50 --seed 1
        dualwinch stress --case 4 --ensemble sea --base none
        dualwinch stress best.toml --constraint "worst.peak_tension<=5500" --constraint "worst.mse<=1*paper"
    """
    from dualwinch.toolbox import ConfigurationError, ensemble_file, folders
    from dualwinch.toolboxes.stress.stress import NO_BASE, stress

    file = file or given.config
    if (file is None) == (given.case is None) or given.config not in {None, file}:
        raise ConfigurationError("give one of a file, such as best.toml of `dualwinch tune`, and --case")
    experiment = replace(given, config=file).experiment()
    base_name = options.own_default("stress", "base") if base is None else base
    if file:
        names = [ensemble_file.NO_ENSEMBLE]
        if base_name != NO_BASE:
            base_ensemble = ensemble_file.load_ensemble(base_name, experiment)
            replacements = replaced(file, base_name, base_ensemble, given.values)
            sizes = notes.sizes_of_ensemble(file, base_name, base_ensemble)
            output.note(replacements, sizes)
            names = [base_ensemble.name]
        imperfect = ensemble_file.load_ensemble(
            options.own_default("stress", "ensemble") if ensemble is None else ensemble, experiment
        )
        output.note(notes.other_ensemble(file, *names, imperfect.name))
    unfinished = out / UNFINISHED if out and not where.checkpoint else None
    where = replace(where, checkpoint=where.checkpoint or unfinished)
    try:
        with (
            folders.made_folder(out) if out else nullcontext(),
            ProgressLine("simulating", command="stress", patient=True) as progress,
            where.workers(progress) as workers,
        ):
            result = stress(
                experiment,
                base=base_name,
                settings=given.values,
                constraints=constraint,
                study_constraints=study_constraints(file, experiment) if file else (),
                name=file.name if file else f"case {given.case}",
                workers=workers,
                progress=progress,
                **options.stated(ensemble=ensemble, scenarios=scenarios, seed=seed),
            )
    except KeyboardInterrupt:
        raise where.interrupt from None
    if json:
        output.print_json(to_record(result))
    else:
        output.terminal(soft_wrap=True).print(repr(result), highlight=False)
    if out:
        for name in write_stress(out, result):
            output.wrote(out / name)
    if unfinished:
        rmtree(unfinished)


UNFINISHED = "unfinished-stress"
"""Folder of the finished portions of a call that is not finished."""


def replaced(file: Path, name: str, base: Ensemble, assigned: Collection[str] = ()) -> str:
    """Name the values of the gains' file that a base sets itself, those first that are no defaults; empty if none."""
    from dualwinch.toolbox import Experiment, experiment_file, leaves, settings, tree
    from dualwinch.toolboxes.stress.imperfections import MACHINE, METHOD

    file_values, base_values, defaults = (
        leaves(each) for each in (experiment_file.load(file), base.experiment, Experiment())
    )
    file_keys = (
        {settings.current(key) for key in experiment_file.given_keys(file)}
        - METHOD
        - set(map(settings.current, assigned))
    )
    keys = [
        key
        for key in base_values.keys() & file_values.keys() & file_keys
        if key.startswith(MACHINE) and base_values[key] != file_values[key]
    ]
    if not keys:
        return ""
    keys.sort(key=lambda key: (file_values[key] == defaults.get(key), key))
    differences = [f"{key} = {tree.shown(base_values[key])} (the file: {tree.shown(file_values[key])})" for key in keys]
    return (
        f"the base '{base.name}' sets values of its own: {notes.listed(differences, 3)}; to judge the gains with "
        f"those of {file}: --base none, or edit a copy of the base (dualwinch config --ensemble {name} > my.toml)"
    )


STUDY = "study.json"
"""File of a study, beside its best gains, with their constraints."""


def study_constraints(file: Path, experiment: Experiment) -> dict[str, float | None]:
    """Constraints of the study beside a file, and their bounds there, if the file has the study's best gains."""
    from dualwinch.toolbox import leaves

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


def write_stress(out: Path, result: StressResult) -> list[str]:
    """Write ``stress.json`` and ``stress.svg``, and add them to a study's report in the folder.

    Returns:
        Names of the files that were written.
    """
    from dualwinch.toolbox import drawing, whole_files
    from dualwinch.toolboxes.stress.report import show_stress

    whole_files.write_whole(out / "stress.json", output.json_text(to_record(result)))
    drawing.save(result.plot(), out / "stress.svg")
    report_files = ["report.html"] if show_stress(out / "report.html", result) else []
    return ["stress.json", "stress.svg", *report_files]


def to_record(result: StressResult) -> dict[str, Any]:
    """The result as plain data, with base and ensemble as TOML."""
    from dualwinch.toolbox import ensemble_file

    scaling = result.scaling
    return {
        **result.to_record(),
        "configuration": ensemble_file.ensemble_to_toml(scaling.ensemble),
        "base_configuration": ensemble_file.ensemble_to_toml(scaling.base),
        **output.version_notes(),
    }
