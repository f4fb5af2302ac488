"""What breaks the best of a study first, behind the search."""

from pathlib import Path

from dualwinch.commands.output import terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.commands.stress import SCENARIOS, base_and_ensemble, stress
from dualwinch.commands.stress_run import write_stress
from dualwinch.commands.tuning_progress import StatusLine
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.tuning.problem import TuningProblem
from dualwinch.tuning.result import TuningResult
from dualwinch.tuning.robustness.imperfections import imperfections, union

ENSEMBLE, KIND = "rig", "sea"
"""Gives the imperfections; and what they come on top of where the gains are tuned with them."""


def check_stress(problem: TuningProblem) -> None:
    """Find out now whether there is an imperfection that the gains are not tuned for.

    Raises:
        ConfigurationError: there is none, or gains are drawn.
    """
    base, ensemble = base_and_ensemble(problem.experiment, ENSEMBLE, stress_base(problem))
    try:
        imperfections(base, union(base, ensemble))
    except ConfigurationError as error:
        raise ConfigurationError(f"--stress: {error}") from error


def print_stress(tuned: TuningResult, out: Path, status: StatusLine) -> None:
    """Find out, print, write, and have the report show it."""
    problem = tuned.problem
    with ProgressLine("what breaks first") as progress:
        found = stress(
            tuned.best,
            ensemble=ENSEMBLE,
            base=stress_base(problem),
            noted=[constraint.text for constraint in problem.constraints],
            scenarios=SCENARIOS,
            seed=problem.seed,
            name="best.toml",
            progress=progress,
        )
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    status.say(f"wrote {', '.join(write_stress(out, found))} in {out}")


def stress_base(problem: TuningProblem) -> Ensemble | str | None:
    """What the gains were tuned in, without the imperfections."""
    tuned_in = problem.ensemble
    return KIND if tuned_in and tuned_in.name == ENSEMBLE else tuned_in
