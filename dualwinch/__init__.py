"""Control of rope-towed machines: one symbolic model, compiled closed loops, tuned gains.

Run and look:
    case(4), load("my.toml")         an experiment: of the paper, or of a file
    override(experiment, {...})      the same with other values; any key of `dualwinch config`
    simulate(experiment)             a run: columns, figures of merit, outcome
    save(result, "run.parquet")      and load_result

Many runs:
    rollout, sensitivities           gains side by side in compiled code; exact derivatives by any parameter
    sweep                            any keys over values
    run_ensemble, compare            uncertain machines; controllers in the same scenarios
    Stepper                          a policy of your own, sample by sample

Design:
    designed                         a controller for a machine: formulas, verified by margins
    tune, stress, race               better gains, robustness margins, law against law
    linearise, modes, certify        linear models, margins, the paper's theorem
    identify                         a machine's parameters from its logs
    plant, controller_function       CasADi functions; export_c, export_st, generate_c, export_fmu: code

Parts of your own derive from PositionLaw, Estimator, Coordination, RopeLaw, Actuator, Metric or Distribution.

`dir(dualwinch)` lists all names, `help(dualwinch.simulate)` explains one, `dualwinch --help` lists the commands.
Each name is imported when first used: `import dualwinch` costs nothing.
"""

from pathlib import Path as _Path

import lazy_loader

__version__ = "0.1.0"

if not _Path(__path__[0], "model").is_dir():  # a checkout on a system without symbolic links
    __path__.append(str(_Path(__path__[0]).parent))

# without __all__, for which help() would print the documentation of every public class
_attribute, __dir__, _ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A public name, imported when first used.

    Raises:
        AttributeError: no such name.
        ImportError: it is of a toolbox that is not installed.
    """
    try:
        return _attribute(name)
    except ModuleNotFoundError as error:
        from dualwinch.extensions import TOOLBOXES, absent

        if not (error.name or "").startswith(TOOLBOXES):
            raise
        raise ImportError(f"dualwinch.{name}: {absent(error.name or '')}", name=error.name) from None
