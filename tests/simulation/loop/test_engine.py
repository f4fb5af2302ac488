"""The compiled loop, that of CasADi's code generator and CasADi's interpreter run the same step."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from dualwinch.codegen.drivers import rollout
from dualwinch.controllers.controller import Controller
from dualwinch.controllers.laws.auxiliary import AuxiliaryGains
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.controllers.nominal import Nominal
from dualwinch.controllers.registry import COORDINATIONS, ESTIMATORS, POSITION_LAWS
from dualwinch.model.plant import Plant
from dualwinch.model.reference import Reference
from dualwinch.model.ropes import Rope, Track
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import ENGINES, Experiment, Simulation
from dualwinch.simulation.integrators import INTEGRATORS
from dualwinch.simulation.loop.closed_loop import ClosedLoop, closed_loop, initial_state_of
from dualwinch.simulation.loop.engine import Engine, engine_of
from dualwinch.simulation.loop.structure import parameters_of, structure_of
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.own_ropes import Bedding, Stiffening
from tests.tiers import choice_of_pairs, each_choice
from tests.tolerances import close

Array = NDArray[np.float64]


def vectors(experiment: Experiment) -> tuple[ClosedLoop, Array, Array, Array]:
    """Closed loop, parameters, exogenous signals and initial state of an experiment."""
    parameters = np.array(list(parameters_of(experiment).values()))
    state = np.array(list(initial_state_of(experiment).values()))
    return closed_loop(structure_of(experiment)), parameters, exogenous_signals(experiment), state


def along(
    run: Engine, parameters: Array, exogenous: Array, start: Array, samples: Iterable[int]
) -> Iterator[tuple[int, Array]]:
    """The states of a run at some samples."""
    state, reached = start.copy(), 0
    for sample in sorted(samples):
        run(parameters, exogenous[reached:sample], state, 0)
        reached = sample
        yield sample, state.copy()


@pytest.mark.parametrize(("kind", "number"), each_choice(POSITION_LAWS, [3, 4]))
def test_one_step_from_the_same_state_agrees(kind: str, number: int) -> None:
    """From states all along a run, the first samples with their slack rope among them.

    Relative to the largest values in these samples: compiled code contracts products, which shifts a stretch, the
    difference of 50 m of drum and vehicle travel, by their rounding of 1e-14 m. A winch's tension error and its
    integral are relative to the largest tension.
    """
    loop, parameters, exogenous, start = vectors(case(number, kind))
    compiled, interpreted = engine_of(loop, "compiled"), engine_of(loop, "interpreter")
    anywhere = np.random.default_rng(3).integers(20, len(exogenous) - 1, 40)
    pairs: list[tuple[Array, Array]] = []
    for sample, state in along(engine_of(loop), parameters, exogenous, start, (*range(20), *anywhere.tolist())):
        ours, theirs, now = state.copy(), state.copy(), exogenous[sample : sample + 1]
        _, _, our_row = compiled(parameters, now, ours, 1)
        _, _, their_row = interpreted(parameters, now, theirs, 1)
        pairs.append((np.append(ours, our_row), np.append(theirs, their_row)))
    ours, theirs = np.array(pairs).swapaxes(0, 1)
    largest = dict(zip((*loop.states, *loop.columns), np.abs(theirs).max(axis=0).tolist(), strict=True))
    scales = [max(value, largest["F1"] * (".winch_" in name)) for name, value in largest.items()]
    assert (np.abs(ours - theirs) <= 1e-11 * np.array(scales)).all()


def test_one_step_updates_are_close_to_careful_moves_and_never_over_a_loose_rope() -> None:
    """Nearly all samples are one step; not the first milliseconds, while rope 2 hangs loose."""
    loop, parameters, exogenous, state = vectors(case(3))
    assert loop.one_step is not None
    updates, moving = 0, loop.move.numel_in("motion")
    for sample in range(300):
        discrete, hold = loop.sample(state, exogenous[sample], parameters)
        row = np.array(loop.observe(state, exogenous[sample], parameters)).ravel()
        moved = state[:moving]
        for part in range(loop.parts):
            moved = np.array(loop.move(moved, hold, part, parameters)[0]).ravel()
        quick, _, valid = (np.array(output).ravel() for output in loop.one_step(state[:moving], hold, parameters))
        if valid[0] > 0:
            updates += 1
            assert np.abs(quick - moved)[:2].max() < 1e-6, f"at sample {sample}"
        loose = row[loop.columns.index("F2")] == 0
        assert not (loose and valid[0] > 0), f"at sample {sample}"
        state = np.concatenate([quick if valid[0] > 0 else moved, np.array(discrete).ravel()])
    assert 200 < updates < 295


@pytest.mark.parametrize("kind", POSITION_LAWS)
def test_trajectories_agree(kind: str) -> None:
    experiment = replace(case(3, kind), simulation=Simulation(duration=4.0))
    ours, theirs = simulate(experiment), simulate(experiment, engine="interpreter")
    assert np.abs(ours["x"] - theirs["x"]).max() <= 1e-9
    assert ours.metrics.mse == pytest.approx(theirs.metrics.mse, rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("stride", [1, 7, 100, 2000])
def test_a_stride_keeps_every_so_many_rows_and_changes_nothing_else(engine: Any, stride: int) -> None:
    experiment = replace(case(4), simulation=Simulation(duration=1.0))
    full, thin = simulate(experiment), simulate(experiment, stride=stride, engine=engine)
    for name, column in full.columns.items():
        assert close(thin[name], column[::stride], rel=1e-9, abs=1e-12), name
    assert thin.metrics.mse == pytest.approx(full.metrics.mse, rel=1e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_stride_of_zero_keeps_no_rows(engine: Any) -> None:
    experiment = replace(case(4), simulation=Simulation(duration=0.5))
    result = simulate(experiment, stride=0, engine=engine)
    assert len(result["t"]) == 0
    assert result.metrics.mae > 0


RUNAWAY = Experiment(
    plant=Plant(track=Track(length=2.0)),
    controller=Controller(law=Nftsm(), nominal=Nominal(friction_coefficient=5.0)),
    reference=Reference(kind="uniform", speed=0.1),
    simulation=Simulation(duration=19.0),
)
"""The controller assumes fifty times the friction and makes up for it: the vehicle races off the track."""

EXPLODING = replace(
    case(1),
    controller=Controller(law=FandoNftsm(auxiliary=AuxiliaryGains(k_a=2e6))),
    simulation=Simulation(duration=2.0),
)
"""The anti-saturation state's own Euler step is unstable."""


