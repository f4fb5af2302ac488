"""``dualwinch compare``: files of gains in the same scenarios, with paired statistics."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from dualwinch.cli.notes import of_machine, other_ensemble
from dualwinch.cli.options import (
    WHOLE,
    CheckpointingWorkerOptions,
    ExperimentOptions,
    Figure,
    use_parts,
)
from dualwinch.cli.output import check_file, note, print_figures, version_notes, write_figure, write_json
from dualwinch.cli.progress import ProgressLine
from dualwinch.model.quantities.figures import Figures, Sentence, to_record

if TYPE_CHECKING:
    from dualwinch.controllers.controller import Controller
    from dualwinch.simulation.ensembles.comparison import Comparison


def compare(
    *files: str,
    ensemble: str = "sea",
    scenarios: Annotated[int, WHOLE] = 200,
    seed: Annotated[int, WHOLE] = 0,
    given: ExperimentOptions = ExperimentOptions(),
    out: Path | None = None,
    plot: Figure = None,
    where: CheckpointingWorkerOptions = CheckpointingWorkerOptions(),
) -> None:
    """Compare files of gains in the same scenarios, with confidence intervals on the ratios to the first.

    A file is an experiment as `dualwinch config` prints one, or a part of it. Its [controller] tables are compared:
    position law, gains, estimator, coordination and preload; missing keys keep their defaults. Plant, sea and sensors
    come from the ensemble alone; --case or --config supply the values missing from its file. The paper's gains run with
    the nominal model and the damping of drums of the first file, and with its tension limits and preload if the limits
    are not the paper's.

    Args:
        files: TOML files of gains; `paper` means the paper's gains.
        ensemble: Ensemble of scenarios: `sea`, `rig`, `site`, or a TOML file.
        scenarios: Scenarios, the same for every file.
        seed: Seed of the draws and of the intervals.
        out: File for the statistics: .json.

    Examples:
        dualwinch compare paper best.toml
        dualwinch compare paper mine.toml --plugin my_law.py
        dualwinch compare paper best.toml calm.toml --scenarios 500 --seed 1 --out gains.json --plot gains.png
    """
    from dualwinch.config.ensemble_file import ensemble_to_toml
    from dualwinch.model.errors import ConfigurationError
    from dualwinch.simulation.ensembles.comparison import compare as run

    for key in given.values:
        if key.startswith("controller."):
            raise ConfigurationError(f"{key}: the controller comes from the files of gains; set it there")
    use_parts(given.plugin)
    contenders, population = controllers(files), given.ensemble(ensemble)
    for name in files:
        if name != PAPER:
            note(other_ensemble(Path(name), population.name))
            if Path(name) != given.config:
                note(*of_machine(ensemble, population, Path(name)))
    check_file(out, ".json")
    with ProgressLine("simulating", command="compare", patient=True) as progress, where.workers(progress) as workers:
        result = run(contenders, population, scenarios, seed, workers=workers, progress=progress)
        progress(0.0, "finding infeasible scenarios")
        result.find_least_errors(progress)
        facts = result.to_record() | {"configuration": ensemble_to_toml(result.ensemble), **version_notes()}
    print_figures(printed := figures(result))
    write_json(out, facts | {"notes": to_record(printed)["notes"]})
    write_figure(plot, "comparison", result)
    if result.partial:
        raise where.interrupt


PAPER = "paper"
"""Name that stands for the paper's gains instead of a file."""


def controllers(names: Sequence[str]) -> dict[str, Controller]:
    """The controllers of files of gains, by the names given on the command line.

    The paper's gains are adapted to the machine of the first file (`paper_controller`).

    Raises:
        ConfigurationError: no file, the same file twice, or anything wrong with a file.
    """
    from dualwinch.config.experiment_file import load
    from dualwinch.controllers.paper_controller import paper_controller
    from dualwinch.model.errors import ConfigurationError

    if not names:
        raise ConfigurationError(f"give at least one file of gains, or '{PAPER}' for the paper's")
    twice = next((name for index, name in enumerate(names) if name in names[:index]), None)
    if twice is not None:
        raise ConfigurationError(f"{twice}: given twice")
    controllers_by_name = {name: load(Path(name)).controller for name in names if name != PAPER}
    paper = paper_controller(next(iter(controllers_by_name.values()), None))
    return {name: paper if name == PAPER else controllers_by_name[name] for name in names}


def short_names(names: Sequence[str]) -> dict[str, str]:
    """Full name → name in tables: the file's without folders, or the folder's if all files have the same name.

    All names stay whole if two would become equal.
    """
    paths = [Path(name) for name in names if name != PAPER]
    same_name = len({path.name for path in paths}) == 1 < len(paths)
    labels = {
        name: name if name == PAPER else str(Path(name).parent) if same_name else Path(name).name for name in names
    }
    return labels if len(set(labels.values())) == len(labels) else {name: name for name in names}


def figures(result: Comparison) -> Figures:
    """What the command prints: the comparison's figures with short names, and whose the paper's other numbers are."""
    from dualwinch.controllers.paper_controller import adapted

    labels = short_names(list(result.contenders))
    if PAPER in labels and (numbers := adapted(result.contenders[PAPER].controller)):
        first_file = next(words for name, words in labels.items() if name != PAPER)
        return [Sentence(f"{PAPER}: the paper's gains, with the {numbers} of {first_file}"), *result.figures(labels)]
    return result.figures(labels)
