"""The rows of the table: a new peer or algorithm is a new file, or none, and one line in `peers`."""

from benchmarks.case import Case
from benchmarks.peers import batch, compiled, hand_c, interpreter, mapaccum, numba_loop, scipy_ivp
from benchmarks.peers.peer import Peer
from simulation.cores import cores
from simulation.experiment import Simulation

LIMIT = "hand-c"
"""Key of the peer that is the limit."""

OURS = "dualwinch"
"""Key of the peer the others are compared with and checked against."""

DEFAULT = "default"
"""Key of the row with the product's default integrator, where that is not the shared algorithm."""


def peers(duration: float) -> list[Peer]:
    """All rows, rollouts of some duration in s.

    Besides the one algorithm that all peers share (RK4, four sub-steps), a row shows the product's default
    integrator where that is another one.
    """
    shared = Case(duration)
    rows = [
        Peer(LIMIT, "hand-written C loop", hand_c.prepare, shared),
        Peer("numba", "Numba loop", numba_loop.prepare, shared),
        Peer(OURS, "dualwinch, the C call alone", compiled.prepare_call, shared),
        Peer("dualwinch-simulate", "dualwinch, simulate() whole", compiled.prepare_simulate, shared),
        Peer("mapaccum-c", "CasADi mapaccum, compiled C", mapaccum.prepare_compiled, shared),
        Peer("mapaccum", "CasADi mapaccum, interpreted", mapaccum.prepare_interpreted, shared),
        Peer("interpreter", "CasADi interpreter, a call a sample", interpreter.prepare, shared),
        Peer("scipy-rk45", "SciPy solve_ivp a sample, RK45", scipy_ivp.prepare_with("RK45"), shared),
        Peer("scipy-lsoda", "SciPy solve_ivp a sample, LSODA", scipy_ivp.prepare_with("LSODA"), shared),
    ]
    default = Simulation()
    preferred = Case(duration, default.integrator, default.substeps)
    if preferred != shared:
        words = f"{default.integrator} × {default.substeps}"
        rows += [
            Peer(DEFAULT, f"dualwinch {words}, the C call alone", compiled.prepare_call, preferred),
            Peer("default-simulate", f"dualwinch {words}, simulate() whole", compiled.prepare_simulate, preferred),
        ]
    rows += [
        Peer(
            f"batch-{threads}",
            f"dualwinch {default.integrator}, batch of {batch.ROLLOUTS} on {threads} thread{'s' * (threads > 1)}",
            batch.prepare_with(threads),
            preferred,
            rollouts=batch.ROLLOUTS,
        )
        for threads in sorted({1, cores()})
    ]
    return rows