@pytest.mark.parametrize("engine", ENGINES)
def test_an_experiment_says_its_engine_unless_the_call_says_another(engine: Any) -> None:
    plain = override(case(4), {"simulation.duration": 0.3})
    asking = override(plain, {"simulation.engine": engine})
    apart = dict(zip(ENGINES, (simulate(plain, engine=name)["x"] for name in ENGINES), strict=True))
    assert np.array_equal(simulate(asking)["x"], apart[engine])
    for other in ENGINES:
        assert np.array_equal(simulate(asking, engine=other)["x"], apart[other])
    assert not np.array_equal(apart["compiled"], apart["interpreter"])  # last bits, which tell the engines apart


def all_engines(experiment: Experiment) -> list[Result]:
    return [simulate(experiment, engine=engine) for engine in ENGINES]


@pytest.mark.parametrize(("experiment", "outcome"), [(RUNAWAY, "left_track"), (EXPLODING, "diverged")])
def test_early_ends_are_the_same_in_all_engines(experiment: Experiment, outcome: str) -> None:
    results = all_engines(experiment)
    *_, theirs = results
    for result in results:
        assert result.outcome == theirs.outcome == outcome
        assert result.end_time == theirs.end_time < experiment.duration
        assert len(result["t"]) == len(theirs["t"]) == round(result.end_time / 1e-3)
        assert result["x"] == pytest.approx(theirs["x"], abs=1e-9)
        assert np.isnan(list(vars(result.metrics).values())).all()


ROPES = (Rope, Stiffening, Bedding)


