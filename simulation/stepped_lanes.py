"""Lanes: parallel runs of a closed loop, each with its scenario and its current page of signals."""

import threading
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.outcome import Outcome
from dualwinch.codegen.drivers.stepping import Commanded, SteppedRuns, Stepping
from dualwinch.codegen.source.expressions import GRAPHS
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import unknown
from dualwinch.simulation.batch.scenarios import check_group, scenario_groups
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.exogenous.signals import exogenous_pieces, exogenous_sources
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.external_commands import COMMANDED_STATES, CommandName, under_command
from dualwinch.simulation.loop.closed_loop import (
    ClosedLoop,
    absent_signals,
    closed_loop,
    exogenous_names,
    named_function,
    starts,
)
from dualwinch.simulation.loop.structure import LoopStructure, solver_of, structure_of, zeros_of
from dualwinch.simulation.prepare import check_substeps, prepare
from dualwinch.simulation.scenario import Scenario

Floats = NDArray[np.float64]

PAGE_ROOM = 2**27
"""Bytes for all pages that are read in parallel."""

SHORTEST, LONGEST = 256, 2**16
"""Minimum and maximum number of samples of a page."""


class SignalPage:
    """Signals of some samples of a run, and of the first sample of the following page.

    Readers of one run share its pages, wherever they are in it: a page refers to its follower once that is read, so
    that a page is freed when all readers have passed it.

    Attributes:
        table: (samples + 1, exogenous), columns in the closed loop's order.
        start: number of the first sample.
    """

    def __init__(self, table: Floats, start: int, source: Iterator[Floats], lock: threading.Lock) -> None:
        self.table, self.start = table, start
        self._source, self._lock = source, lock
        self._following: SignalPage | None = None

    @property
    def end(self) -> int:
        """Number of the first sample of the following page."""
        return self.start + len(self.table) - 1

    def address(self, sample: int) -> int:
        """Memory address of the signals of a sample."""
        return self.table.__array_interface__["data"][0] + (sample - self.start) * self.table.strides[0]

    def following(self) -> "SignalPage":
        """The next page."""
        with self._lock:
            if self._following is None:
                table = np.concatenate([self.table[-1:], next(self._source)])
                self._following = SignalPage(table, self.end, self._source, self._lock)
            return self._following


