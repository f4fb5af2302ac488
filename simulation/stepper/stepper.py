"""An experiment step by step, in many lanes at once: the plant is simulated, control is the caller's."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.stepping import SteppedRuns, Stepping, compile_stepping
from dualwinch.model.arguments import whole_number
from dualwinch.model.errors import ConfigurationError, UnknownNameError
from dualwinch.model.plant import Plant
from dualwinch.model.quantities.description import describe
from dualwinch.model.quantities.quantity import Quantity, suggestion
from dualwinch.simulation.batch.workers import cores
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import ClosedLoop
from dualwinch.simulation.metrics.metrics import final_states, metrics_of
from dualwinch.simulation.prepare import check_memory
from dualwinch.simulation.results.outcomes import WORDS, words_of
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.stepper.commands import COMMANDS, NOUNS, CommandName, Sensed
from dualwinch.simulation.stepper.lanes import LONGEST, Lane, Lanes, Scenarios, first_page


class Observation(Mapping[str, NDArray[np.float64]]):
    """Signals of a sample, ahead of its command: ``observation["x_sensed"]`` is (batch,), one number a lane.

    Attributes:
        array: (signals, batch), the signals in their order.
        quantities: name → unit and meaning.
    """

    __slots__ = ("_rows", "array", "quantities")

    def __init__(self, array: NDArray[np.float64], rows: Mapping[str, int], quantities: Mapping[str, Quantity]) -> None:
        """Name the rows of an array: name → row."""
        self.array, self._rows, self.quantities = array, rows, quantities

    @property
    def units(self) -> dict[str, str]:
        """Name → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """A signal of all lanes.

        Raises:
            UnknownNameError: it is not observed; the message names the nearest.
        """
        try:
            return self.array[self._rows[name]]
        except (KeyError, TypeError):
            raise UnknownNameError(f"signal '{name}' is not observed; {suggestion(name, self._rows)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        return f"Observation({len(self)} signals of {self.array.shape[1]} lanes: {', '.join(self)})"


def replay(
    code: Stepping,
    loop: ClosedLoop,
    lane: Lane,
    samples: int,
    commands: Iterable[NDArray[np.float64]],
    hold: int,
    stride: int,
    nominal: Plant | None,
) -> Result:
    """The first samples of a lane's run.

    Args:
        code: what moves lanes on; the same lane gives the same bits in it, wherever it stands.
        loop: names everything.
        lane: what the run starts from.
        samples: how many.
        commands: of each step.
        hold: samples of a step.
        stride: every how many samples a row is kept.
        nominal: for the result.

    Raises:
        ConfigurationError: the rows do not fit into memory.
    """
    check_memory(samples, 1, len(loop.columns))
    again = Lanes(code, 1, lane.experiment.samples, shared=True)
    again.start(np.zeros(1, np.int64), [lane], [first_page(lane.experiment, LONGEST)])
    rows = np.empty((samples, len(loop.columns)))
    for start, given in zip(range(0, samples, hold), commands, strict=False):
        again.runs.commands[:] = given
        again.step(hold, row=rows[start:].ctypes.data)
    return result_of(loop, again.runs, lane.experiment, rows[::stride] if stride else rows[:0], nominal)


def result_of(
    loop: ClosedLoop, runs: SteppedRuns, experiment: Experiment, rows: NDArray[np.float64], nominal: Plant | None = None
) -> Result:
    """The result of a single run as far as it is, with some of its rows (rows, columns)."""
    outcome = Outcome(runs.outcomes[0])
    final = dict(zip(loop.states, runs.states(np.zeros(1, np.int64))[0].tolist(), strict=True))
    return Result(
        columns={name: column.copy() for name, column in zip(loop.columns, rows.T, strict=True)},
        metrics=metrics_of(final, completed=outcome == Outcome.COMPLETED, own=experiment.metrics),
        outcome=WORDS[outcome],
        end_time=int(runs.done[0]) * experiment.simulation.sample_time,
        final_state=final,
        experiment=experiment,
        quantities=loop.quantities,
        nominal=nominal,
    )


Floats: TypeAlias = NDArray[np.float64]

SENSED = ("t", "x_ref", "v_ref", "a_ref", *(key for key in describe(Sensed) if key.endswith("_sensed")))
"""What a controller gets: the reference, and the sensors' values as the estimator passes them on."""

WORTH_A_THREAD = {True: 4000, False: 16000}
"""Samples of a step, over all lanes, that make a thread worth its start: exact or not."""


class Stepper:
    """Runs of an experiment side by side, moved on step by step under the caller's commands.

    Fed with the torques of a run, a lane gives that run again; an exact one has the very bits that
    ``simulate(experiment, engine="interpreter")`` has in all columns of the plant. (In the C of a whole closed
    loop compilers contract products, in each one otherwise; so the last bits of the compiled `simulate` differ.)

    A lane's numbers depend on nothing but its scenario and its commands. One that leaves the track, diverges or reaches
    the end stays as it is, with its outcome, while the others go on.

    Attributes:
        experiment: what is run, with parts that pass on commands in place of its law (and coordination).
        batch: number of lanes.
        seed: of an ensemble's draws.
        command: ``torques`` or ``force``.
        hold: samples that a command is held.
        signals: names of what is observed.
        source: what lanes start from.
        under_way: number of lanes that are.
    """

    def __init__(
        self,
        experiment: Experiment | Ensemble,
        batch: int = 256,
        seed: int = 0,
        *,
        command: CommandName = "torques",
        hold: int = 1,
        signals: Iterable[str] = SENSED,
        exact: bool = False,
        record: bool = True,
        threads: int | None = None,
    ) -> None:
        """Compile (or find in the cache) what moves the lanes on, and start them.

        Args:
            experiment: every lane runs it, with the signals of its own seed; of an ensemble, lane k runs scenario k.
            batch: number of lanes.
            seed: of an ensemble's draws.
            command: ``torques``: of both motors, in N m; ``force``: what the ropes are to give together, in N, in the
                position law's stead. The experiment's coordination shares it between the winches.
            hold: samples that a command is held.
            signals: columns of a result to observe; those of commands show the last ones.
            exact: each lane gives the bits of `simulate` in the interpreter. Else sixteen lanes share the vector
                registers of a core, and elementary functions err by up to 1e-9 of their value, as in `rollout`.
            record: keep the commands, which `result` needs: 16 bytes a lane and step, of forces 8.
            threads: default: one a core where a step's work is worth it.

        Raises:
            ConfigurationError: a number out of range, an unknown name, or values that do not fit together.
            DualwinchError: no compiler, or no usable cache folder.
        """
        if not isinstance(experiment, Experiment | Ensemble):
            raise ConfigurationError(
                f"experiment: must be an Experiment or an Ensemble, not {type(experiment).__name__}"
            )
        given = {"batch": (batch, 1), "seed": (seed, 0), "hold": (hold, 1)}
        _check(command, given if threads is None else given | {"threads": (threads, 1)})
        self.command: CommandName = command
        self.batch, self.seed, self.hold = int(batch), int(seed), int(hold)
        self.signals = tuple(signals)
        self.source = Scenarios(experiment, command)
        self.experiment, self._loop = self.source.experiment, self.source.loop
        self._code, self._exact = compile_stepping(self.source.commanded(self.signals), exact=exact), exact
        self._threads = threads or max(1, min(cores(), self.batch * self.hold // WORTH_A_THREAD[exact]))
        self._rows = {name: row for row, name in enumerate(self.signals)}
        self._quantities = {name: self._loop.quantities[name] for name in self.signals}
        self._shape = (self.batch, 2) if command == "torques" else (self.batch,)
        self._lanes = Lanes(self._code, self.batch, self.experiment.samples, shared=self.source.ensemble is None)
        self._log: list[Floats] | None = [] if record else None
        self._since = np.zeros(self.batch, np.int64)
        self.reset()

    def reset(
        self,
        seed: int | None = None,
        *,
        lanes: ArrayLike | None = None,
        scenarios: Sequence[int | Scenario] | None = None,
    ) -> Observation:
        """Start lanes anew.

        Args:
            seed: of an ensemble's draws from now on; default: as before.
            lanes: numbers of the lanes, or a truth value for each; default: all.
            scenarios: numbers of what they run, or draws of the ensemble; default: lane k runs scenario k.

        Returns:
            What is observed of all lanes.

        Raises:
            ConfigurationError: a seed out of range, lanes that there are not, not as many scenarios as lanes, or values
                of a scenario that do not fit together.
        """
        if seed is not None:
            _check(self.command, {"seed": (seed, 0)})
            self.seed = int(seed)
        indices = self._indices(lanes)
        wanted = indices.tolist() if scenarios is None else list(scenarios)
        if len(wanted) != len(indices):
            raise ConfigurationError(f"scenarios: has {len(wanted)} numbers: must have {len(indices)}, one a lane")
        if len(indices):
            numbers = [given for given in wanted if not isinstance(given, Scenario)]
            drawn = iter(self.source.drawn(numbers, self.seed))
            chosen = [given if isinstance(given, Scenario) else next(drawn) for given in wanted]
            self._lanes.start(indices, *self.source.started(chosen, self.batch))
        self.under_way = int((self._lanes.runs.outcomes == Outcome.RUNNING).sum())
        self._forget(indices)
        return self.observation

    def step(self, commands: ArrayLike) -> Observation:
        """Move all lanes under way on by a step.

        Args:
            commands: torques (batch, 2) in N m, or forces (batch,) in N; those of lanes that have ended do not count.

        Returns:
            What is observed after it, ahead of the next command. A lane that diverged shows what was last observed
            before that.

        Raises:
            ConfigurationError: a wrong shape, a number that is not finite, or all lanes have ended.
        """
        try:
            given = np.array(commands, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ConfigurationError(f"{self.command}: must be numbers, {self._wanted}") from error
        if given.shape != self._shape:
            raise ConfigurationError(f"{self.command}: shape {given.shape} must be {self._wanted}")
        if not self.under_way:
            raise ConfigurationError("step: all lanes have ended; reset() starts them anew")
        runs = self._lanes.runs
        runs.commands[:] = given if given.ndim == 2 else given[:, None]
        odd = runs.odd_command()
        if odd:
            index = ", ".join(map(str, odd[: given.ndim]))
            raise ConfigurationError(f"{self.command}[{index}] = {runs.commands[odd]}: must be finite")
        if self._log is not None:
            self._log.append(given)
        self.under_way = self._lanes.step(self.hold, self._threads)
        return self.observation

    @property
    def observation(self) -> Observation:
        """What is observed of all lanes as they are."""
        return Observation(self._lanes.runs.observation.copy(), self._rows, self._quantities)

    @property
    def samples(self) -> NDArray[np.int64]:
        """(batch,) samples that each lane has run."""
        return self._lanes.runs.done.copy()

    @property
    def times(self) -> Floats:
        """(batch,) time of each lane in s."""
        return self._lanes.runs.done.astype(np.float64) * self.experiment.simulation.sample_time

    @property
    def running(self) -> NDArray[np.bool_]:
        """(batch,) whether each lane is under way."""
        return self._lanes.runs.outcomes == Outcome.RUNNING

    @property
    def outcomes(self) -> NDArray[np.str_]:
        """(batch,) words: ``running``, ``completed``, ``diverged`` or ``left_track``."""
        return words_of(self._lanes.runs.outcomes)

    @property
    def metrics(self) -> Mapping[str, Floats]:
        """Name → (batch,) figures of merit, as in `Metrics`; NaN where a lane has not completed its run."""
        runs = self._lanes.runs
        states = runs.states(np.arange(self.batch))
        own = self.experiment.metrics
        final = {name: states[:, self._loop.states.index(name)] for name in final_states(own)}
        return vars(metrics_of(final, completed=runs.outcomes == Outcome.COMPLETED, own=own))

    @property
    def scenarios(self) -> list[Scenario]:
        """What each lane runs; of an experiment itself, one without draws."""
        return [self._lanes.lanes[index].scenario for index in range(self.batch)]

    def fork(self, lanes: ArrayLike | None = None) -> "Stepper":
        """Lanes as they are now, in a stepper that goes on by itself: to look ahead, or to try several ways on.

        Args:
            lanes: (n,) number of the lane that each of its lanes continues, in any order and as often as wanted; or a
                truth value for each; default: all.

        Raises:
            ConfigurationError: lanes that there are not, or none.
        """
        indices = self._indices(lanes)
        if not len(indices):
            raise ConfigurationError("lanes: must be one or more")
        continued, log = self._lanes.copies(indices), self._log
        if log is not None:
            same = np.array_equal(indices, np.arange(self.batch))
            log = list(log) if same else [given[indices] for given in log]
        other = object.__new__(Stepper)
        vars(other).update(
            vars(self),
            batch=len(indices),
            _shape=(len(indices), *self._shape[1:]),
            _lanes=continued,
            _since=self._since[indices],
            under_way=int((continued.runs.outcomes == Outcome.RUNNING).sum()),
            _log=log,
        )
        return other

    def __copy__(self) -> "Stepper":
        return self.fork()

    def __deepcopy__(self, memo: dict[int, Any]) -> "Stepper":
        return self.fork()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled by what it is made of and where its lanes are; the code is compiled, or found, again."""
        options = {
            "command": self.command,
            "hold": self.hold,
            "signals": self.signals,
            "exact": self._exact,
            "record": self._log is not None,
            "threads": self._threads,
        }
        return (
            _rebuilt,
            (self.source.given, self.batch, self.seed, options, self.scenarios),
            (
                self._lanes.kept(),
                self._log,
                self._since,
            ),
        )

    def __setstate__(self, state: tuple[dict[str, Any], list[Floats] | None, NDArray[np.int64]]) -> None:
        kept, self._log, self._since = state
        self._lanes.resume(**kept)
        self.under_way = int((self._lanes.runs.outcomes == Outcome.RUNNING).sum())

    def result(self, lane: int, stride: int = 1) -> Result:
        """The run of a lane so far, as `simulate` gives runs: its recorded commands are run again, and rows kept.

        Args:
            lane: which.
            stride: every how many samples a row is kept; 0 keeps none.

        Returns:
            The result; a lane under way has the outcome ``running`` and, as all that were not completed, no figures of
            merit (NaN).

        Raises:
            ConfigurationError: there is no such lane, commands were not recorded, or rows do not fit into memory.
        """
        if self._log is None:
            raise ConfigurationError("result: commands were not recorded; make the stepper with record=True")
        index = int(self._indices([lane])[0])
        commands = (given[index] for given in self._log[self._since[index] :])
        started, samples = self._lanes.lanes[index], int(self._lanes.runs.done[index])
        nominal = started.scenario.nominal if self.source.ensemble else None
        return replay(self._code, self._loop, started, samples, commands, self.hold, stride, nominal)

    @property
    def _wanted(self) -> str:
        return f"{self._shape}: {NOUNS[self.command]} for each lane"

    def _indices(self, lanes: ArrayLike | None) -> NDArray[np.int64]:
        if lanes is None:
            return np.arange(self.batch)
        given = np.asarray(lanes)
        if given.dtype == np.bool_ and given.shape == (self.batch,):
            return np.flatnonzero(given)
        if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
            raise ConfigurationError(f"lanes: must be numbers of lanes, or {self.batch} truth values")
        if given.size and not (given.min() >= 0 and given.max() < self.batch):
            odd = next(number for number in given.tolist() if not 0 <= number < self.batch)
            raise ConfigurationError(f"lanes: there is no lane {odd}: must be 0 to {self.batch - 1}")
        return given.astype(np.int64)

    def _forget(self, indices: NDArray[np.int64]) -> None:
        """Drop recorded commands that no lane's run begins with any more."""
        if self._log is not None:
            self._since[indices] = len(self._log)
            oldest = int(self._since.min())
            del self._log[:oldest]
            self._since -= oldest


def _rebuilt(
    given: Experiment | Ensemble, batch: int, seed: int, options: dict[str, Any], scenarios: list[Scenario]
) -> Stepper:
    """A stepper whose lanes run given scenarios from their beginning."""
    stepper = Stepper(given, batch, seed, **options)
    stepper.reset(scenarios=scenarios)
    return stepper


def _check(command: str, numbers: dict[str, tuple[int, int]]) -> None:
    if command not in COMMANDS:
        raise ConfigurationError(f'command = "{command}": must be ' + " or ".join(f'"{name}"' for name in COMMANDS))
    for name, (value, least) in numbers.items():
        whole_number(name, value, least)
