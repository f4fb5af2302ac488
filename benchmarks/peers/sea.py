"""dualwinch in the sea: noisy sensors, drawn plants, Kalman filter; scenarios × candidates in one batch."""

from collections.abc import Callable

import numpy as np

from benchmarks.case import Case
from benchmarks.peers.candidates import GAIN, ROLLOUTS, gains
from benchmarks.peers.peer import Answer, Run, UnavailableError
from dualwinch.codegen import CompilerNotFoundError
from dualwinch.codegen.drivers.batch import LANES
from dualwinch.config.ensemble_file import load_ensemble, reset
from dualwinch.simulation.batch.rollout import rollout
from dualwinch.simulation.ensembles.ensemble import Scenario
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.metrics.metrics import Metrics
from dualwinch.simulation.simulate import simulate

SEED = 7
"""Of the draws."""


def _scenarios(case: Case) -> list[Scenario]:
    return list(_ensemble(case).scenarios(LANES, SEED))


def _ensemble(case: Case):
    values = {"controller.estimator": "kalman", "simulation.duration": case.duration}
    return reset(load_ensemble("sea"), values | {"simulation.integrator": case.integrator})


def scenario_alone(case: Case) -> Answer:
    """The first scenario by the scalar rollout: what the batch is checked against."""
    scenario = _scenarios(case)[0]
    result = simulate(scenario.experiment, nominal=scenario.nominal)
    return Answer(float(result["x"][-1]), result.metrics, result["x"])


def prepare_with(threads: int) -> Callable[[Case], Run]:
    """16 scenarios × 4 candidates on some threads, the signals drawn as it goes, once for all candidates in a block."""

    def prepare(case: Case) -> Run:
        scenarios = _scenarios(case)
        candidates = gains(case)[: ROLLOUTS // LANES, None]
        try:
            rollout([GAIN], candidates, scenarios)
        except CompilerNotFoundError as error:
            raise UnavailableError(str(error)) from error

        def run(*, keep: bool = False) -> Answer:
            if not keep:
                result = rollout([GAIN], candidates, scenarios, threads=threads)
                return Answer(np.nan, _metrics(result.metrics))
            result = rollout([GAIN], candidates[:1], scenarios, stride=1, threads=threads)
            x = result.columns["x"][0, 0]
            return Answer(float(x[-1]), _metrics(result.metrics), x)

        return run

    return prepare


def prepare_ensemble_with(threads: int) -> Callable[[Case], Run]:
    """`run_ensemble` on some threads: scenarios and signals are drawn as it goes."""

    def prepare(case: Case) -> Run:
        ensemble, check = _ensemble(case), prepare_with(threads)(case)

        def run(*, keep: bool = False) -> Answer:
            if keep:
                return check(keep=True)
            seeds.append(seeds[-1] + 1)
            run_ensemble(ensemble, ROLLOUTS, seeds[-1], traces=False, workers=threads)
            return Answer(np.nan, check_metrics)

        seeds, check_metrics = [SEED], check(keep=True).metrics
        return run

    return prepare


def _metrics(tables: dict[str, np.ndarray]) -> Metrics:
    return Metrics(**{name: float(table[0, 0]) for name, table in tables.items()})
