"""Options that several commands share."""

from __future__ import annotations

import re
import shlex
import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter, Token

from dualwinch.cli import notes
from dualwinch.cli.output import FIGURE_SUFFIXES, check_file, note
from dualwinch.cli.progress import ProgressLine
from dualwinch.extensions import EXECUTORS, extension

if TYPE_CHECKING:
    from dualwinch.analysis.design import Design
    from dualwinch.simulation.batch.workers import Workers
    from dualwinch.simulation.ensembles.ensemble import Ensemble
    from dualwinch.simulation.experiment import Experiment
    from dualwinch.tuning.options import TuningOptions

MOST_DIGITS = len(str(2**63 - 1)) - 1
"""Most digits of a whole number on the command line, all of which 64 bits can hold."""


def whole(kind: Any, tokens: Sequence[Token]) -> int:  # noqa: ARG001
    """Convert a whole number; cyclopts would round 1.5."""
    text = tokens[0].value.strip()
    digits = text.removeprefix("-").removeprefix("+")
    if not (digits.isascii() and digits.isdecimal() and len(digits) <= MOST_DIGITS):
        raise ValueError(f"{text!r} must be a whole number of at most {MOST_DIGITS} digits")
    return int(text)


WHOLE = Parameter(converter=whole)
"""Annotation of every option that is a whole number."""

Whole = Annotated[int | None, WHOLE]
"""A whole number that need not be given."""

Priors = Annotated[
    list[str] | None, Parameter(name="--prior", help="Prior, key=mean±sd (or key=mean+-sd); may be repeated.")
]

Assignments = Annotated[
    list[str] | None,
    Parameter(
        name="--set",
        help="key=value, any key of `dualwinch config`, or all that are like plant.rope_*.damping; may be repeated.",
    ),
]

Plugins = Annotated[
    list[str] | None,
    Parameter(name="--plugin", help="Python file, or module, with parts of your own; may be repeated."),
]

NominalMachine = Annotated[
    str | None, Parameter(name="--ensemble", help="The nominal machine of an ensemble, such as `site`, or a TOML file.")
]

Figure = Annotated[
    Path | None,
    Parameter(
        help="File for a figure: .png, .svg or .pdf.", validator=lambda _, file: check_file(file, *FIGURE_SUFFIXES)
    ),
]

Block = Literal["controller", "plant", "closed-loop"]
"""What can be exported."""

Out = Annotated[Path, Parameter(help="Folder for the files; made if missing.")]

Json = Annotated[bool, Parameter(help="Print JSON instead of tables.")]


def own_default(source: str | Callable[[], Any], argument: str = "") -> Any:
    """The default of a function's argument, or a constant.

    Args:
        source: name of a public function, such as ``race``; or a function that imports and returns another one, a
            dataclass or a constant.
        argument: of the function, or field of the dataclass; none for a constant.
    """
    import dualwinch

    value = getattr(dualwinch, source) if isinstance(source, str) else source()
    return signature(value).parameters[argument].default if argument else value


def tuning_options() -> type[TuningOptions]:
    """The class with the defaults of the tuning method, for `own_default` and `default_of`."""
    from dualwinch.tuning.options import TuningOptions

    return TuningOptions


def default_of(source: str | Callable[[], Any], argument: str = "", words: str = "{}") -> Parameter:
    """Show in an option's help the default of the function that gets it; the option itself is None if not given.

    A command passes such an option on only if it is given (`stated`). Modules are imported for the help alone. Source
    and argument are those of `own_default`, the words a format string with one field.
    """
    return Parameter(show_default=lambda _: words.format(own_default(source, argument)))


def stated(**options: Any) -> dict[str, Any]:
    """The options that were given, as keyword arguments; the others keep their function's defaults."""
    return {name: value for name, value in options.items() if value is not None}


