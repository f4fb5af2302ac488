"""A fit by hand, beside `dualwinch.identify`: CasADi, direct multiple shooting, IPOPT.

Unknown are the same numbers, and with them the whole motion: the state at the beginning of every segment, and in every
segment the current and the rail load that nobody recorded. Minimised are the squares of the same readings' distances
from what the machine says, over the same noise, and the negative log-likelihood of current and rail load as the same
Gauss–Markov processes; segments have to meet. It is the nearest to a filter's prediction errors that has no filter:
the most likely numbers and motion together. The noise is given. Left out are the further force and torques whose size
`dualwinch.identify` finds out, its robust loss, and what is known of the first state.

Slopes are exact, and second derivatives those of Gauss and Newton: of what is squared, only the slopes count. With
exact ones, and with bounds on the numbers, whose barrier outweighs a cost of so many squares, IPOPT takes far
longer and does not come to rest. Segments are compiled, and shared out to the cores. The start is what a filter expects
with the nominal parameters.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from dualwinch.model.plant import Torques, tensions
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.simulation.batch.workers import cores
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.integrators import rk4
from dualwinch.simulation.loop.closed_loop import ZeroOrderHold, motion_template, problem_of
from dualwinch.simulation.sensors import measurement
from dualwinch.toolboxes.identification.filter import LogFilters
from dualwinch.toolboxes.identification.predictor import (
    INPUTS,
    READINGS,
    NoiseCovariances,
    predictor_structure,
    state_template,
)
from dualwinch.toolboxes.identification.resample import LogSection

Floats = NDArray[np.float64]

SAMPLES = 50
"""Of a segment."""

PARTS = 6
"""Runge–Kutta steps of a sample: of the fastest swing, where a rope is shortest, 0.9 rad each. With four, an
inertia is off by thirty of its deviations."""

MOVING = (*(f"plant.{name}" for name in ("x", "v", "theta_1", "omega_1", "theta_2", "omega_2")), "phase")
SCALES = np.array([1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1e-2, 1.0])
"""What a state is counted in."""

ACTING = ("current", "normal_force_variation")
N, A = len(MOVING), len(ACTING)

IPOPT = {"max_iter": 200, "max_wall_time": 200.0, "tol": 1e-6, "print_level": 0, "sb": "yes"}
"""Options."""


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


def shoot(
    filters: LogFilters, nominal: Experiment, noise: NoiseCovariances, keys: Sequence[str], values: Floats
) -> Shot:
    """Fit numbers to the only section of some filters, beginning with some values; noise is as given."""
    began = perf_counter()
    (section,) = filters.sections
    count = len(section.inputs) // SAMPLES
    segments = _Segments(nominal, keys, values, noise, section.upto(count * SAMPLES))
    solver = segments.solver()
    start = segments.start(filters, noise)
    built = perf_counter()
    lower, upper = np.full(len(start), -np.inf), np.full(len(start), np.inf)
    p = len(keys)
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
        self, nominal: Experiment, keys: Sequence[str], values: Floats, noise: NoiseCovariances, section: LogSection
    ) -> None:
        self._nominal, self._keys, self._values = nominal, tuple(keys), values
        self._noise, self._section = noise, section
        self._count, self._p = len(section.inputs) // SAMPLES, len(keys)
        self._acting = np.array([noise.process[name].deviation for name in ACTING])

    def solver(self) -> ca.Function:
        """IPOPT on it."""
        p, count = self._p, self._count
        x = ca.MX.sym("x", p + N * (count + 1) + A * count)
        shares, nodes, acting = ca.vertsplit(x, [0, p, p + N * (count + 1), x.numel()])
        nodes, acting = ca.reshape(nodes, N, count + 1), ca.reshape(acting, A, count)
        penalty, (plain, sloped, outside) = self._penalty(acting), self._segment()
        begin = ca.vertcat(nodes[:, :count], ca.repmat(shares, 1, count), acting)
        columns = _columns(p, count)

        costs, ends = self._each(plain)(begin, outside)
        gaps = ca.vec(nodes[:, 1:] - ends)
        costs_too, pulls, ends_by, squares = self._each(sloped)(begin, outside)
        ways = N + p + A
        lam_f, lam_g, none = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", N * count), ca.MX.sym("none", 0)
        bent = _hessian(ca.reshape(squares, ways**2, count), columns, x.numel(), p)
        hessian = lam_f * (bent + ca.triu(ca.hessian(penalty, x)[0]))
        gradient = _added(ca.reshape(pulls, ways, count), p) + ca.gradient(penalty, x)
        by_gaps, names = _gaps_by(ca.vec(ends_by), columns, x.numel(), p), ["x", "p"]
        cost = ca.sum2(costs_too) + penalty
        derivatives = {
            "grad_f": ca.Function("nlp_grad_f", [x, none], [cost, gradient], names, ["f", "g"]),
            "jac_g": ca.Function("nlp_jac_g", [x, none], [gaps, by_gaps], names, ["g", "j"]),
            "hess_lag": ca.Function("nlp_hess_l", [x, none, lam_f, lam_g], [hessian], [*names, "f", "g"], ["h"]),
        }
        options = {f"ipopt.{name}": value for name, value in IPOPT.items()} | {"print_time": False}
        problem = {"x": x, "p": none, "f": ca.sum2(costs) + penalty, "g": gaps}
        return ca.nlpsol("solver", "ipopt", problem, derivatives | options)

    def _each(self, function: ca.Function) -> ca.Function:
        """A function of a segment, compiled, of all segments on all cores."""
        inputs = function.mx_in()
        options = {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O3", "-march=native"]}}
        return ca.Function(function.name(), inputs, function.call(inputs), options).map(self._count, "thread", cores())

    def start(self, filters: LogFilters, noise: NoiseCovariances) -> Floats:
        """Nodes and what acts as the filter expects them that knows the numbers no better than the search."""
        (weights,) = filters.run(self._nominal, noise, rows=True, robust=False)
        elements = list(leaves(state_template(predictor_structure(self._nominal))))
        states = dict(zip(elements, np.asarray(weights.states).T, strict=True))
        rows = np.arange(0, SAMPLES * self._count, SAMPLES)
        nodes = np.column_stack([states[f"motion.{name}"][rows] for name in MOVING]) / SCALES
        acting = np.column_stack([states[f"unrecorded.{name}"][rows] for name in ACTING]) / self._acting
        return np.concatenate([np.ones(self._p), np.ravel(nodes), nodes[-1], np.ravel(acting)])

    def _penalty(self, acting: ca.MX) -> ca.MX:
        """Negative log-likelihood of the disturbances: half the squares of their steps over the deviations."""
        step = SAMPLES * self._nominal.simulation.sample_time
        kept = np.exp(-step / np.array([self._noise.process[name].time for name in ACTING]))
        moved = (acting[:, 1:] - kept * acting[:, :-1]) / np.sqrt(1 - kept**2)
        return (ca.sumsqr(acting[:, 0]) + ca.sumsqr(moved)) / 2

    def _segment(self) -> tuple[ca.Function, ca.Function, ca.DM]:
        """A segment without and with slopes, and what is outside of all: ``own`` is node, shares and what acts.

        Returns:
            ``plain(own, outside) -> (cost, end)``, ``sloped(own, outside) -> (cost, gradient, end_by_own, squares)``,
            where squares are the products of the slopes of what is squared, and what is outside.
        """
        experiment, p, section = self._nominal, self._p, self._section
        used = [column for column in range(len(READINGS)) if np.isfinite(section.readings[:, column]).any()]
        readings = section.readings[:, used]
        weights = np.isfinite(readings) / np.sqrt(self._noise.measurement[used])
        outside = ca.DM(np.column_stack([section.inputs, np.nan_to_num(readings), weights]).T)

        z, q, u = ca.SX.sym("z", N), ca.SX.sym("q", p + A), ca.SX.sym("u", len(INPUTS) + 2 * len(used))
        t, tau_1, tau_2, *rest = ca.vertsplit(u)
        rest = rest[len(INPUTS) - 3 :]
        numbers = dict(zip(self._keys, ca.vertsplit(q[:p] * self._values), strict=True))
        plant = with_leaves(experiment.plant, numbers, "plant.")
        motion = with_leaves(motion_template(experiment), dict(zip(MOVING, ca.vertsplit(z * SCALES), strict=True)))
        current, load = ca.vertsplit(q[p:] * self._acting)
        hold = ZeroOrderHold(t, Torques(tau_1, tau_2), current, load, ca.SX(0))
        pulls = tensions(motion.plant, plant, t)
        every = measurement(motion.plant, pulls, plant, experiment.sensors)
        off = ca.vertcat(*(getattr(every, READINGS[column]) for column in used)) - ca.vertcat(*rest[: len(used)])
        off *= ca.vertcat(*rest[len(used) :])
        step = experiment.simulation.sample_time / PARTS
        moved = rk4(problem_of(hold, step, plant, experiment.disturbance), motion, t, step)
        following = ca.vertcat(*(leaves(moved)[name] for name in MOVING)) / SCALES

        by = ca.SX.sym("by", N, N + p + A)  # slopes of z by what the segment owns
        off_by, following_by = (
            ca.jacobian(value, z) @ by + ca.horzcat(ca.SX(value.numel(), N), ca.jacobian(value, q))
            for value in (off, following)
        )
        look = [ca.sumsqr(off) / 2, ca.densify(off_by.T @ off), ca.densify(off_by.T @ off_by)]
        far = ca.Function("far", [z, q, u], look[:1])
        far_sloped = ca.Function("far_sloped", [z, by, q, u], look, {"cse": True})
        move = ca.Function("move", [z, q, u], [following], {"cse": True})
        move_sloped = ca.Function("move_sloped", [z, by, q, u], [following, ca.densify(following_by)], {"cse": True})
        return self._plain(far, move, step), self._sloped(far_sloped, move_sloped, step), outside

    def _plain(self, far: ca.Function, move: ca.Function, step: float) -> ca.Function:
        p, inputs = self._p, far.numel_in(2)
        sums, row = ca.MX.sym("sums", 1 + N + p + A), ca.MX.sym("row", inputs)
        cost, node, held = ca.vertsplit(sums, [0, 1, 1 + N, 1 + N + p + A])
        cost += far(node, held, row)
        for part in range(PARTS):
            node = move(node, held, _later(row, part * step))
        samples = ca.Function("sample", [sums, row], [ca.vertcat(cost, node, held)]).fold(SAMPLES)
        own, rows = ca.MX.sym("own", N + p + A), ca.MX.sym("rows", inputs, SAMPLES)
        last = samples(ca.vertcat(0, own), rows)
        return ca.Function("plain", [own, rows], [last[0], last[1 : 1 + N]])

    def _sloped(self, far: ca.Function, move: ca.Function, step: float) -> ca.Function:
        p, ways, inputs = self._p, N + self._p + A, far.numel_in(3)
        sizes = np.cumsum([0, 1, ways, ways**2, N, N * ways, p + A]).tolist()
        sums, row = ca.MX.sym("sums", sizes[-1]), ca.MX.sym("row", inputs)
        cost, pull, square, node, by, held = ca.vertsplit(sums, sizes)
        by = ca.reshape(by, N, ways)
        more, steeper, bent = far(node, by, held, row)
        for part in range(PARTS):
            node, by = move(node, by, held, _later(row, part * step))
        following = ca.vertcat(cost + more, pull + steeper, square + ca.vec(bent), node, ca.vec(by), held)
        samples = ca.Function("sample_sloped", [sums, row], [following]).fold(SAMPLES)
        own, rows = ca.MX.sym("own", ways), ca.MX.sym("rows", inputs, SAMPLES)
        first = ca.vertcat(ca.DM.zeros(1 + ways + ways**2), own[:N], ca.vec(ca.DM.eye(ways)[:N, :]), own[N:])
        cost, pull, square, _, by, _ = ca.vertsplit(samples(first, rows), sizes)
        return ca.Function("sloped", [own, rows], [cost, pull, ca.reshape(by, N, ways), square])


def _later(row: ca.MX, time: float) -> ca.MX:
    """What is outside of a sample, some time later."""
    return row + ca.vertcat(time, ca.DM.zeros(row.numel() - 1))


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
