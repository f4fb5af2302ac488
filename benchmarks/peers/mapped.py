"""CasADi's `map` over candidates of the compiled `mapaccum` of some samples, on threads; called piece after piece.

In pieces, because a `mapaccum` gives every state in between: of all samples and candidates that would be gigabytes.
"""

from collections.abc import Callable

import casadi as ca
import numpy as np

from benchmarks.case import Case
from benchmarks.peers import gcc
from benchmarks.peers.candidates import GAIN, gains
from benchmarks.peers.peer import Answer, Run, closed_loop_answer
from dualwinch.simulation.metrics.metrics import metrics_of

LONGEST = 1000
"""Most samples of a piece."""


def _piece(case: Case, samples: int) -> ca.Function:
    """``(state, exogenous, parameters) -> (state at the end, positions)``, compiled by gcc."""
    full = case.loop.step
    inputs = [ca.SX.sym(name, full.size1_in(name)) for name in full.name_in()]
    step = ca.Function("sample", inputs, full.call(inputs)[:1], full.name_in(), ["next_state"], {"cse": True})
    state, exogenous = ca.MX.sym("state", step.size1_in(0)), ca.MX.sym("exogenous", step.size1_in(1), samples)
    parameters = ca.MX.sym("parameters", step.size1_in(2))
    states = step.mapaccum("samples", samples).call([state, exogenous, ca.repmat(parameters, 1, samples)])[0]
    piece = ca.Function("piece", [state, exogenous, parameters], [states[:, -1], states[0, :]])
    generator = ca.CodeGenerator("piece.c")
    generator.add(piece)
    folder = gcc.workplace()
    generator.generate(f"{folder}/")
    return ca.external("piece", str(gcc.build(folder / "piece.c")))


def prepare_with(threads: int) -> Callable[[Case], Run]:
    """Rollouts on some threads."""

    def prepare(case: Case) -> Run:
        gcc.find()
        values = gains(case)
        samples = next(n for n in range(min(LONGEST, case.samples), 0, -1) if case.samples % n == 0)
        batch = _piece(case, samples).map(
            "batch", "thread" if threads > 1 else "serial", len(values), [1], [], {"max_num_threads": threads}
        )
        parameters = np.repeat(case.parameters[:, None], len(values), axis=1)
        parameters[case.loop.parameters.index(GAIN)] = values
        given = ca.DM(parameters)
        pieces = [ca.DM(case.exogenous[start : start + samples].T) for start in range(0, case.samples, samples)]

        def run(*, keep: bool = False) -> Answer:
            state, positions = ca.DM(np.repeat(case.start[:, None], len(values), axis=1)), []
            for piece in pieces:
                state, x = batch(state, piece, given)
                if keep:
                    positions.append(np.array(x)[0, :samples])
            final = np.array(state)
            named = [dict(zip(case.loop.states, column.tolist(), strict=True)) for column in final.T]
            errors = np.array([metrics_of(state).mse for state in named])
            own = closed_loop_answer(case, final[:, 0], np.concatenate(positions) if keep else None)
            return Answer(own.x, own.metrics, own.positions, errors)

        return run

    return prepare
