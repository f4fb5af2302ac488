"""A fit by hand, beside `dualwinch.identify`: CasADi, direct multiple shooting, IPOPT.

Unknown are the same numbers, and with them the whole motion: the state at the beginning of every segment, and in every
segment the current and the rail load that nobody recorded. Minimised are the squares of the same readings' distances
from what the machine says, over the same noise, and how unlikely current and rail load are as the same Gauss–Markov
processes; segments have to meet. It is the nearest to a filter's prediction errors that has no filter: the most
likely numbers and motion together. Noise levels are given. Left out are the further force and torques whose size
`dualwinch.identify` finds out, its robust loss, and what is known of the first state.

Derivatives are exact, the second ones too; segments are compiled, and shared out to the cores. Each sample is four
steps of the classical Runge–Kutta method. The start is what a filter expects with the numbers that are believed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.identification.predictor import machine_of, state_template
from dualwinch.identification.sections import Filters, Levels, Section
from dualwinch.identification.sensed import READINGS, sensed
from dualwinch.model.plant import Torques
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.batch.cores import cores
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators.rk4 import rk4
from dualwinch.simulation.loop.between import MOTION_TEMPLATE, ZeroOrderHold, problem_of

Floats = NDArray[np.float64]

SAMPLES = 50
"""Of a segment."""

PARTS = 4
"""Steps of a sample: of the fastest swing, where a rope is shortest, 1.3 rad each."""

MOVING = (*(f"plant.{name}" for name in ("x", "v", "theta_1", "omega_1", "theta_2", "omega_2")), "phase")
SCALES = np.array([1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1.0])
"""What a state is counted in."""

ACTING = ("current", "normal_force_variation")
N, A = len(MOVING), len(ACTING)

IPOPT = {
    "max_iter": 200, "max_wall_time": 200.0, "tol": 1e-6, "print_level": 0, "sb": "yes",
    "acceptable_iter": 4, "acceptable_obj_change_tol": 2e-4, "acceptable_tol": 1e10, "acceptable_dual_inf_tol": 1e10,
    "acceptable_constr_viol_tol": 1e-2, "acceptable_compl_inf_tol": 1e10,
}  # fmt: skip
"""Options. Ropes and friction bend the cost so sharply that slopes at the end swing for ever: what changes the cost by
less than so little, some times in a row, is the end."""


@dataclass(frozen=True)
class Shot:
    """What it came to.

    Attributes:
        values: (p,) of the numbers.
        seconds: of the solve.
        building: of expressions and compiler in s.
        iterations: of IPOPT.
        unknowns: of the problem.
        status: IPOPT's word.
    """

    values: Floats
    seconds: float
    building: float
    iterations: int
    unknowns: int
    status: str


def shoot(filters: Filters, believed: Experiment, levels: Levels, keys: Sequence[str], values: Floats) -> Shot:
    """Fit numbers to the only section of some filters, beginning with some values; noise is as given."""
    began = perf_counter()
    (section,) = filters.sections
    count = len(section.inputs) // SAMPLES
    segments = _Segments(believed, keys, values, levels, section.upto(count * SAMPLES))
    solver = segments.solver()
    start = segments.start(filters, levels)
    built = perf_counter()
    lower, upper = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    p = len(keys)
    lower[:p], upper[:p] = 0.1, 10.0
    lower[p + N - 1] = upper[p + N - 1] = start[p + N - 1]  # the phase at the beginning only tells when that was
    found = solver(x0=start, lbx=lower, ubx=upper, lbg=0, ubg=0)
    stats: dict[str, Any] = solver.stats()
    return Shot(
        values=np.asarray(found["x"]).ravel()[:p] * values,
        seconds=perf_counter() - built,
        building=built - began,
        iterations=int(stats["iter_count"]),
        unknowns=len(start),
        status=str(stats["return_status"]),
    )


class _Segments:
    """The problem: unknowns are shares of the numbers, states at all nodes, and what acts in all segments."""

    def __init__(
        self, believed: Experiment, keys: Sequence[str], values: Floats, levels: Levels, section: Section
    ) -> None:
        self._believed, self._keys, self._values = believed, tuple(keys), values
        self._levels, self._section = levels, section
        self._count, self._p = len(section.inputs) // SAMPLES, len(keys)
        self._acting = np.array([levels.scatter[name].deviation for name in ACTING])

    def solver(self) -> ca.Function:
        """IPOPT on it."""
        p, count = self._p, self._count
        x = ca.MX.sym("x", p + N * (count + 1) + A * count)
        shares, nodes, acting = ca.vertsplit(x, [0, p, p + N * (count + 1), x.numel()])
        nodes, acting = ca.reshape(nodes, N, count + 1), ca.reshape(acting, A, count)
        penalty, segment, outside = self._penalty(acting), *self._segment()
        begin = ca.vertcat(nodes[:, :count], ca.repmat(shares, 1, count), acting)
        columns = _columns(p, count)

        plain = self._each(segment)(begin, outside)
        gaps = ca.vec(nodes[:, 1:] - plain[1])
        own, given = ca.MX.sym("own", N + p + A), ca.MX.sym("given", *outside[:, :SAMPLES].shape)
        cost, end = segment(own, given)
        slopes = ca.Function("slopes", [own, given], [cost, ca.gradient(cost, own), end, ca.jacobian(end, own)])
        price, pull = ca.MX.sym("price"), ca.MX.sym("pull", N)
        bent, _ = ca.hessian(price * cost - ca.dot(pull, end), own)
        bends = ca.Function("bends", [own, given, price, pull], [ca.densify(bent)])

        sloped = self._each(slopes)(begin, outside)
        lam_f, lam_g, none = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", N * count), ca.MX.sym("none", 0)
        pulls = ca.reshape(lam_g, N, count)
        square = ca.reshape(
            self._each(bends)(begin, outside, ca.repmat(lam_f, 1, count), pulls), (N + p + A) ** 2, count
        )
        hessian = _hessian(square, columns, x.numel(), p) + lam_f * ca.triu(ca.hessian(penalty, x)[0])
        gradient = _added(ca.reshape(sloped[1], N + p + A, count), p) + ca.gradient(penalty, x)
        by_gaps = _gaps_by(ca.vec(sloped[3]), columns, x.numel(), p)
        names = ["x", "p"]
        derivatives = {
            "grad_f": ca.Function("nlp_grad_f", [x, none], [ca.sum2(sloped[0]) + penalty, gradient], names, ["f", "g"]),
            "jac_g": ca.Function("nlp_jac_g", [x, none], [gaps, by_gaps], names, ["g", "j"]),
            "hess_lag": ca.Function("nlp_hess_l", [x, none, lam_f, lam_g], [hessian], [*names, "f", "g"], ["h"]),
        }
        options = {f"ipopt.{name}": value for name, value in IPOPT.items()} | {"print_time": False}
        return ca.nlpsol(
            "solver", "ipopt", {"x": x, "p": none, "f": ca.sum2(plain[0]) + penalty, "g": gaps}, derivatives | options
        )

    def _each(self, function: ca.Function) -> ca.Function:
        """A function of a segment, compiled, of all segments on all cores."""
        inputs = function.mx_in()
        options = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O1"]}}
        return ca.Function(function.name(), inputs, function.call(inputs), options).map(self._count, "thread", cores())

    def start(self, filters: Filters, levels: Levels) -> Floats:
        """Nodes and what acts as the filter expects them that knows the numbers no better than the search."""
        (weights,) = filters.weigh(self._believed, levels, rows=True)
        elements = list(leaves(state_template(machine_of(self._believed))))
        states = dict(zip(elements, np.asarray(weights.states).T, strict=True))
        rows = np.arange(0, SAMPLES * self._count, SAMPLES)
        nodes = np.column_stack([states[f"motion.{name}"][rows] for name in MOVING]) / SCALES
        acting = np.column_stack([states[f"unrecorded.{name}"][rows] for name in ACTING]) / self._acting
        return np.concatenate([np.ones(self._p), np.ravel(nodes), nodes[-1], np.ravel(acting)])

    def _penalty(self, acting: ca.MX) -> ca.MX:
        """How unlikely what acts is: half the squares of its steps over their deviations."""
        step = SAMPLES * self._believed.simulation.sample_time
        kept = np.exp(-step / np.array([self._levels.scatter[name].time for name in ACTING]))
        moved = (acting[:, 1:] - kept * acting[:, :-1]) / np.sqrt(1 - kept**2)
        return (ca.sumsqr(acting[:, 0]) + ca.sumsqr(moved)) / 2

    def _segment(self) -> tuple[ca.Function, ca.DM]:
        """``segment(own, outside) -> (cost, end)`` and what is outside: ``own`` is node, shares and what acts."""
        experiment, p, section = self._believed, self._p, self._section
        used = [column for column in range(len(READINGS)) if np.isfinite(section.readings[:, column]).any()]
        readings = section.readings[:, used]
        weights = np.isfinite(readings) / np.sqrt(self._levels.noise[used])
        outside = ca.DM(np.column_stack([section.inputs, np.nan_to_num(readings), weights]).T)

        z, q, u = ca.SX.sym("z", N), ca.SX.sym("q", p + A), ca.SX.sym("u", 3 + 2 * len(used))
        t, tau_1, tau_2, *rest = ca.vertsplit(u)
        numbers = dict(zip(self._keys, ca.vertsplit(q[:p] * self._values), strict=True))
        plant = with_leaves(experiment.plant, numbers, "plant.")
        motion = with_leaves(MOTION_TEMPLATE, dict(zip(MOVING, ca.vertsplit(z * SCALES), strict=True)))
        current, load = ca.vertsplit(q[p:] * self._acting)
        hold = ZeroOrderHold(t, Torques(tau_1, tau_2), current, load, ca.SX(0))
        every = list(leaves(sensed(motion.plant, t, plant, experiment.sensors)).values())
        off = ca.vertcat(*(every[column] for column in used)) - ca.vertcat(*rest[: len(used)])
        cost = ca.sumsqr(off * ca.vertcat(*rest[len(used) :])) / 2
        step = experiment.simulation.sample_time / PARTS
        moved = rk4(problem_of(hold, step, plant, experiment.disturbance), motion, t, step)
        following = ca.vertcat(*(leaves(moved)[name] for name in MOVING)) / SCALES
        move = ca.Function("move", [z, q, u], [following], {"cse": True})

        far = ca.Function("far", [z, q, u], [cost])
        whole, row = ca.MX.sym("whole", 1 + N + p + A), ca.MX.sym("row", u.numel())
        sum_, node, held = ca.vertsplit(whole, [0, 1, 1 + N, 1 + N + p + A])
        sum_ += far(node, held, row)
        for part in range(PARTS):
            node = move(node, held, row + ca.vertcat(part * step, ca.DM.zeros(u.numel() - 1)))
        samples = ca.Function("sample", [whole, row], [ca.vertcat(sum_, node, held)]).fold(SAMPLES)
        own, rows = ca.MX.sym("own", N + p + A), ca.MX.sym("rows", u.numel(), SAMPLES)
        last = samples(ca.vertcat(0, own), rows)
        return ca.Function("segment", [own, rows], [last[0], last[1 : 1 + N]]), outside


def _columns(p: int, count: int) -> NDArray[np.int_]:
    """(own, segments): where node, shares and what acts of every segment stand among the unknowns."""
    segments = np.arange(count)
    nodes = p + N * segments + np.arange(N)[:, np.newaxis]
    shares = np.broadcast_to(np.arange(p)[:, np.newaxis], (p, count))
    acting = p + N * (count + 1) + A * segments + np.arange(A)[:, np.newaxis]
    return np.concatenate([nodes, shares, acting])


def _added(slope: ca.MX, p: int) -> ca.MX:
    """All segments' slopes of the cost, by the unknowns."""
    nodes, shares, acting = ca.vertsplit(slope, [0, N, N + p, N + p + A])
    return ca.vertcat(ca.sum2(shares), ca.vec(nodes), ca.MX.zeros(N), ca.vec(acting))


