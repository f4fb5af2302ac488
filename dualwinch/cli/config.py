"""The command ``config``."""

from __future__ import annotations

import sys

from dualwinch.cli.options import ExperimentOptions, use_parts


def config(*, given: ExperimentOptions = ExperimentOptions(), ensemble: str | None = None, start: bool = False) -> None:
    """Print the complete configuration as TOML, each key with unit, meaning, range and source.

    With --config, keys that the file does not give are marked: still the paper's, or a default. They stay marked when
    the output is read again, until the mark is deleted from their line.
    With --plugin, the numbers of its parts follow, including parts that are not in use.

    Args:
        ensemble: Print the file of an ensemble, such as `sea`, instead.
        start: Print the parts and gains from which `tune` starts, alone or with --ensemble; those that are named stay
            as they are.

    Examples:
        dualwinch config > my.toml
        dualwinch config --config mine.toml > whole.toml
        dualwinch config --case 4 --set controller.kind=nftsm
        dualwinch config --plugin my_law.py --set controller.kind=my-law > mine.toml
        dualwinch config --ensemble sea > my-sea.toml
        dualwinch config --config mine.toml --start > start.toml
    """
    from dualwinch.config.ensemble_file import find_ensemble, load_ensemble
    from dualwinch.config.experiment_file import own_keys, own_parts_to_toml, to_toml
    from dualwinch.model.errors import ConfigurationError

    if start:
        sys.stdout.write(_start(given, ensemble))
        return
    if ensemble is None:
        experiment = given.experiment()
        mine = own_keys(given.config) | given.values.keys() if given.config else None
        sys.stdout.write(to_toml(experiment, mine) + (own_parts_to_toml(experiment) if given.plugin else ""))
        return
    if given.case is not None or given.config or given.assignments:
        raise ConfigurationError("--ensemble: prints a file as it is; give --case, --config or --set to 'simulate'")
    use_parts(given.plugin)
    load_ensemble(ensemble)
    sys.stdout.write(find_ensemble(ensemble).read_text(encoding="utf-8"))


def _start(given: ExperimentOptions, ensemble: str | None) -> str:
    """The experiment from which ``tune`` starts as TOML, with the reasons for parts and gains that nobody has named."""
    from dualwinch.config.experiment_file import own_keys, to_toml
    from dualwinch.model.quantities.tree import leaves
    from dualwinch.tuning.tuning_problem import tuning_problem

    before = given.nominal(ensemble)
    problem = tuning_problem(case=given.case, config=given.config, settings=given.assignments, ensemble=ensemble)
    values, usual = leaves(problem.experiment), leaves(before)
    differing = {key for key, value in values.items() if usual.get(key) != value}
    mine = own_keys(given.config) | given.values.keys() | differing if given.config else None
    return "".join(f"# {line}\n" for line in problem.choices) + to_toml(problem.experiment, mine)