def choice(what: str, more: str = "") -> str:
    """Help of an option for the kind of a part: the registered kinds, and `more` text.

    Commands have postponed annotations, so that the list of commands imports no registry.
    """
    from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS

    registry = next(each for each in (POSITION_LAWS, ESTIMATORS, COORDINATIONS) if each.what == what)
    return f"{what.capitalize()}: {', '.join(registry)}, or the kind of a part of your own (see --plugin){more}."


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ExperimentOptions:
    """The experiment of a command: a case, a file or the defaults, and values that replace its own.

    Attributes:
        case: Case 1 to 4 of the paper.
        config: Experiment to read, TOML (see `dualwinch config`).
    """

    case: Whole = None
    config: Path | None = None
    set_: Assignments = None
    plugin: Plugins = None

    @property
    def assignments(self) -> list[str]:
        """Values to set, such as ``plant.vehicle.mass=12000``."""
        return self.set_ or []

    @property
    def values(self) -> dict[str, Any]:
        """Key → value to set.

        Raises:
            ConfigurationError: an assignment without a key or a value.
        """
        from dualwinch.config.experiment_file import assigned

        return assigned(self.assignments)

    def check_apart(self, keys: Collection[str]) -> None:
        """Check that none of the keys that a command varies itself is set as well.

        Raises:
            ConfigurationError: one is.
        """
        from dualwinch.model.errors import ConfigurationError
        from dualwinch.simulation.settings import current

        fixed = {current(key): value for key, value in self.values.items()}
        for key in keys:
            if current(key) in fixed:
                raise ConfigurationError(
                    f"{key}: is swept, and also set, to {fixed[current(key)]}; give one of the two"
                )

    @property
    def typed(self) -> str:
        """The options as typed for another command about the same experiment."""
        parts = {"--case": [self.case] * (self.case is not None), "--config": [self.config] * bool(self.config)}
        parts |= {"--set": self.assignments, "--plugin": self.plugin or []}
        return shlex.join(str(word) for name, values in parts.items() for value in values for word in (name, value))

    def experiment(self, *defaults: str) -> Experiment:
        """The experiment; print notes on values that may be oversights.

        The user's assignments replace the `defaults` of a command.

        Raises:
            ConfigurationError: a plugin, both a case and a file, or anything wrong with a key or value.
        """
        from dualwinch.config.experiment_file import experiment_from

        use_parts(self.plugin)
        values = self.values
        remaining_defaults = [text for text in defaults if text.partition("=")[0] not in values]
        experiment = experiment_from(self.case, self.config, None, [*remaining_defaults, *self.assignments])
        note(*notes.of_file(self.config), *notes.of_experiment(experiment, self.config, values))
        return experiment

    def exported(self, block: str | None = None) -> Experiment:
        """The experiment; for another machine than the paper's, print notes on the stability of the loop."""
        from dualwinch.analysis.remarks import in_full, loop_notes
        from dualwinch.simulation.experiment import Experiment

        experiment = self.experiment()
        if block != "plant" and experiment.plant != Experiment().plant:
            note(*(in_full(words, self.typed) for words in loop_notes(experiment)))
        return experiment

    def nominal(self, ensemble: str | None) -> Experiment:
        """The experiment, or the nominal machine of an ensemble with the values of case, file and options.

        Raises:
            ConfigurationError: as `experiment` and `ensemble`.
        """
        from dualwinch.simulation.settings import override

        if ensemble is None:
            return self.experiment()
        return override(self._unchanged(ensemble).experiment, self.values)

    def ensemble(self, name: str) -> Ensemble:
        """An ensemble; the case or file supplies values missing from its file, and relative distributions follow.

        Raises:
            ConfigurationError: anything wrong with a plugin, the ensemble, a key or a value.
        """
        from dualwinch.config.ensemble_file import reset

        base = self._unchanged(name)
        if not base.distributions:
            words = "it has no [distributions], so no value is drawn, and scenarios differ in their noise at most"
            note(f"the ensemble '{base.name}': {words}")
        return reset(base, self.values)

    def _unchanged(self, ensemble: str) -> Ensemble:
        """An ensemble without the values of ``--set``; print notes on differences from the machine of the file."""
        from dualwinch.config.ensemble_file import load_ensemble
        from dualwinch.config.experiment_file import experiment_from

        use_parts(self.plugin)
        population = load_ensemble(ensemble, experiment_from(self.case, self.config))
        note(*notes.of_file(self.config))
        note(*notes.of_machine(ensemble, population, self.config, self.case, self.values))
        return population