def _sparse(rows: NDArray[np.int_], columns: NDArray[np.int_], elements: ca.MX, shape: tuple[int, int]) -> ca.MX:
    """A sparse matrix of a vector's elements."""
    inverted = False
    pattern, order = ca.Sparsity.triplet(*shape, rows.ravel().tolist(), columns.ravel().tolist(), inverted)
    return ca.MX(pattern, elements[order])


def _gaps_by(by: ca.MX, columns: NDArray[np.int_], size: int, p: int) -> ca.MX:
    """Slopes of all gaps: each node's own, less those of the segment before."""
    ways, count = columns.shape
    gaps, ahead = N * np.arange(count)[:, None, None] + np.arange(N), np.arange(N * count)
    shape = count, ways, N
    ends = _sparse(np.broadcast_to(gaps, shape), np.broadcast_to(columns.T[:, :, None], shape), by, (len(ahead), size))
    return _sparse(ahead, p + N + ahead, ca.MX.ones(len(ahead)), (len(ahead), size)) - ends


def _hessian(square: ca.MX, columns: NDArray[np.int_], size: int, p: int) -> ca.MX:
    """Upper triangle of the sum of all segments' second derivatives."""
    j, i = (index.ravel() for index in np.indices((len(columns), len(columns))))  # elements lie column by column
    shared = (i >= N) & (i < N + p) & (j >= N) & (j < N + p)
    own, upper = ~shared & (columns[i, 0] <= columns[j, 0]), shared & (i <= j)
    apart = ca.vec(square[np.flatnonzero(own).tolist(), :])
    together = ca.sum2(square[np.flatnonzero(upper).tolist(), :])
    return _sparse(columns[i[own]].T, columns[j[own]].T, apart, (size, size)) + _sparse(
        i[upper] - N, j[upper] - N, together, (size, size)
    )
