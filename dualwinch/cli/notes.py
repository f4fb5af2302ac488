"""Notes on values, files and ensembles that may be oversights: what commands print before their result."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dualwinch.simulation.ensembles.ensemble import Ensemble
    from dualwinch.simulation.experiment import Experiment


def of_file(file: Path | None) -> Iterator[str]:
    """A note if an experiment's file gives no key, so that everything in it is a default."""
    from dualwinch.config.experiment_file import given_keys

    if file is not None and not given_keys(file):
        yield f"{file}: gives no key, so that everything is the default, the paper's machine"


def of_experiment(experiment: Experiment, file: Path | None, assigned: Collection[str]) -> Iterator[str]:
    """Notes on defaults that do not follow the user's keys, and on units, idle values and sensors.

    The user's keys are those of the file and the `assigned` ones. Values marked as right in the file are.
    """
    from dualwinch.analysis.plausibility import unlikely_units
    from dualwinch.analysis.remarks import defaults_left, raised_substeps, without_effect
    from dualwinch.analysis.sensor_remarks import sensor_remarks
    from dualwinch.config.experiment_file import checked_keys, own_keys
    from dualwinch.simulation.experiment import Experiment

    keys = {*assigned, *(own_keys(file) if file else ())}
    checked = checked_keys(file) if file else frozenset[str]()
    if not keys:
        return
    if experiment.plant != Experiment().plant:
        yield from defaults_left(experiment, keys)
        yield from unlikely_units(experiment, keys, checked)
    yield from raised_substeps(experiment)
    yield from without_effect(experiment, keys)
    yield from sensor_remarks(experiment, checked)


def of_machine(
    name: str, ensemble: Ensemble, file: Path | None, case: int | None = None, assigned: Collection[str] = ()
) -> Iterator[str]:
    """Notes on differences between the machine of a file and an ensemble's, or on an ensemble that describes none."""
    if file is not None:
        yield from filter(None, (other_machine(file, name, ensemble), sizes_of_ensemble(file, name, ensemble)))
    elif case is None:
        yield from _papers_machine(name, ensemble, assigned)


def _papers_machine(name: str, ensemble: Ensemble, assigned: Collection[str]) -> Iterator[str]:
    """A note if an ensemble's own file gives no value of a plant, so that its machine is the paper's.

    Distributions alone describe no machine. `assigned` keys count as the file's.
    """
    from dualwinch.config.ensemble_file import built_in_ensembles, find_ensemble
    from dualwinch.config.experiment_file import given_keys

    if name in built_in_ensembles():
        return
    if not any(key.startswith("plant.") for key in (*given_keys(find_ensemble(name)), *assigned)):
        plant = ensemble.experiment.plant
        yield (
            f"{name}: gives no value of the plant, so that the machine is the paper's: {plant.vehicle.mass / 1e3:g} t "
            f"on {plant.track.length:g} m; --config FILE gives another"
        )


def sizes_of_ensemble(file: Path, name: str, ensemble: Ensemble) -> str:
    """Name the absolute sizes that a built-in ensemble sets or draws, and that do not follow the machine of a file.

    They are in m, N and so on, chosen for machines like the paper's; relative values do follow, and keys that the file
    gives are left out. Empty for no such sizes, the paper's machine, and ensembles of the user's own.
    """
    from dualwinch.analysis.remarks import starred, swapped
    from dualwinch.config.ensemble_file import built_in_ensembles, load_ensemble
    from dualwinch.config.experiment_file import given_keys, load
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.simulation.experiment import Experiment
    from dualwinch.simulation.settings import leaf_of

    if name not in built_in_ensembles() or load(file).plant == Experiment().plant:
        return ""
    nominal, defaults = leaves(load_ensemble(name).experiment), leaves(Experiment())
    sizes = {
        key: f" = {value:g}"
        for key, value in nominal.items()
        if isinstance(value, float) and value != defaults.get(key)
    }
    sizes |= {key: "" for key, distribution in ensemble.distributions.items() if not distribution.relative}
    keys = {key for key in sizes if key.startswith("plant.")} - given_keys(file)
    keys = {key for key in keys if leaf_of(key, ensemble.experiment).quantity.unit not in {"", "1", "rad"}}
    if not keys:
        return ""
    merged = [f"{starred(key) if swapped(key) in keys else key}{sizes[key]}" for key in sizes if key in keys]
    return (
        f"the ensemble '{ensemble.name}' has sizes that do not follow from {file}: "
        f"{listed(list(dict.fromkeys(merged)), 5)}; for your own, {_copy_of(name)}"
    )


def other_machine(file: Path, name: str, ensemble: Ensemble) -> str:
    """Name the differences between the machine of a file and an ensemble's nominal one, with a remedy.

    Default values in the file that the ensemble's own file replaces are left out. Empty if there is no difference.
    """
    from dualwinch.config.ensemble_file import load_ensemble
    from dualwinch.config.experiment_file import given_keys, load
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.simulation.experiment import Experiment

    machine = load(file)
    values, here, defaults = (leaves(each) for each in (machine, ensemble.experiment, Experiment()))
    around = leaves(load_ensemble(name, machine).experiment)
    keys = sorted(key for key in given_keys(file) if key.startswith("plant.") and values.get(key) != here.get(key))
    absent = [key for key in keys if around.get(key) == values.get(key)]
    replaced = [key for key in keys if key not in absent and values.get(key) != defaults.get(key)]
    if not (absent or replaced):
        return ""
    differences = [f"{key} = {values.get(key)} there, {here.get(key)} here" for key in absent + replaced]
    about = f"{file}: for another machine ({listed(differences, 2)})"
    if absent:
        return f"{about}; to judge it on its own: --config {file}"
    return f"{about}: the ensemble '{ensemble.name}' sets these itself; for yours, {_copy_of(name)}"


def _copy_of(name: str) -> str:
    return f"edit a copy of it (dualwinch config --ensemble {name} > my.toml)"


def other_ensemble(file: Path, *names: str) -> str:
    """Say that the gains of a file were tuned in another ensemble than those in which they are judged, with a remedy.

    The head of a file names the ensemble in which `dualwinch tune` or `race` found its gains. Empty if that is one of
    `names`, where `NO_ENSEMBLE` stands for the experiment itself, or if it names none.
    """
    from dualwinch.config.ensemble_file import NO_ENSEMBLE, TUNED_IN, built_in_ensembles
    from dualwinch.config.toml_text import head_comment, read_source

    tuned_in = head_comment(read_source(file).text, TUNED_IN)
    if tuned_in in {"", *names}:
        return ""
    criterion = f"judged in {' with '.join(repr(name) for name in names if name != NO_ENSEMBLE)}"
    if tuned_in == NO_ENSEMBLE:
        return f"{file}: tuned in one run, {criterion}"
    source = tuned_in if tuned_in in built_in_ensembles() else f"with the file of '{tuned_in}'"
    return f"{file}: tuned in '{tuned_in}', {criterion}; to judge it where it was tuned: --ensemble {source}"


def listed(words: list[str], most: int) -> str:
    """The first words of a list, at most `most`, and the number of the others."""
    return ", ".join(words[:most]) + (f", and {len(words) - most} more" if len(words) > most else "")
