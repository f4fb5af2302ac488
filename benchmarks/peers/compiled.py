"""dualwinch: the whole rollout by one of its engines; in generated C, one call."""

from benchmarks.case import Case
from benchmarks.peers.peer import Answer, Run, UnavailableError, closed_loop_answer
from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.simulation.experiment import EngineName
from dualwinch.simulation.loop.engine import engine_of
from dualwinch.simulation.simulate import simulate


def prepare_call(case: Case, engine: EngineName = "compiled") -> Run:
    """The call of an engine alone, its inputs at hand (the reference and the noise are drawn ahead of it)."""
    try:
        rollout = engine_of(case.loop, engine)
    except CompilerNotFoundError as error:
        raise UnavailableError(str(error)) from error
    parameters, exogenous, start = case.parameters, case.exogenous, case.start
    x = case.loop.columns.index("x")

    def run(*, keep: bool = False) -> Answer:
        state = start.copy()
        _, _, rows = rollout(parameters, exogenous, state, 1 if keep else 0)
        answer = closed_loop_answer(case, state)
        if keep:
            rows[:-1, x] = rows[1:, x]
            rows[-1, x] = answer.x
        return Answer(answer.x, answer.metrics, rows[:, x].copy() if keep else None)

    return run


def prepare_simulate(case: Case) -> Run:
    """`simulate` from an experiment to a result: with checks, reference, parameters and metrics in Python."""
    experiment = case.experiment
    prepare_call(case)

    def run(*, keep: bool = False) -> Answer:
        result = simulate(experiment, stride=1 if keep else 0)
        x = result.final_state["motion.plant.x"]
        positions = None
        if keep:
            positions = result["x"].copy()
            positions[:-1] = positions[1:]
            positions[-1] = x
        return Answer(x, result.metrics, positions)

    return run