@pytest.mark.parametrize(
    ("law", "estimator", "coordination", "rope"),
    choice_of_pairs([*POSITION_LAWS], [*ESTIMATORS], [*COORDINATIONS], [*ROPES]),
)
def test_three_engines_agree(
    law: str, estimator: str, coordination: str, rope: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over half a second with its slack rope, within 1e-9 of the largest value of each column.

    CasADi's C, in which nothing is contracted, has the same bits without any optimisation, which takes ten times as
    long to compile.

    The emitter rewrites and contracts products, which moves last bits; laws that switch amplify them. An estimated
    scale of a drum, or excess of a rope, is an error of 2e-3 or more that is 0 on these exact machines.
    """
    controller = Controller(ESTIMATORS[estimator](), POSITION_LAWS[law](), coordination=COORDINATIONS[coordination]())
    simulation = Simulation(duration=0.5)
    experiment = replace(case(4, rope=rope()), controller=controller, simulation=simulation)
    monkeypatch.setattr(rollout, "CASADI_FLAGS", (*rollout.CASADI_FLAGS, "-O0"))
    ours, casadi, interpreted = all_engines(experiment)
    assert ours.outcome == casadi.outcome == interpreted.outcome
    for name, column in interpreted.columns.items():
        scale = max(np.abs(column).max(), np.abs(interpreted["F1"]).max() * (".winch_" in name))
        scale = max(scale, 2e-3 * name.startswith(("scale_", "excess_")))
        for result in (ours, casadi):
            assert np.abs(result[name] - column).max() <= 1e-9 * scale, name


def test_what_casadi_writes_gives_the_bits_of_casadi_s_virtual_machine() -> None:
    """The step without any rewriting: no product is contracted, no division replaced."""
    loop, parameters, exogenous, state = vectors(replace(case(4), simulation=Simulation(duration=0.2)))
    run, compiled = engine_of(loop, "casadi"), state.copy()
    _, _, rows = run(parameters, exogenous, compiled, 1)
    moving = loop.move.numel_in("motion")
    for sample, inputs in enumerate(exogenous):
        row = np.array(loop.observe(state, inputs, parameters)).ravel()
        assert np.array_equal(rows[sample], row, equal_nan=True), f"at sample {sample}"
        discrete, hold = loop.sample(state, inputs, parameters)
        assert loop.one_step is not None
        quick, _, valid = loop.one_step(state[:moving], hold, parameters)
        moved = quick
        if not float(valid) > 0:
            moved = state[:moving]
            for part in range(loop.parts):
                moved = loop.move(moved, hold, part, parameters)[0]
        state = np.concatenate([np.array(moved).ravel(), np.array(discrete).ravel()])
    assert np.array_equal(compiled, state)


def test_the_run_ends_with_the_sample_that_leaves_the_track() -> None:
    result = simulate(RUNAWAY)
    assert result["x"].max() <= 2.25
    assert result.final_state["motion.plant.x"] > 2.25


def test_a_divergence_is_seen_in_the_final_state_only() -> None:
    result = simulate(EXPLODING)
    assert np.isfinite(result["x"]).all()
    assert not np.isfinite(list(result.final_state.values())).all()


@pytest.mark.parametrize(
    ("kind", "integrator"),
    [
        *((kind, Simulation().integrator) for kind in POSITION_LAWS),
        *(("fando-nftsm", integrator) for integrator in INTEGRATORS if integrator != Simulation().integrator),
    ],
)
def test_the_step_has_jacobians_all_along_a_run(kind: str, integrator: Any) -> None:
    experiment = replace(case(3, kind), simulation=Simulation(integrator=integrator))
    loop, parameters, exogenous, start = vectors(experiment)
    blocks = [f"jac:next_state:{name}" for name in ("state", "exogenous", "parameters")]
    jacobian = loop.step.factory("jacobian", loop.step.name_in(), blocks)
    for sample, state in along(engine_of(loop), parameters, exogenous, start, (*range(20), 100, 1000, 10_000, 20_000)):
        for block in jacobian(state, exogenous[sample], parameters):
            assert np.isfinite(np.array(block)).all(), f"at sample {sample}"


def test_a_jacobian_equals_the_difference_quotient() -> None:
    loop, parameters, exogenous, state = vectors(case(4, "pid-cascade"))
    engine_of(loop)(parameters, exogenous[:20_000], state, 0)
    exact = loop.step.factory("jacobian", loop.step.name_in(), ["jac:next_state:state"])
    slopes = np.array(exact(state, exogenous[20_000], parameters))
    x, v = loop.states.index("motion.plant.x"), loop.states.index("motion.plant.v")

    def after(shift: float) -> Array:
        moved = state.copy()
        moved[v] += shift
        return np.array(ca.DM(loop.step(moved, exogenous[20_000], parameters)[0])).ravel()

    quotient = (after(1e-4) - after(-1e-4)) / 2e-4
    assert slopes[x, v] == pytest.approx(quotient[x], rel=1e-6)
    assert slopes[v, v] == pytest.approx(quotient[v], rel=1e-6)


def test_the_same_experiment_gives_the_same_bits() -> None:
    experiment = replace(case(4), simulation=Simulation(duration=1.0))
    first, second = simulate(experiment), simulate(experiment)
    for name, column in first.columns.items():
        assert np.array_equal(column, second[name], equal_nan=True)
