"""CasADi's `mapaccum` of the same step, wrapped in named functions: interpreted, or compiled and loaded."""

import casadi as ca
import numpy as np

from benchmarks.case import Case
from benchmarks.peers import gcc
from benchmarks.peers.peer import Answer, Run, closed_loop_answer


def _functions(case: Case) -> dict[bool, ca.Function]:
    """``(state, exogenous, parameters) -> final state``, by whether the positions are a second output."""
    full, n = case.loop.step, case.samples
    inputs = [ca.SX.sym(name, full.size1_in(name)) for name in full.name_in()]
    step = ca.Function("sample", inputs, full.call(inputs)[:1], full.name_in(), ["next_state"], {"cse": True})
    state, exogenous, parameters = (
        ca.MX.sym("state", step.size1_in(0)),
        ca.MX.sym("exogenous", step.size1_in(1), n),
        ca.MX.sym("parameters", step.size1_in(2)),
    )
    states = step.mapaccum("samples", n).call([state, exogenous, ca.repmat(parameters, 1, n)])[0]
    arguments = [state, exogenous, parameters]
    return {
        False: ca.Function("final", arguments, [states[:, -1]], full.name_in(), ["last"]),
        True: ca.Function("kept", arguments, [states[:, -1], states[0, :]], full.name_in(), ["last", "x"]),
    }


def _run(case: Case, functions: dict[bool, ca.Function]) -> Run:
    arguments = [ca.DM(case.start), ca.DM(case.exogenous.T), ca.DM(case.parameters)]

    def run(*, keep: bool = False) -> Answer:
        final, *kept = functions[keep].call(arguments)
        return closed_loop_answer(case, np.array(final).ravel(), np.array(kept[0]).ravel() if keep else None)

    return run


def prepare_interpreted(case: Case) -> Run:
    """In CasADi's interpreter, one call a rollout."""
    return _run(case, _functions(case))


def prepare_compiled(case: Case) -> Run:
    """Generated C, compiled by gcc and loaded with `casadi.external`, one call a rollout."""
    gcc.find()
    generator = ca.CodeGenerator("mapaccum.c")
    for function in _functions(case).values():
        generator.add(function)
    folder = gcc.workplace()
    generator.generate(f"{folder}/")
    library = str(gcc.build(folder / "mapaccum.c"))
    return _run(case, {False: ca.external("final", library), True: ca.external("kept", library)})