DESIGNED = "designed"
"""Value of ``--controller`` for the controller that is designed for the machine."""

DESIGNED_HELP = f"; {DESIGNED}: all parts and gains, designed for the machine (see `config --start`)"


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ControllerOptions(ExperimentOptions):
    """Experiment options, with further options for the parts of the controller."""

    controller: Annotated[str | None, Parameter(help=choice("position law", DESIGNED_HELP))] = None
    estimator: Annotated[str | None, Parameter(help=choice("estimator"))] = None
    coordination: Annotated[str | None, Parameter(help=choice("coordination"))] = None

    @property
    def assignments(self) -> list[str]:
        """Values to set: the parts of the controller, then those of ``--set``."""
        law = None if self.designs else self.controller
        parts = {"kind": law, "estimator": self.estimator, "coordination.kind": self.coordination}
        return [f"controller.{key}={kind}" for key, kind in parts.items() if kind is not None] + super().assignments

    @property
    def designs(self) -> bool:
        """Whether the controller is designed for the machine."""
        return self.controller == DESIGNED

    @property
    def typed(self) -> str:
        """The options as typed for another command about the same experiment."""
        return " ".join(filter(None, (super().typed, f"--controller {DESIGNED}" if self.designs else "")))

    def experiment(self, *defaults: str) -> Experiment:
        """The experiment, with the designed controller if that is asked for; what limits it is printed as notes."""
        experiment = super().experiment(*defaults)
        return self._design(experiment).experiment if self.designs else experiment

    def nominal(self, ensemble: str | None) -> Experiment:
        """The experiment, or the nominal machine of an ensemble, with the designed controller if that is asked for."""
        if ensemble is None or not self.designs:
            return super().nominal(ensemble)
        return self.ensemble(ensemble).experiment

    def ensemble(self, name: str) -> Ensemble:
        """An ensemble, with the designed controller if that is asked for."""
        from dataclasses import replace

        ensemble = super().ensemble(name)
        return replace(ensemble, experiment=self._design(ensemble).experiment) if self.designs else ensemble

    def _design(self, machine: Experiment | Ensemble) -> Design:
        """The design for a machine, but for the values of ``--set``; print what limits it."""
        from dualwinch.analysis.design import designed

        design = designed(machine, kept=self.values.keys())
        note(*(f"{DESIGNED}: {line}" for line in str(design).splitlines()))
        return design


LONGEST_TIME = 1e7
"""Longest time in s."""


def seconds_from(
    text: str | None, option: str = "--time", least: float = 0.0, most: float = LONGEST_TIME
) -> float | None:
    """Parse a time such as ``60s``, ``5min``, ``2h`` or ``90`` into s; ``None`` if not given.

    Raises:
        ConfigurationError: no time, or not in the range of `least` to `most` in s; 0 itself is refused.
    """
    from dualwinch.model.errors import ConfigurationError

    if text is None:
        return None
    parts = re.fullmatch(r"\s*([+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)\s*(s|min|m|h|)\s*", text)
    if not parts:
        raise ConfigurationError(f"{option} {text}: must be a time such as 60s, 5min or 2h")
    seconds = float(parts[1]) * {"s": 1, "": 1, "m": 60, "min": 60, "h": 3600}[parts[2]]
    if not (least <= seconds <= most and seconds > 0):
        allowed = f">= {least:g} s" if least else "> 0 s"
        raise ConfigurationError(f"{option} {text}: must be {allowed} and <= {most:g} s")
    return seconds


