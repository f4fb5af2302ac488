"""The same step in CasADi's interpreter, called from Python sample by sample with arrays: the usual way."""

import numpy as np

from benchmarks.case import Case
from benchmarks.peers.peer import Answer, Run, closed_loop_answer


def prepare(case: Case) -> Run:
    """Each call takes the state as the DM the last one returned, this sample's inputs as a NumPy array."""
    step, parameters, exogenous, start = case.loop.step, case.parameters, case.exogenous, case.start

    def run(*, keep: bool = False) -> Answer:
        positions = np.empty(len(exogenous)) if keep else None
        state = start
        for k, outside in enumerate(exogenous):
            state, _, _ = step(state, outside, parameters)
            if positions is not None:
                positions[k] = state[0]
        return closed_loop_answer(case, np.array(state).ravel(), positions)

    return run
