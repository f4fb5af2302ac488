"""The predictive law beside other solvers of its quadratic programs, and on emulated microcontrollers.

``uv run --group benchmarks python -m benchmarks.predictive`` records the programs of a second in which the force is at
its limit, solves them with CasADi's solvers and with OSQP's generated code, and prints how far the law's forces are
from theirs and what a sample takes, in turns on one core; ``--write docs/mpc.md`` puts the tables into the document,
``--figure docs/images/mpc.svg`` draws its figure.
"""

import argparse
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from benchmarks.document import markdown, put, times
from benchmarks.embedded.board import BOARDS, measure, missing
from benchmarks.embedded.report import ABOUT, NAME, recorded
from benchmarks.predictive_figure import predictive_figure
from dualwinch.codegen import native
from dualwinch.codegen.export.package import c_package
from dualwinch.controllers.laws.extended_state_observer import corrected
from dualwinch.controllers.laws.predictive.box import least_in_box
from dualwinch.controllers.laws.predictive.mpc import Mpc
from dualwinch.controllers.parts import Context, Estimate
from dualwinch.model.motions import Previewed
from dualwinch.model.quantities.tree import leaves, with_leaves
from dualwinch.model.reference import Setpoint
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import asked_motion
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.plots.page import save
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate

Floats = NDArray[np.float64]

ROUNDS = 7
"""Times that all solvers take their turns; the best of each counts."""

TOLERANCE = 1e-4
"""Largest difference of the law's force from the reference's, over the limit."""

REFERENCE = "daqp"
"""The solver that says what is right: an active-set method, exact to rounding."""

SOLVERS: dict[str, dict[str, Any]] = {
    "daqp": {},
    "qpoases": {"printLevel": "none"},
    "qrqp": {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-6, "eps_rel": 1e-6}, "error_on_fail": False},
    "proxqp": {"error_on_fail": False},
    "piqp": {"error_on_fail": False},
    "highs": {"highs": {"output_flag": False}, "error_on_fail": False},
}
"""CasADi's solvers that its wheel has for programs like these, with their options; HPIPM takes other ones only."""


def experiment() -> Experiment:
    """The reference sets off at once at 0.15 m/s: the force goes to its limit, stays there and leaves it."""
    hurried = {"reference.kind": "uniform", "reference.speed": 0.15, "simulation.duration": 1.0}
    return override(case(4, "mpc"), hurried | {"controller.estimator": "none"})


@dataclass(frozen=True)
class Programs:
    """The quadratic programs of a run.

    Attributes:
        law: whose they are.
        quadratic: (n, n), the same in all.
        linear, lower, upper, sides: (samples, n).
        before, after: (samples,) forces in N of the last sample and of this one.
        mass: in kg.
        limit: of the force in N.
        sample_time: in s.
    """

    law: Mpc
    quadratic: Floats
    linear: Floats
    lower: Floats
    upper: Floats
    sides: Floats
    before: Floats
    after: Floats
    mass: float
    limit: float
    sample_time: float

    def forces(self, first: Floats) -> Floats:
        """(samples,) in N, from changes of acceleration at the end of the first stage."""
        share = self.sample_time / self.law.predicted.lengths[0]
        return self.before + share * self.mass * first