def share_from(text: str | None, option: str, usual: float, *, zero: bool = False) -> float | None:
    """Parse a share such as ``0.5%`` or ``0.005``; ``None`` if not given.

    Raises:
        ConfigurationError: not a number from 0 to less than 1, or 0 where `zero` is not allowed.
    """
    from dualwinch.model.errors import ConfigurationError

    if text is None:
        return None
    parts = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(%?)\s*", text)
    share = float(parts[1]) / (100 if parts[2] else 1) if parts else -1.0
    if not 0 <= share < 1 or (share == 0 and not zero):
        allowed = "0% to less than 100%" if zero else "more than 0% and less than 100%"
        raise ConfigurationError(f"{option} {text}: must be {allowed}, e.g. {100 * usual:g}% or {usual:g}")
    return share


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Options for batches of runs: cluster and reproducibility.

    Attributes:
        cluster: Dask cluster for the runs: tcp://SCHEDULER:8786, or FILE.py:FUNCTION that returns a Dask client
            (default: this machine).
        exact: Bit-identical results from every compiler and processor; takes somewhat longer.
    """

    cluster: Annotated[str | None, Parameter(env_var="DUALWINCH_CLUSTER")] = None
    exact: Annotated[bool, Parameter(env_var="DUALWINCH_EXACT")] = False

    @contextmanager
    def workers(self, line: ProgressLine) -> Iterator[Workers]:
        """The executor of the cluster, announced on a line; None without a cluster: threads of this machine.

        Raises:
            ConfigurationError: `cluster` is neither an address nor a function, or the toolbox is not installed.
            DualwinchError: Dask is not installed, or no scheduler answers.
        """
        from dualwinch.codegen.compiler import EXACT

        before = EXACT.set(self.exact or None)
        try:
            if self.cluster is None:
                yield None
                return
            with extension(EXECUTORS, "cluster", "--cluster")(self.cluster, line.say) as executor:
                yield executor
        finally:
            EXACT.reset(before)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class CheckpointingWorkerOptions(WorkerOptions):
    """Options for batches of runs: cluster, reproducibility, and a folder for finished portions.

    Attributes:
        checkpoint: Folder for finished portions of the work; if this process or the cluster ends early, the same call
            continues with the rest.
    """

    checkpoint: Path | None = None

    @property
    def interrupt(self) -> KeyboardInterrupt:
        """The end of a call that was interrupted; with a checkpoint its message says how to go on."""
        words = f"finished portions are in {self.checkpoint}; the same call goes on with the rest"
        return KeyboardInterrupt(words) if self.checkpoint else KeyboardInterrupt()

    @contextmanager
    def workers(self, line: ProgressLine) -> Iterator[Workers]:
        """As in `WorkerOptions`, with finished portions stored; without a cluster, those of this machine's threads.

        Raises:
            ConfigurationError: as there, or a folder that cannot be written to.
        """
        from dualwinch.config.folders import made_folder
        from dualwinch.simulation.batch.workers import CheckpointingExecutor, cores

        if self.checkpoint is None:
            with super().workers(line) as workers:
                yield workers
            return
        with made_folder(self.checkpoint), ExitStack() as stack:
            workers = stack.enter_context(super().workers(line))
            if not isinstance(workers, Executor):
                workers = ThreadPoolExecutor(cores())
                stack.callback(workers.shutdown, cancel_futures=True)
            yield CheckpointingExecutor(workers, self.checkpoint)


def use_parts(plugins: list[str] | None) -> None:
    """Register parts that are not built in: those of installed packages, and those of given files and modules.

    Raises:
        ConfigurationError: a file or module cannot be imported, or a part cannot be registered.
    """
    from dualwinch.config.plugins import EntryPointWarning, load_entry_points, load_plugin

    with warnings.catch_warnings():
        warnings.simplefilter("always", EntryPointWarning)
        load_entry_points()
    for plugin in plugins or []:
        load_plugin(plugin)
