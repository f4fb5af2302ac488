"""What lanes start from: the scenarios of an ensemble, or one experiment again and again."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.codegen.drivers.stepping import Commanded
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.quantity import nearest
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import ClosedLoop, absent_signals, closed_loop, initial_state_of
from dualwinch.simulation.loop.structure import Structure, parameters_of, structure_of, zeros_of
from dualwinch.simulation.loop.zero_order_hold import named_function
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.stepper.given import KINDS, CommandName, under_command
from dualwinch.simulation.stepper.pages import ROOM, Page, first_page, page_length

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Lane:
    """What a lane starts from.

    Attributes:
        scenario: what was drawn.
        experiment: the same under command.
        parameters, state: as the compiled code takes them, the state before the first sample.
    """

    scenario: Scenario
    experiment: Experiment
    parameters: Floats
    state: Floats


class Scenarios:
    """An experiment or an ensemble under command.

    Attributes:
        experiment: the nominal values, under command.
        ensemble: what is drawn from, its controller as it was; None: nothing is drawn.
        loop: the closed loop of all scenarios.
    """

    def __init__(self, given: Experiment | Ensemble, command: CommandName) -> None:
        """Build the closed loop.

        Raises:
            ConfigurationError: the nominal values do not fit together.
        """
        self.ensemble = given if isinstance(given, Ensemble) else None
        self._base = given.experiment if isinstance(given, Ensemble) else given
        self._command: CommandName = command
        self.experiment = under_command(self._base, command)
        check(self.experiment)
        drawn = self.ensemble.drawn_keys if self.ensemble else ()
        self._structure = structure_of(self.experiment)
        self._zeros = zeros_of(self._structure, parameters_of(self.experiment), varying=drawn)
        self._zeros |= absent_signals(self._base, varying=drawn)
        self.loop = closed_loop(self._structure, self._zeros)

    def commanded(self, signals: tuple[str, ...]) -> Commanded:
        """What moves the loop on, and observes some of its columns.

        Raises:
            ConfigurationError: there is no such column.
        """
        for name in signals:
            if name not in self.loop.columns:
                near = nearest(str(name), self.loop.columns)
                raise ConfigurationError(f"signals: unknown column {name!r}; did you mean '{near}'?")
        return _commanded(self._structure, self._zeros, self._command, signals)

    def drawn(self, numbers: Sequence[int], seed: int) -> list[Scenario]:
        """Scenarios by their numbers; without an ensemble the experiment itself, whatever the numbers.

        Raises:
            ConfigurationError: a number that is none.
        """
        for number in numbers:
            if not (isinstance(number, int | np.integer) and number >= 0):
                raise ConfigurationError(f"scenarios: {number!r} is none: must be whole numbers >= 0, or scenarios")
        if self.ensemble is None:
            return [Scenario(0, self._base, self._base.plant, {})] * len(numbers)
        return self.ensemble.chosen([int(number) for number in numbers], seed)

    def lanes(self, scenarios: Sequence[Scenario]) -> list[Lane]:
        """What lanes of scenarios start from.

        Raises:
            ConfigurationError: a scenario's values do not fit together; the message names it.
        """
        if self.ensemble is None:
            return [self._only] * len(scenarios)
        return [self._lane(scenario) for scenario in scenarios]

    def first_pages(self, lanes: Sequence[Lane], batch: int) -> list[Page]:
        """The first pages of lanes' signals, of a batch of so many lanes.

        Lanes of one experiment read the same pages. They are kept where they are small: they hold all that follow.
        """
        if self.ensemble:
            return [first_page(lane.experiment, page_length(self.experiment, batch)) for lane in lanes]
        page = self._only_page or first_page(self.experiment, page_length(self.experiment, 1))
        if self.experiment.samples * page.table.itemsize * page.table.shape[1] < ROOM:
            self._only_page = page
        return [page] * len(lanes)

    _only_page: Page | None = None

    @cached_property
    def _only(self) -> Lane:
        return self._lane(*self.drawn([0], 0))

    def _lane(self, scenario: Scenario) -> Lane:
        experiment = under_command(scenario.experiment, self._command)
        try:
            check(experiment)
        except ConfigurationError as error:
            raise ConfigurationError(f"scenario {scenario.index}: {error}") from error
        parameters = self.loop.vector(parameters_of(experiment, scenario.nominal))
        return Lane(scenario, experiment, parameters, np.array(list(initial_state_of(experiment).values())))


@cache
def _commanded(
    structure: Structure, zeros: frozenset[str], command: CommandName, signals: tuple[str, ...]
) -> Commanded:
    loop: ClosedLoop = closed_loop(structure, zeros)
    inputs = {name: ca.SX.sym(name, loop.observe.size1_in(name)) for name in loop.observe.name_in()}
    row = loop.observe(*inputs.values())
    observed = ca.vertcat(*(row[loop.columns.index(name)] for name in signals))
    states = tuple(tuple(loop.states.index(name) for name in names) for names in KINDS[command].states)
    return Commanded(loop, named_function("sense", inputs, {"observation": observed}), states)