def page_length(experiment: Experiment, runs: int) -> int:
    """Samples per page if `runs` runs like `experiment` have their own pages."""
    signals = len(exogenous_names(experiment.controller))
    return min(max(PAGE_ROOM // (8 * signals * runs), SHORTEST), LONGEST)


def first_page(experiment: Experiment, length: int) -> SignalPage:
    """The first page of a run, `length` samples long.

    All pages together contain one sample more than the run, for the observation after its last sample.
    """
    return _first_of(exogenous_pieces(experiment, length, experiment.samples + 1))


def _first_of(source: Iterator[Floats]) -> SignalPage:
    return SignalPage(next(source), 0, source, threading.Lock())


@dataclass(frozen=True, eq=False)
class Lane:
    """Start of a lane: its scenario and kind of commands, the parameters for compiled code, and the initial state."""

    scenario: Scenario
    command: CommandName
    parameters: Floats
    state: Floats

    @cached_property
    def experiment(self) -> Experiment:
        """The scenario's experiment under command."""
        return under_command(self.scenario.experiment, self.command)


class ScenarioSource:
    """An experiment or an ensemble under command.

    Attributes:
        given: the original experiment or ensemble.
        experiment: the nominal values, under command.
        ensemble: the original ensemble; None: nothing is drawn.
        loop: the closed loop of all scenarios.
    """

    def __init__(self, given: Experiment | Ensemble, command: CommandName) -> None:
        """Build the closed loop.

        Raises:
            ConfigurationError: the nominal values are inconsistent.
        """
        self.given = given
        self.ensemble = given if isinstance(given, Ensemble) else None
        self._base = given.experiment if isinstance(given, Ensemble) else given
        self._command: CommandName = command
        self.experiment = under_command(self._base, command)
        prepared = prepare(self.experiment)
        drawn_keys = self.ensemble.drawn_keys if self.ensemble else ()
        self._structure = prepared.structure
        self._zeros = zeros_of(self._structure, prepared.parameters, varying=drawn_keys)
        self._zeros |= absent_signals(self._base, varying=drawn_keys)
        self.loop = closed_loop(self._structure, self._zeros)

    def commanded(self, signals: tuple[str, ...]) -> Commanded:
        """The commanded closed loop, with some of its columns observed.

        Raises:
            ConfigurationError: an unknown column.
        """
        for name in signals:
            if name not in self.loop.columns:
                raise ConfigurationError(f"signals: {unknown('column', name, self.loop.columns)}")
        return _commanded(self._structure, self._zeros, self._command, signals)

    def drawn(self, numbers: Sequence[int], seed: int) -> list[Scenario]:
        """Scenarios by number; without an ensemble, the experiment itself for any number.

        Raises:
            ConfigurationError: an invalid number.
        """
        for number in numbers:
            if not (isinstance(number, int | np.integer) and number >= 0):
                raise ConfigurationError(f"scenarios: must be whole numbers >= 0, or scenarios, not {number!r}")
        if self.ensemble is None:
            return [Scenario(0, self._base, self._base.plant, {})] * len(numbers)
        return self.ensemble.chosen([int(number) for number in numbers], seed)

    def started(self, scenarios: Sequence[Scenario], batch: int) -> tuple[list[Lane], list[SignalPage]]:
        """Starts of lanes and first pages of their signals, in a batch of `batch` lanes.

        Lanes of one experiment share their pages. A first page is kept only if the run is short, as it refers to all
        that follow.

        Raises:
            ConfigurationError: a scenario's values are inconsistent; the message names it.
        """
        if self.ensemble is None:
            page = self._only_page or first_page(self.experiment, page_length(self.experiment, 1))
            if self.experiment.samples * page.table.itemsize * page.table.shape[1] < PAGE_ROOM:
                self._only_page = page
            return [self._only] * len(scenarios), [page] * len(scenarios)
        lanes: dict[int, Lane] = {}
        pages: dict[int, SignalPage] = {}
        length = page_length(self.experiment, batch)
        for group in scenario_groups(self._under_command(scenarios)):
            check_group(group, scenarios)
            if structure_of(group.experiment).substeps != self._structure.substeps:
                stiff = scenarios[group.members[0]]
                check_substeps(stiff.experiment, solver_of(self.experiment))
            names = tuple(group.numbers)
            if names != self.loop.parameters:
                self.loop.vector(group.numbers)  # raises an error that names the difference
            x = group.experiment.reference.start
            states = starts(structure_of(group.experiment), group.vectors, x)
            sources = exogenous_sources(group.experiment, group.columns, len(group.members), further=1)
            for place, numbers, state, source in zip(
                group.members.tolist(), group.vectors, states, sources, strict=True
            ):
                lanes[place] = Lane(scenarios[place], self._command, numbers, state)
                pages[place] = _first_of(source.pieces(length, group.experiment.samples + 1, SHORTEST))
        every = range(len(scenarios))
        return [lanes[place] for place in every], [pages[place] for place in every]

    def _under_command(self, scenarios: Sequence[Scenario]) -> list[Scenario]:
        """The scenarios with bases under command; scenarios that shared a base still do."""
        bases = {id(scenario.base): scenario.base for scenario in scenarios}
        commanded = {key: under_command(base, self._command) for key, base in bases.items()}
        return [replace(scenario, base=commanded[id(scenario.base)]) for scenario in scenarios]

    _only_page: SignalPage | None = None

    @cached_property
    def _only(self) -> Lane:
        (scenario,) = self.drawn([0], 0)
        prepared = prepare(under_command(scenario.experiment, self._command), scenario.nominal)
        return Lane(scenario, self._command, self.loop.vector(prepared.parameters), prepared.state)


@GRAPHS.cached
def _commanded(
    structure: LoopStructure, zeros: frozenset[str], command: CommandName, signals: tuple[str, ...]
) -> Commanded:
    loop: ClosedLoop = closed_loop(structure, zeros)
    inputs = {name: ca.SX.sym(name, loop.observe.size1_in(name)) for name in loop.observe.name_in()}
    row = loop.observe(*inputs.values())
    observed = ca.vertcat(*(row[loop.columns.index(name)] for name in signals))
    states = tuple(tuple(loop.states.index(name) for name in names) for names in COMMANDED_STATES[command])
    return Commanded(loop, named_function("sense", inputs, {"observation": observed}), states)


Indices = NDArray[np.int64]

NEVER = np.iinfo(np.int64).max


class Lanes:
    """Parallel runs and their pages.

    Attributes:
        runs: runs of the compiled code.
        lanes: start of each run, without its first page, which would keep all that follow in memory.
    """

    def __init__(self, code: Stepping, count: int, samples: int, *, shared: bool) -> None:
        """Allocate; see `codegen.drivers.stepping.SteppedRuns`."""
        self.runs = SteppedRuns(code, count, samples, shared=shared)
        self.lanes: dict[int, Lane] = {}
        self._pages: dict[int, SignalPage] = {}
        self._ends = np.full(count, NEVER)
        self._left = NEVER

    def start(self, indices: Indices, lanes: Sequence[Lane], pages: Sequence[SignalPage]) -> None:
        """Restart some runs, each from a lane and its first page."""
        states, parameters = (np.array([getattr(lane, name) for lane in lanes]) for name in ("state", "parameters"))
        self.runs.start(indices, states, parameters)
        for index, lane, page in zip(indices.tolist(), lanes, pages, strict=True):
            self.lanes[index] = lane
            self._turn(index, page, 0)
        self._count_left()
        self.runs.look()

    def step(self, samples: int, threads: int = 1, row: int | None = None) -> int:
        """Advance all running lanes and return how many are still running. See `SteppedRuns.step`."""
        running = 1
        while samples and running:
            stretch = min(samples, self._left)
            running = self.runs.step(stretch, threads, row)
            samples -= stretch
            self._left -= stretch
            if not self._left:
                self._turn_pages()
            if row is not None:
                row += stretch * 8 * self.runs.columns
        return running

    def copies(self, indices: Indices) -> "Lanes":
        """Independent copies of some lanes in their present state."""
        numbered = list(enumerate(indices.tolist()))
        other = copy(self)
        vars(other).update(
            runs=self.runs.copies(indices),
            lanes={to: self.lanes[index] for to, index in numbered},
            _pages={to: self._pages[index] for to, index in numbered},
            _ends=self._ends[indices],
        )
        return other

    def kept(self) -> dict[str, NDArray]:
        """The present state, for `resume`."""
        runs = self.runs
        states = runs.states(np.arange(len(self._ends)))
        return {"states": states} | {
            name: getattr(runs, name).copy() for name in ("outcomes", "done", "commands", "observation")
        }

    def resume(self, states: Floats, outcomes: Indices, done: Indices, commands: Floats, observation: Floats) -> None:
        """Set all started runs to a state returned by `kept`."""
        every = np.arange(len(self._ends))
        parameters = np.array([self.lanes[index].parameters for index in every.tolist()])
        self.runs.start(every, states, parameters)
        self.runs.restore(outcomes, done, commands, observation)
        for index in np.flatnonzero(outcomes == Outcome.RUNNING).tolist():
            page = self._pages[index]
            while page.end <= done[index]:
                page = page.following()
            self._turn(index, page, int(done[index]))
        self._count_left()

    def _turn(self, index: int, page: SignalPage, sample: int) -> None:
        self._pages[index], self._ends[index] = page, page.end
        self.runs.read(index, page.address(sample))

    def _turn_pages(self) -> None:
        samples_done = self.runs.done
        for index in np.flatnonzero((self.runs.outcomes == Outcome.RUNNING) & (samples_done == self._ends)).tolist():
            self._turn(index, self._pages[index].following(), int(samples_done[index]))
        self._count_left()

    def _count_left(self) -> None:
        """Update the number of samples until the first running lane has read its page."""
        running = self.runs.outcomes == Outcome.RUNNING
        self._left = int((self._ends - self.runs.done)[running].min(initial=NEVER))