def record(given: Experiment) -> Programs:
    """Run an experiment without estimator, and step its law through what it was given once more."""
    law, result = given.controller.law, simulate(given)
    if not isinstance(law, Mpc):
        raise TypeError("the experiment's law must be Mpc")
    limits, sample_time = given.controller.limits, given.simulation.sample_time
    start = law.initial_state()
    state, wanted = ca.SX.sym("state", len(leaves(start))), ca.SX.sym("wanted", 3 * (1 + law.stages))
    sensed = ca.SX.sym("sensed", 2)
    points = [Setpoint(*ca.vertsplit(point)) for point in ca.vertsplit(wanted, 3)]
    setpoint = Previewed(**vars(points[0]), known=dict(zip(law.preview, points[1:], strict=True)))
    estimate = Estimate(sensed[0], sensed[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    context = Context(given.plant, limits, sample_time)
    before = with_leaves(start, dict(zip(leaves(start), ca.vertsplit(state), strict=True)))
    observed = corrected(before.observer, estimate, law.observer_bandwidth, sample_time)
    program = law.program(before.force, observed, 0.0, setpoint, context)
    following, output = law.step(before, estimate, setpoint, context)
    columns = [ca.vertcat(*column) for column in (program.linear, program.lower, program.upper)]
    function = ca.Function(
        "watched", [state, sensed, wanted], [ca.vertcat(*leaves(following).values()), *columns, output.u_sat]
    )
    memory = np.array(list(leaves(start).values()), float)
    motion = np.column_stack(list(asked_motion(given).values()))
    rows: list[tuple[Floats, ...]] = []
    for x, v, point in zip(result["x"], result["v"], motion, strict=True):
        found = [np.array(value).ravel() for value in function(memory, [x, v], point)]
        rows.append((*found[1:4], memory[-law.stages :], memory[-law.stages - 1 : -law.stages], found[4]))
        memory = found[0]
    linear, lower, upper, sides, force, after = (np.array(column) for column in zip(*rows, strict=True))
    if np.abs(after.ravel() - result["u_sat"]).max() > 1e-6 * limits.force:
        raise RuntimeError("the law's forces are not those of the run")
    quadratic = np.array(ca.evalf(ca.SX(ca.vertcat(*(ca.horzcat(*row) for row in program.quadratic)))))
    mass = given.plant.vehicle.mass + given.plant.vehicle.added_mass
    return Programs(
        law, quadratic, linear, lower, upper, sides, force.ravel(), after.ravel(), mass, limits.force, sample_time
    )


Solver = Callable[[], tuple[float, Floats]]
"""Solves all programs; time of it in s, and the first unknown of each."""


def ours(programs: Programs) -> Solver:
    """The law's own method, compiled: a call of C for all programs, each with its guess of the sample before."""
    n = len(programs.quadratic)
    parts = {name: ca.SX.sym(name, n) for name in ("linear", "lower", "upper", "sides")}
    linear, lower, upper, guess = (ca.vertsplit(part) for part in parts.values())
    quadratic = tuple(map(tuple, programs.quadratic.tolist()))
    values, sides = least_in_box(quadratic, linear, lower, upper, guess, programs.law.iterations)
    function = native.compile(
        ca.Function("box", [*parts.values()], [ca.vertcat(*values), ca.vertcat(*sides)], [*parts], ["values", "after"])
    )
    given = programs.linear, programs.lower, programs.upper, programs.sides

    def solve() -> tuple[float, Floats]:
        began = time.process_time()
        values = function(*given)[0]
        took = time.process_time() - began
        return took, np.clip(values[:, 0], programs.lower[:, 0], programs.upper[:, 0])

    return solve


def casadis(programs: Programs, name: str) -> Solver:
    """A solver of CasADi's, called without copies, warm-started where it can be."""
    n = len(programs.quadratic)
    sparsity = {"h": ca.Sparsity.dense(n, n), "a": ca.Sparsity(0, n)}
    solver = ca.conic("reference", name, sparsity, SOLVERS[name])
    buffer, evaluate = solver.buffer()
    quadratic, found = np.ascontiguousarray(programs.quadratic), np.zeros(n)
    tables = {"g": programs.linear, "lbx": programs.lower, "ubx": programs.upper}
    inputs = {key: np.zeros(n) for key in (*tables, "x0")}
    for key, array in {"h": quadratic, **inputs}.items():
        buffer.set_arg(solver.index_in(key), array.data)  # pyright: ignore[reportCallIssue]  # C's arguments in the stub
    buffer.set_res(solver.index_out("x"), found.data)  # pyright: ignore[reportCallIssue]

    def passed(call: Callable[[], object]) -> float:
        """Time in s in which all numbers are handed over, and `call` is called for each program."""
        began = time.process_time()
        for k in range(len(firsts)):
            for key, table in tables.items():
                inputs[key][:] = table[k]
            call()
            firsts[k], inputs["x0"][:] = found[0], found
        return time.process_time() - began

    firsts = np.empty(len(programs.linear))

    def solve(_alive: Any = (solver, buffer, quadratic)) -> tuple[float, Floats]:
        handing = passed(int)
        return passed(evaluate) - handing, firsts.copy()

    return solve


def osqp_in_c(programs: Programs, folder: Path) -> Solver:
    """OSQP's generated code, built by GCC as ours is."""
    import osqp  # pyright: ignore[reportMissingImports]
    import scipy.sparse

    n, solver = len(programs.quadratic), osqp.OSQP()
    first = programs.linear[0], scipy.sparse.eye(n, format="csc"), programs.lower[0], programs.upper[0]
    above = scipy.sparse.csc_matrix(np.triu(programs.quadratic))
    solver.setup(above, *first, verbose=False, eps_abs=1e-6, eps_rel=1e-6, warm_starting=True)
    solver.codegen(str(folder), parameters="vectors", prefix="qp_", force_rewrite=True)
    program = folder / "program"
    main = folder / "main.c"
    main.write_text((files("benchmarks") / "predictive_osqp.c").read_text())
    sources = [str(path) for path in (*folder.glob("src/*.c"), *folder.glob("*workspace.c"), main)]
    flags = ["-O3", "-march=native", f"-DN={n}", "-I.", "-Iinc/public", "-Iinc/private"]
    command = [shutil.which("gcc") or "gcc", *flags, *sources, "-lm", "-o", program]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    table = np.hstack([programs.linear, programs.lower, programs.upper]).tobytes()

    def solve() -> tuple[float, Floats]:
        count = str(len(programs.linear))
        done = subprocess.run([program, count, "3"], input=table, capture_output=True, check=True)
        found = np.frombuffer(done.stdout)
        return float(found[0]), found[1:].reshape(-1, n)[:, 0]

    return solve


def solver_table(programs: Programs) -> str:
    """How long all solvers take, and how far the law's forces are from each one's, in Markdown."""
    with tempfile.TemporaryDirectory() as folder:
        solvers = {"dualwinch": ours(programs), "OSQP, its generated C": osqp_in_c(programs, Path(folder))}
        solvers |= {f"CasADi's {name}": casadis(programs, name) for name in SOLVERS}
        best, firsts = dict.fromkeys(solvers, np.inf), {}
        for _ in range(ROUNDS):
            for name, solve in solvers.items():
                took, firsts[name] = solve()
                best[name] = min(best[name], took)
    exact = programs.forces(firsts[f"CasADi's {REFERENCE}"])
    law = np.abs(programs.after - exact).max() / programs.limit
    rate = np.abs(programs.after - programs.before).max() / programs.sample_time
    if law > TOLERANCE or np.abs(programs.after).max() > programs.limit:
        raise RuntimeError(f"the law is {law:.1e} of the limit away from the exact solution, or beyond the limit")
    count, mine = len(exact), best["dualwinch"]
    rows = [
        [
            name,
            f"{best[name] / count * 1e6:.3g} µs",
            times(best[name] / mine),
            f"{np.abs(programs.forces(firsts[name]) - exact).max() / programs.limit:.1e}",
        ]
        for name in sorted(solvers, key=lambda name: best[name])
    ]
    table = markdown(["solver", "time a sample", "beside ours", "largest error of the force, over its limit"], rows)
    held = (np.abs(programs.sides).any(axis=1)).sum()
    return (
        f"{table}\n\n*{count} programs of {len(programs.quadratic)} unknowns, {held} of them with a bound that holds; "
        f"the run's own forces are within {law:.0e} of the limit from {REFERENCE}'s, its largest force is "
        f"{np.abs(programs.after).max():.0f} N of {programs.limit:.0f} N, its largest rate {rate / 1e3:.4g} kN/s of "
        f"{programs.limit / programs.law.rise_time / 1e3:.4g} kN/s.*"
    )


def board_table() -> str:
    """What a sample of the whole controller costs on microcontrollers, in Markdown."""
    rows = []
    for stages, iterations in ((4, 1), (4, 2), (6, 1), (6, 2), (8, 2)):
        law = Mpc(stages=stages, iterations=iterations)
        given = replace(experiment(), controller=replace(experiment().controller, law=law))
        controller = block("controller", given)
        inputs = recorded(simulate(given), controller)
        package = c_package(controller, NAME, ABOUT, "float")
        for board in BOARDS:
            got = measure(board, package, NAME, inputs, len(controller.outputs), freeze=False)
            cells = f"{got.instructions.mean():.0f}", f"{got.instructions.max()}", f"{got.preparation}"
            size = f"{got.code} B", f"{got.stack} B"
            rows.append([f"{stages} stages, {iterations} systems", board.name, *cells, *size])
    headings = ["law", "processor", "instructions a step: mean", "worst", "preparing, once", "code", "stack"]
    return markdown(headings, rows)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.predictive", description=__doc__)
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the tables between the marks of a document")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="draw the figure and nothing else")
    chosen = parser.parse_args()
    if chosen.figure:
        save(predictive_figure(experiment()), chosen.figure)
        return
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    tables = {"solvers": solver_table(record(experiment()))}
    if lacking := missing():
        print(f"without microcontrollers: {', '.join(lacking)} not found")
    else:
        tables["boards"] = board_table()
    for mark, table in tables.items():
        print(table, end="\n\n")
        if chosen.write:
            put(chosen.write, mark, table)


if __name__ == "__main__":
    main()
