"""The rows of the table: a new peer or algorithm is a new file, or none, and one line in `peers`."""

from collections.abc import Callable
from functools import partial

from benchmarks.case import Case
from benchmarks.peers import (
    archimedes_loop,
    batch,
    compiled,
    ensembles,
    hand_c,
    interpreter,
    jax_batch,
    mapaccum,
    mapped,
    numba_batch,
    numba_loop,
    scipy_ivp,
    sensitive,
)
from benchmarks.peers.candidates import ROLLOUTS
from benchmarks.peers.peer import Peer, Run
from dualwinch.simulation.batch.workers import cores
from dualwinch.simulation.experiment import EngineName, Simulation

LIMIT = "hand-c"
"""Key of the peer that is the limit of the shared algorithm, RK4."""

ADAPTIVE_LIMIT = "hand-c-adaptive"
"""Key of the peer that is the limit of the product's default algorithm."""

OURS = "dualwinch"
"""Key of the peer the others are compared with and checked against."""

DEFAULT = "default"
"""Key of the row with the product's default integrator, where that is not the shared algorithm."""

ENSEMBLES = ("sea", "rig")
"""Ensembles that have rows."""

SENSITIVE = "sensitivities"
"""Key of the row with derivatives beside the rollout."""


def peers(duration: float) -> list[Peer]:
    """All rows, rollouts of some duration in s.

    Besides the one algorithm that all peers share (RK4, four sub-steps), a row shows the product's default
    integrator where that is another one.
    """
    shared, default = Case(duration), Simulation()
    words, threads = f"{default.integrator} × {default.substeps}", sorted({1, cores()})
    rows = [
        Peer(LIMIT, "hand-written C loop", hand_c.prepare_with("hand_loop"), shared),
        Peer("numba", "Numba loop", numba_loop.prepare, shared),
        Peer(OURS, "dualwinch, the C call alone", compiled.prepare_call, shared),
        Peer("dualwinch-simulate", "dualwinch, simulate() whole", compiled.prepare_simulate, shared),
        Peer("engine-casadi", "dualwinch, engine casadi, the C call alone", _engine("casadi"), shared),
        Peer("engine-interpreter", "dualwinch, engine interpreter", _engine("interpreter"), shared),
        Peer("mapaccum-c", "CasADi mapaccum, compiled C", mapaccum.prepare_compiled, shared),
        Peer("mapaccum", "CasADi mapaccum, interpreted", mapaccum.prepare_interpreted, shared),
        Peer("archimedes", "Archimedes scan, CasADi interpreted", archimedes_loop.prepare, shared),
        Peer("interpreter", "CasADi interpreter, a call a sample", interpreter.prepare, shared),
        Peer("scipy-rk45", "SciPy solve_ivp a sample, RK45", scipy_ivp.prepare_with("RK45"), shared),
        Peer("scipy-lsoda", "SciPy solve_ivp a sample, LSODA", scipy_ivp.prepare_with("LSODA"), shared),
        *(
            Peer(f"numba-batch-{n}", f"Numba prange, {_batch(n)}", numba_batch.prepare_with(n), shared, ROLLOUTS)
            for n in threads
        ),
        *(
            Peer(f"casadi-map-{n}", f"CasADi map, compiled C, {_batch(n)}", mapped.prepare_with(n), shared, ROLLOUTS)
            for n in threads
        ),
        Peer("jax", f"JAX vmap, batch of {ROLLOUTS}", jax_batch.prepare_with("rk4"), shared, ROLLOUTS),
        Peer(
            "diffrax", f"JAX + diffrax Tsit5, batch of {ROLLOUTS}", jax_batch.prepare_with("diffrax"), shared, ROLLOUTS
        ),
    ]
    preferred = Case(duration, default.integrator, default.substeps)
    if default.integrator == "adaptive":
        limit = hand_c.prepare_with("hand_adaptive")
        rows.append(Peer(ADAPTIVE_LIMIT, f"hand-written C loop, {words}", limit, preferred))
    if preferred != shared:
        rows += [
            Peer(DEFAULT, f"dualwinch {words}, the C call alone", compiled.prepare_call, preferred),
            Peer("default-casadi", f"dualwinch {words}, engine casadi, the C call alone", _engine("casadi"), preferred),
            Peer("default-interpreter", f"dualwinch {words}, engine interpreter", _engine("interpreter"), preferred),
            Peer("default-simulate", f"dualwinch {words}, simulate() whole", compiled.prepare_simulate, preferred),
        ]
    rows.append(Peer(SENSITIVE, "the same with its slopes by 12 gains", sensitive.prepare, preferred))
    rows += [
        Peer(f"batch-{n}", f"dualwinch {default.integrator}, {_batch(n)}", batch.prepare_with(n), preferred, ROLLOUTS)
        for n in threads
    ]
    return rows + [row for name in ENSEMBLES for row in _in_ensemble(name, preferred, threads)]


def _engine(name: EngineName) -> Callable[[Case], Run]:
    return partial(compiled.prepare_call, engine=name)


def _in_ensemble(name: str, case: Case, threads: list[int]) -> list[Peer]:
    """Rows of an ensemble: candidates in few scenarios, then many scenarios by the compiled code and in all."""
    most, alone = threads[-1], ensembles.scenario_alone(name)
    batches = [
        Peer(
            f"{name}-{n}",
            f"{name} with Kalman filter, {_batch(n)}",
            ensembles.prepare_with(name, n),
            case,
            ROLLOUTS,
            alone,
        )
        for n in threads
    ]
    wholes = [
        (f"{name}-kernel", "its compiled code alone", ensembles.prepare_kernel_with),
        (f"{name}-ensemble", "the same by run_ensemble, draws included", ensembles.prepare_ensemble_with),
    ]
    return batches + [
        Peer(key, f"{name}, {ROLLOUTS} scenarios, {title}, {_threads(most)}", of(name, most), case, ROLLOUTS, alone)
        for key, title, of in wholes
    ]


def _batch(threads: int) -> str:
    return f"batch of {ROLLOUTS} {_threads(threads)}"


def _threads(threads: int) -> str:
    return f"on {threads} thread{'s' * (threads > 1)}"
