"""The command ``stress``: what breaks gains first, as a table, as JSON, as a figure and in the report of a study.

The module does not bear the command's name: that is the function ``dualwinch.stress``, which does the work.
"""

import json
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from dualwinch.codegen.files import atomic
from dualwinch.commands.doctor import versions
from dualwinch.commands.output import made_folder, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.config.ensemble_file import ensemble_to_toml
from dualwinch.config.experiment_file import experiment_from
from dualwinch.config.toml_text import parse_assignment
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import leaves
from dualwinch.simulation.experiment import Experiment
from dualwinch.tuning.robustness.result import RobustnessResult
from dualwinch.tuning.robustness.stress import stress
from dualwinch.tuning.robustness.summary import to_record

STUDY = "study.json"
"""File of a study, beside its best gains, that notes their constraints."""


def run_stress(
    file: Path | None,
    case: int | None,
    assignments: Sequence[str],
    *,
    ensemble: str,
    base: str,
    constraints: Sequence[str] | None,
    scenarios: int,
    seed: int,
    out: Path | None,
) -> None:
    """Run, print, write. Everything that can be wrong with words and files is found before the runs.

    Raises:
        ConfigurationError: anything wrong with a file, a key, a value or a constraint.
        KeyboardInterrupt: interrupted; nothing is written.
    """
    if (file is None) == (case is None):
        raise ConfigurationError("give one of a file, such as best.toml of `dualwinch tune`, and --case")
    experiment = experiment_from(case, file, None, assignments)
    console = terminal(stderr=True)
    with made_folder(out) if out else nullcontext(), ProgressLine("simulating") as progress:
        found = stress(
            experiment,
            ensemble=ensemble,
            base=base,
            settings=dict(map(parse_assignment, assignments)),
            constraints=constraints,
            noted=noted_constraints(file, experiment) if file else (),
            scenarios=scenarios,
            seed=seed,
            name=file.name if file else f"case {case}",
            progress=progress,
        )
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    if out:
        for name in write_stress(out, found):
            console.print(f"wrote {out / name}", soft_wrap=True, highlight=False)


def noted_constraints(file: Path, experiment: Experiment) -> list[str]:
    """Constraints of the study that lies beside a file, if the file has the gains that were found in it."""
    try:
        study = json.loads((file.parent / STUDY).read_text(encoding="utf-8"))
        settings, texts = study["best"]["settings"], [constraint["text"] for constraint in study["constraints"]]
    except (OSError, ValueError, KeyError, TypeError):
        return []
    values = leaves(experiment)
    return texts if all(values.get(key) == value for key, value in settings.items()) else []


def write_stress(out: Path, found: RobustnessResult) -> list[str]:
    """Write ``stress.json`` and ``stress.svg``; a report of a study that lies there shows them from now on.

    Returns:
        Names of the files that were written.
    """
    from dualwinch.reports.stress import show_stress
    from dualwinch.simulation.plots import save

    with atomic(out / "stress.json") as unfinished:
        unfinished.write_text(json.dumps(as_json(found), indent=1, allow_nan=False) + "\n", encoding="utf-8")
    save(found.plot(), out / "stress.svg")
    shown = ["report.html"] if show_stress(out / "report.html", found) else []
    return ["stress.json", "stress.svg", *shown]


def as_json(found: RobustnessResult) -> dict[str, Any]:
    """Everything the stress test says, JSON-ready, with base and ensemble as TOML."""
    scaling = found.scaling
    return {
        **to_record(found),
        "configuration": ensemble_to_toml(scaling.ensemble),
        "base_configuration": ensemble_to_toml(scaling.base),
        **{f"version_{name}": version for name, version in versions().items()},
    }
