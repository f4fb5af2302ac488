"""Step an experiment in many lanes at once: the plant is simulated, the caller controls it."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Ensemble,
    Experiment,
    Quantity,
    Result,
    Scenario,
    arguments,
    compiled,
    description,
    errors,
    executors,
    external_commands,
    lanes,
    merits,
    preparation,
    quantities,
    run_outcomes,
    runs,
)


class Observation(Mapping[str, NDArray[np.float64]]):
    """Signals of a sample before its command: ``observation["x_sensed"]`` is (batch,), one number per lane.

    Attributes:
        array: (signals, batch), the signals in their order.
        quantities: name → unit and meaning.
    """

    __slots__ = ("_rows", "array", "quantities")

    def __init__(self, array: NDArray[np.float64], rows: Mapping[str, int], quantities: Mapping[str, Quantity]) -> None:
        """Name the rows of an array; `rows`: name → row."""
        self.array, self._rows, self.quantities = array, rows, quantities

    @property
    def units(self) -> dict[str, str]:
        """Name → unit."""
        return {name: quantity.unit for name, quantity in self.quantities.items()}

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """A signal of all lanes.

        Raises:
            UnknownNameError: it is not observed; the message suggests the nearest name.
        """
        try:
            return self.array[self._rows[name]]
        except (KeyError, TypeError):
            raise errors.UnknownNameError(
                f"signal '{name}' is not observed; {quantities.suggestion(name, self._rows)}"
            ) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._rows)

    def __len__(self) -> int:
        return len(self._rows)

    def __repr__(self) -> str:
        return f"Observation({len(self)} signals of {self.array.shape[1]} lanes: {', '.join(self)})"


Floats: TypeAlias = NDArray[np.float64]

SENSED = (
    "t",
    "x_ref",
    "v_ref",
    "a_ref",
    *(key for key in description.describe(external_commands.Sensed) if key.endswith("_sensed")),
)
"""Inputs of a controller: the reference, and the sensor values as passed on by the estimator."""

WORTH_A_THREAD = {True: 4000, False: 16000}
"""Samples per step, over all lanes, that justify starting a thread; key: `exact`."""


class Stepper:
    """Parallel runs of an experiment, advanced step by step under the caller's commands.

    With the torques of a run as commands, a lane reproduces that run; with `exact`, all columns of the plant equal
    those of ``simulate(experiment, engine="interpreter")`` bit for bit. (The last bits of the compiled `simulate`
    differ, as compilers contract products differently in the C code of a whole closed loop.)

    A lane depends only on its scenario and its commands. If it leaves the track, diverges or reaches the end, it stays
    as it is, with its outcome, while the others continue.

    Attributes:
        experiment: the experiment, with parts that pass on commands in place of its law (and coordination).
        batch: number of lanes.
        seed: seed of an ensemble's draws.
        command: ``torques`` or ``force``.
        hold: number of samples for which a command is held.
        signals: names of the observed signals.
        source: the scenarios that lanes start from.
        under_way: number of running lanes.
    """

    def __init__(
        self,
        experiment: Experiment | Ensemble,
        batch: int = 256,
        seed: int = 0,
        *,
        command: external_commands.CommandName = "torques",
        hold: int = 1,
        signals: Iterable[str] = SENSED,
        exact: bool = False,
        record: bool = True,
        threads: int | None = None,
    ) -> None:
        """Compile the code of the lanes, or load it from the cache, and start them.

        Args:
            experiment: run by every lane, with the signals of its own seed; for an ensemble, lane k runs scenario k.
            batch: number of lanes.
            seed: seed of an ensemble's draws.
            command: ``torques``: torques of both motors in N m; ``force``: net force of the ropes in N, in place of
                the position law's. The experiment's coordination distributes it between the winches.
            hold: number of samples for which a command is held.
            signals: columns of a result to observe; columns of commands show the last command.
            exact: whether each lane gives the bits of `simulate` in the interpreter. Else sixteen lanes share the
                vector registers of a core, with a relative error of elementary functions of up to 1e-9, as in
                `rollout`.
            record: whether to keep the commands, which `result` needs: 16 bytes per lane and step, 8 for forces.
            threads: number of threads; default: one per core, if a step has enough work.

        Raises:
            ConfigurationError: a number out of range, an unknown name, or inconsistent values.
            DualwinchError: no compiler or no usable cache folder.
        """
        if not isinstance(experiment, Experiment | Ensemble):
            raise ConfigurationError(
                f"experiment: must be an Experiment or an Ensemble, not {type(experiment).__name__}"
            )
        numbers = {"batch": (batch, 1), "seed": (seed, 0), "hold": (hold, 1)}
        _check(command, numbers if threads is None else numbers | {"threads": (threads, 1)})
        self.command: external_commands.CommandName = command
        self.batch, self.seed, self.hold = int(batch), int(seed), int(hold)
        self.signals = tuple(signals)
        self.source = lanes.ScenarioSource(experiment, command)
        self.experiment, self._loop = self.source.experiment, self.source.loop
        self._code, self._exact = compiled.compile_stepping(self.source.commanded(self.signals), exact=exact), exact
        self._threads = threads or max(1, min(executors.cores(), self.batch * self.hold // WORTH_A_THREAD[exact]))
        self._rows = {name: row for row, name in enumerate(self.signals)}
        self._quantities = {name: self._loop.quantities[name] for name in self.signals}
        self._shape = (self.batch, 2) if command == "torques" else (self.batch,)
        self._lanes = lanes.Lanes(self._code, self.batch, self.experiment.samples, shared=self.source.ensemble is None)
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
        """Restart lanes.

        Args:
            seed: new seed of an ensemble's draws; default: as before.
            lanes: numbers of the lanes, or a truth value for each; default: all.
            scenarios: numbers of their scenarios, or draws of the ensemble; default: lane k runs scenario k.

        Returns:
            The observation of all lanes.

        Raises:
            ConfigurationError: a seed out of range, a lane that does not exist, not as many scenarios as lanes, or
                inconsistent values of a scenario.
        """
        if seed is not None:
            _check(self.command, {"seed": (seed, 0)})
            self.seed = int(seed)
        indices = self._indices(lanes)
        requests = indices.tolist() if scenarios is None else list(scenarios)
        if len(requests) != len(indices):
            raise ConfigurationError(f"scenarios: has {len(requests)} numbers: must have {len(indices)}, one a lane")
        if len(indices):
            numbers = [request for request in requests if not isinstance(request, Scenario)]
            draws = iter(self.source.drawn(numbers, self.seed))
            scenario_list = [request if isinstance(request, Scenario) else next(draws) for request in requests]
            self._lanes.start(indices, *self.source.started(scenario_list, self.batch))
        self.under_way = int((self._lanes.runs.outcomes == compiled.Outcome.RUNNING).sum())
        self._forget(indices)
        return self.observation

    def step(self, commands: ArrayLike) -> Observation:
        """Advance all running lanes by a step.

        Args:
            commands: torques (batch, 2) in N m, or forces (batch,) in N; those of lanes that have ended are ignored.

        Returns:
            The observation after the step, before the next command. A diverged lane shows its last observation before.

        Raises:
            ConfigurationError: a wrong shape, a number that is not finite, or all lanes have ended.
        """
        try:
            array = np.array(commands, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise ConfigurationError(f"{self.command}: must be numbers, {self._wanted}") from error
        if array.shape != self._shape:
            raise ConfigurationError(f"{self.command}: shape {array.shape} must be {self._wanted}")
        if not self.under_way:
            raise ConfigurationError("step: all lanes have ended; reset() restarts them")
        runs = self._lanes.runs
        runs.commands[:] = array if array.ndim == 2 else array[:, None]
        odd = runs.odd_command()
        if odd:
            index = ", ".join(map(str, odd[: array.ndim]))
            raise ConfigurationError(f"{self.command}[{index}] = {runs.commands[odd]}: must be finite")
        if self._log is not None:
            self._log.append(array)
        self.under_way = self._lanes.step(self.hold, self._threads)
        return self.observation

    @property
    def observation(self) -> Observation:
        """The present observation of all lanes."""
        return Observation(self._lanes.runs.observation.copy(), self._rows, self._quantities)

    @property
    def samples(self) -> NDArray[np.int64]:
        """(batch,) number of samples run by each lane."""
        return self._lanes.runs.done.copy()

    @property
    def times(self) -> Floats:
        """(batch,) time of each lane in s."""
        return self._lanes.runs.done.astype(np.float64) * self.experiment.simulation.sample_time

    @property
    def running(self) -> NDArray[np.bool_]:
        """(batch,) whether each lane is running."""
        return self._lanes.runs.outcomes == compiled.Outcome.RUNNING

    @property
    def outcomes(self) -> NDArray[np.str_]:
        """(batch,) words: ``running``, ``completed``, ``diverged`` or ``left_track``."""
        return run_outcomes.words_of(self._lanes.runs.outcomes)

    @property
    def metrics(self) -> Mapping[str, Floats]:
        """Name → (batch,) figures of merit, as in `Metrics`; NaN for lanes that have not completed their run."""
        runs = self._lanes.runs
        states = runs.states(np.arange(self.batch))
        user_metrics = self.experiment.metrics
        final = {name: states[:, self._loop.states.index(name)] for name in merits.final_states(user_metrics)}
        return vars(merits.metrics_of(final, completed=runs.outcomes == compiled.Outcome.COMPLETED, own=user_metrics))

    @property
    def scenarios(self) -> list[Scenario]:
        """The scenario of each lane; for a plain experiment, one without draws."""
        return [self._lanes.lanes[index].scenario for index in range(self.batch)]

    def fork(self, lanes: ArrayLike | None = None) -> "Stepper":
        """An independent stepper with lanes in their present state, e.g. to look ahead or try alternatives.

        Args:
            lanes: (n,) number of the lane that each new lane continues, in any order and with repetitions; or a
                truth value for each lane; default: all.

        Raises:
            ConfigurationError: a lane that does not exist, or none.
        """
        indices = self._indices(lanes)
        if not len(indices):
            raise ConfigurationError("lanes: must be one or more")
        continued, log = self._lanes.copies(indices), self._log
        if log is not None:
            same = np.array_equal(indices, np.arange(self.batch))
            log = list(log) if same else [record[indices] for record in log]
        other = object.__new__(Stepper)
        vars(other).update(
            vars(self),
            batch=len(indices),
            _shape=(len(indices), *self._shape[1:]),
            _lanes=continued,
            _since=self._since[indices],
            under_way=int((continued.runs.outcomes == compiled.Outcome.RUNNING).sum()),
            _log=log,
        )
        return other

    def __copy__(self) -> "Stepper":
        return self.fork()

    def __deepcopy__(self, memo: dict[int, Any]) -> "Stepper":
        return self.fork()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle arguments and lane states; the code is compiled, or loaded from the cache, again."""
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
            (self._lanes.kept(), self._log, self._since),
        )

    def __setstate__(self, state: tuple[dict[str, Any], list[Floats] | None, NDArray[np.int64]]) -> None:
        snapshot, self._log, self._since = state
        self._lanes.resume(**snapshot)
        self.under_way = int((self._lanes.runs.outcomes == compiled.Outcome.RUNNING).sum())

    def result(self, lane: int, stride: int = 1) -> Result:
        """The run of a lane so far, as a result of `simulate`: its recorded commands are run again to get the rows.

        Args:
            lane: number of the lane.
            stride: keep every `stride`-th sample as a row; 0 keeps none.

        Returns:
            The result; an unfinished lane has the outcome ``running`` and, as any incomplete run, NaN as figures of
            merit.

        Raises:
            ConfigurationError: no such lane, commands were not recorded, or rows do not fit into memory.
        """
        if self._log is None:
            raise ConfigurationError("result: commands were not recorded; make the stepper with record=True")
        index = int(self._indices([lane])[0])
        started, samples = self._lanes.lanes[index], int(self._lanes.runs.done[index])
        preparation.check_memory(samples, 1, len(self._loop.columns))
        replay = lanes.Lanes(
            self._code, 1, started.experiment.samples, shared=True
        )  # the same bits for any number of lanes
        replay.start(np.zeros(1, np.int64), [started], [lanes.first_page(started.experiment, lanes.LONGEST)])
        rows, commands = np.empty((samples, len(self._loop.columns))), self._log[self._since[index] :]
        for start, command in zip(range(0, samples, self.hold), commands, strict=False):
            replay.runs.commands[:] = command[index]
            replay.step(self.hold, row=rows[start:].ctypes.data)
        return runs.result_of(
            self._loop,
            started.experiment,
            started.scenario.nominal if self.source.ensemble else None,
            rows[::stride] if stride else rows[:0],
            replay.runs.states(np.zeros(1, np.int64))[0],
            compiled.Outcome(replay.runs.outcomes[0]),
            samples,
        )

    @property
    def _wanted(self) -> str:
        return f"{self._shape}: {external_commands.NOUNS[self.command]} for each lane"

    def _indices(self, lanes: ArrayLike | None) -> NDArray[np.int64]:
        if lanes is None:
            return np.arange(self.batch)
        numbers = np.asarray(lanes)
        if numbers.dtype == np.bool_ and numbers.shape == (self.batch,):
            return np.flatnonzero(numbers)
        if numbers.ndim != 1 or (numbers.size and numbers.dtype.kind not in "iu"):
            raise ConfigurationError(f"lanes: must be numbers of lanes, or {self.batch} truth values")
        if numbers.size and not (numbers.min() >= 0 and numbers.max() < self.batch):
            odd = next(number for number in numbers.tolist() if not 0 <= number < self.batch)
            raise ConfigurationError(f"lanes: there is no lane {odd}: must be 0 to {self.batch - 1}")
        return numbers.astype(np.int64)

    def _forget(self, indices: NDArray[np.int64]) -> None:
        """Drop recorded commands that no lane needs any more."""
        if self._log is not None:
            self._since[indices] = len(self._log)
            oldest = int(self._since.min())
            del self._log[:oldest]
            self._since -= oldest


def _rebuilt(
    given: Experiment | Ensemble, batch: int, seed: int, options: dict[str, Any], scenarios: list[Scenario]
) -> Stepper:
    """A stepper whose lanes start given scenarios."""
    stepper = Stepper(given, batch, seed, **options)
    stepper.reset(scenarios=scenarios)
    return stepper


def _check(command: str, numbers: dict[str, tuple[int, int]]) -> None:
    if command not in external_commands.COMMANDS:
        raise ConfigurationError(
            f'command = "{command}": must be ' + " or ".join(f'"{name}"' for name in external_commands.COMMANDS)
        )
    for name, (value, minimum) in numbers.items():
        arguments.whole_number(name, value, minimum)
