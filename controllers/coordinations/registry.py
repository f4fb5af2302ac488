"""How the two winches share the force command of the position law."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dualwinch.controllers.coordinations.differential_tension import TensionLoops, differential_tension_step
from dualwinch.controllers.coordinations.force_position import force_position_step
from dualwinch.controllers.coordinations.master_slave import MasterSlaveState, master_slave_step
from dualwinch.controllers.limits import CoordinationOutput


@dataclass(frozen=True)
class CoordinationLaw:
    """A coordination: its initial state and one sample of it.

    ``(state, u_sat, measurement, setpoint, controller, nominal, sample_time) -> (state, CoordinationOutput)``.
    """

    initial_state: Any
    step: Callable[..., tuple[Any, CoordinationOutput]]


COORDINATIONS = {
    "differential-tension": CoordinationLaw(TensionLoops(), differential_tension_step),
    "master-slave": CoordinationLaw(MasterSlaveState(), master_slave_step),
    "force-position": CoordinationLaw(TensionLoops(), force_position_step),
}
"""Every coordination by its name; a new one is a new file and one line here."""
