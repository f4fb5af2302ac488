"""The nonlinear closed loop with a gain or a delay put into it where the linear analysis opens it."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.analysis.operating_points import loop_operating_point
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import LOOP_OPENINGS, closed_loop
from dualwinch.simulation.loop.structure import structure_of

WATCHED = ("x", "v", "e", "v_ref", "F1", "F2")


@dataclass(frozen=True)
class Run:
    """Columns by name, (samples,) each."""

    columns: dict[str, NDArray[np.float64]]

    @property
    def peaks(self) -> list[float]:
        """Largest |e2| in each quarter of the run."""
        return [float(np.abs(part).max()) for part in np.array_split(self["v"] - self["v_ref"], 4)]

    @property
    def taut(self) -> bool:
        return min(self["F1"].min(), self["F2"].min()) > 0

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.columns[name]


def run(
    experiment: Experiment,
    x: float,
    v: float,
    kick: dict[str, float],
    samples: int,
    *,
    opening: str = "u",
    gain: float = 1.0,
    delay: int = 0,
) -> Run:
    """From steady motion, with some states kicked. At the opening, deviations are multiplied and delayed.

    Args:
        kick: state of the closed loop → what is added to it at the start.
    """
    cruise = loop_operating_point(experiment, x, v)
    loop = closed_loop(structure_of(cruise.experiment), openings=(opening,))
    steady, here = cruise.row[LOOP_OPENINGS[opening]], loop.columns.index(LOOP_OPENINGS[opening])
    state, line, reference = ca.SX.sym("state", len(loop.states)), ca.SX.sym("line", max(delay, 1)), ca.SX.sym("x_ref")
    outside, index = ca.SX(cruise.exogenous), loop.exogenous.index("reference.x")
    outside[index] = reference
    returned = loop.step(state, outside, cruise.parameters, 0)[1][here]
    said = steady + gain * (returned - steady)
    following, row, _ = loop.step(state, outside, cruise.parameters, line[0] if delay else said)
    shifted = ca.vertcat(line[1:], said) if delay else line
    watched = row[[loop.columns.index(name) for name in WATCHED]]
    step = ca.Function("inserted", [state, line, reference], [following, shifted, watched], {"cse": True})
    now, waiting = cruise.state.copy(), np.full(max(delay, 1), steady)
    for name, size in kick.items():
        now[loop.states.index(name)] += size
    rows = []
    for k in range(samples):
        at = cruise.exogenous[index] + k * v * experiment.simulation.sample_time
        now, waiting, seen = step(now, waiting, at)
        rows.append(np.array(seen).ravel())
    return Run(dict(zip(WATCHED, np.array(rows).T, strict=True)))
