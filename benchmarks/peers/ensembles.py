"""dualwinch in an ensemble: noisy sensors, drawn plants, Kalman filter; scenarios × candidates in one batch."""

from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.case import Case
from benchmarks.peers.candidates import GAIN, ROLLOUTS, gains
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch.codegen.drivers.batch import LANES, compile_batch
from dualwinch.codegen.errors import CompilerNotFoundError
from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.simulation.batch.rollout import ParameterScenarioGrid, rollout
from dualwinch.simulation.batch.workers import run_all
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.metrics.metrics import Metrics
from dualwinch.simulation.scenario import Scenario
from dualwinch.simulation.simulate import simulate

SEED = 7
"""Of the draws."""


def ensemble_of(name: str, case: Case) -> Ensemble:
    """An ensemble with a Kalman filter, as long as a case and with its method."""
    values = {"controller.estimator": "kalman", "simulation.duration": case.duration}
    return reset(load_ensemble(name), values | {"simulation.integrator": case.integrator})


def scenario_alone(name: str) -> Callable[[Case], Answer]:
    """The first scenario by the scalar rollout: what the batch is checked against."""

    def answer(case: Case) -> Answer:
        scenario = ensemble_of(name, case).scenario(0, SEED)
        result = simulate(scenario.experiment, nominal=scenario.nominal)
        return Answer(float(result["x"][-1]), result.metrics, result["x"])

    return answer


def prepare_with(name: str, threads: int) -> Callable[[Case], Run]:
    """16 scenarios × 4 candidates on some threads, the signals drawn as it goes, once for all candidates in a block."""

    def prepare(case: Case) -> Run:
        scenarios = ensemble_of(name, case).chosen(range(LANES), SEED)
        candidates = gains(case)[: ROLLOUTS // LANES, None]
        try:
            rollout([GAIN], candidates, scenarios)
        except CompilerNotFoundError as error:
            raise UnavailableError(str(error)) from error

        def run(*, keep: bool = False) -> Answer:
            if not keep:
                result = rollout([GAIN], candidates, scenarios, workers=threads)
                return Answer(np.nan, _metrics(result.metrics))
            result = rollout([GAIN], candidates[:1], scenarios, stride=1, workers=threads)
            x = result.columns["x"][0, 0]
            return Answer(float(x[-1]), _metrics(result.metrics), x)

        return run

    return prepare


def prepare_ensemble_with(name: str, threads: int) -> Callable[[Case], Run]:
    """`run_ensemble` on some threads: scenarios and signals are drawn as it goes."""

    def prepare(case: Case) -> Run:
        ensemble, check = ensemble_of(name, case), prepare_with(name, threads)(case)

        def run(*, keep: bool = False) -> Answer:
            if keep:
                return check(keep=True)
            seeds.append(seeds[-1] + 1)
            run_ensemble(ensemble, ROLLOUTS, seeds[-1], traces=False, workers=threads)
            return Answer(np.nan, check_metrics)

        seeds, check_metrics = [SEED], check(keep=True).metrics
        return run

    return prepare


def prepare_kernel_with(name: str, threads: int) -> Callable[[Case], Run]:
    """What of `run_ensemble` is compiled code: 64 scenarios made ready, their signals drawn as it goes."""

    def prepare(case: Case) -> Run:
        ensemble, check = ensemble_of(name, case), prepare_with(name, threads)(case)
        call, check_metrics = kernel(ensemble.chosen(range(ROLLOUTS), SEED), threads), check(keep=True).metrics

        def run(*, keep: bool = False) -> Answer:
            if keep:
                return check(keep=True)
            call()
            return Answer(np.nan, check_metrics)

        return run

    return prepare


def kernel(scenarios: list[Scenario], threads: int) -> Callable[[], object]:
    """A call of the compiled code alone for some scenarios, on some threads."""
    pairs = ParameterScenarioGrid([], np.empty((1, 0)), scenarios)
    run, jobs = compile_batch(pairs.loop), []
    for first in range(0, len(scenarios), LANES):
        chosen = np.resize(pairs.indices[first : first + LANES], (LANES, 2))
        vectors = pairs.vectors(chosen)
        ready = vectors, pairs.sources(chosen[:, 1].tolist()), pairs.starts(vectors, chosen[:, 1])
        jobs.append(partial(_block, run, ready, pairs.shared.samples))
    return partial(run_all, jobs, threads)


def _block(run: Callable[..., object], ready: tuple, samples: int) -> None:
    vectors, sources, state = ready
    run(vectors, sources, state.copy(), samples)


def _metrics(tables: dict[str, np.ndarray]) -> Metrics:
    return Metrics(**{name: float(table[0, 0]) for name, table in tables.items()})
