"""The command ``config``."""

import sys
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import AssignmentsInBrief, Case, Plugins, use_parts

app = App(
    name="config",
    help_epilogue="""Examples:

    dualwinch config > my.toml
    dualwinch config --case 4 --set controller.kind=nftsm
    dualwinch config --plugin my_law.py --set controller.kind=my-law > mine.toml
    dualwinch config --ensemble sea > my-sea.toml
""",
)


@app.default
def config(
    *,
    case: Case = None,
    set_: AssignmentsInBrief = None,
    plugin: Plugins = None,
    ensemble: Annotated[str | None, Parameter(help="Print the file of an ensemble, such as `sea`, instead.")] = None,
) -> None:
    """Print the complete configuration as TOML, each key with unit, meaning, range and source.

    With --plugin, the numbers of its parts follow, including those of parts that are not in use.
    """
    use_parts(plugin)
    if ensemble is not None:
        from dualwinch.config.ensemble_file import find_ensemble, load_ensemble
        from dualwinch.model.errors import ConfigurationError

        if case is not None or set_:
            raise ConfigurationError("--ensemble: prints a file as it is; give --case or --set to 'simulate'")
        load_ensemble(ensemble)
        sys.stdout.write(find_ensemble(ensemble).read_text(encoding="utf-8"))
        return
    from dualwinch.config.experiment_file import experiment_from, own_parts_to_toml, to_toml

    asked = experiment_from(case, None, None, set_ or [])
    sys.stdout.write(to_toml(asked) + (own_parts_to_toml(asked) if plugin else ""))
