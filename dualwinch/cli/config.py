"""The command ``config``."""

from __future__ import annotations

import sys

from dualwinch.cli.options import ExperimentOptions, use_parts
from dualwinch.cli.output import note


def config(*, given: ExperimentOptions = ExperimentOptions(), ensemble: str | None = None, start: bool = False) -> None:
    """Print the complete configuration as TOML, each key with unit, meaning, range and source.

    With --config, keys that the file does not give are marked: still the paper's, or a default. They stay marked when
    the output is read again, until the mark is deleted from their line.
    With --plugin, the numbers of its parts follow, including parts that are not in use.

    Args:
        ensemble: Print the file of an ensemble, such as `sea`, instead.
        start: Print a controller that is designed for the machine, alone or with --ensemble, and what limits its
            bandwidth: a start for `tune`. Parts and gains that are named stay as they are.

    Examples:
        dualwinch config > my.toml
        dualwinch config --config mine.toml > whole.toml
        dualwinch config --case 4 --set controller.kind=nftsm
        dualwinch config --plugin my_law.py --set controller.kind=my-law > mine.toml
        dualwinch config --ensemble sea > my-sea.toml
        dualwinch config --config mine.toml --start > start.toml
    """
    from dualwinch.config.ensemble_file import find_ensemble, load_ensemble
    from dualwinch.config.experiment_file import checked_keys, own_keys, own_parts_to_toml, to_toml
    from dualwinch.model.errors import ConfigurationError

    if start:
        sys.stdout.write(_start(given, ensemble))
        return
    if ensemble is None:
        experiment = given.experiment()
        mine = own_keys(given.config) | given.values.keys() if given.config else None
        checked = checked_keys(given.config) if given.config else frozenset()
        sys.stdout.write(to_toml(experiment, mine, checked) + (own_parts_to_toml(experiment) if given.plugin else ""))
        return
    if given.case is not None or given.config or given.assignments:
        raise ConfigurationError("--ensemble: prints a file as it is; give --case, --config or --set to 'simulate'")
    use_parts(given.plugin)
    load_ensemble(ensemble)
    sys.stdout.write(find_ensemble(ensemble).read_text(encoding="utf-8"))


def _start(given: ExperimentOptions, ensemble: str | None) -> str:
    """A start of ``tune`` as TOML, designed for the machine, with the reasons for what nobody has named."""
    from dualwinch.analysis.design import designed
    from dualwinch.analysis.stability import SLIDING_MODE
    from dualwinch.config.experiment_file import checked_keys, own_keys, to_toml
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.tuning.tuning_problem import named_keys, tuning_problem

    before = given.nominal(ensemble)
    problem = tuning_problem(case=given.case, config=given.config, settings=given.assignments, ensemble=ensemble)
    experiment, words = problem.experiment, list(problem.choices)
    if problem.fixed is not None:
        named = {*given.values, *(own_keys(given.config) if given.config else ()), *named_keys(ensemble)}
        machine = experiment if problem.ensemble is None else problem.drawn_ensemble
        design = designed(machine, kept=named)
        experiment, words = design.experiment, [*words, *str(design).splitlines()]
    elif isinstance(experiment.controller.law, SLIDING_MODE):
        note("--start: gains as described; without --ensemble, drums that hardly swing on their ropes need no design")
    else:
        note(f"--start: gains as described; '{experiment.controller.law.kind}' has no design")
    values, usual = leaves(experiment), leaves(before)
    differing = {key for key, value in values.items() if usual.get(key) != value}
    mine = own_keys(given.config) | given.values.keys() | differing if given.config else None
    checked = checked_keys(given.config) if given.config else frozenset()
    return "".join(f"# {line}\n" for line in words) + to_toml(experiment, mine, checked)
