"""Run several controllers in the same scenarios of an ensemble, so that their differences are the controllers' own."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from dualwinch.controllers.controller import Controller
from dualwinch.controllers.estimators.unfiltered import Unfiltered
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.batch.portions import in_portions, portion_size
from dualwinch.simulation.batch.rollout import BatchResult, rollout
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.ensemble import Ensemble, Scenario
from dualwinch.simulation.ensembles.paired import Comparison, Contender


def paper_controller() -> Controller:
    """The paper's controller with the paper's gains: it sees the sensors as they are."""
    return Controller(estimator=Unfiltered())


def compare(
    controllers: Mapping[str, Controller],
    ensemble: Ensemble,
    scenarios: int,
    seed: int,
    *,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Comparison:
    """Run every controller in every scenario (common random numbers).

    A controller brings its position law, gains, estimator, coordination and preload, and what it believes of the
    plant where `controller.nominal` says so. All else comes from the ensemble: the drawn plant, sea, sensors and
    their noise are the same numbers for all. Scenarios are drawn and run in portions, so memory grows by a hundred
    bytes a run only.

    Args:
        controllers: name → controller; the first is what the others are compared with.
        ensemble: what the scenarios are drawn from; its own controller is not used.
        scenarios: how many.
        seed: of the draws, and of the resampling behind the intervals.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Returns:
        The comparison. An interrupt (Ctrl-C) keeps the portions that all controllers have finished.

    Raises:
        ConfigurationError: nothing to compare, a count or seed out of range, an ensemble that draws the controller's
            own values, or a controller that does not fit; the message names it.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: before the first portion was finished.
    """
    if not controllers:
        raise ConfigurationError("controllers: must be at least one")
    if scenarios < 1:
        raise ConfigurationError(f"scenarios = {scenarios}: must be a whole number >= 1")
    if seed < 0:
        raise ConfigurationError(f"seed = {seed}: must be a whole number >= 0")
    drawn = {name: _with_controller(ensemble, name, controller) for name, controller in controllers.items()}
    size, threads = portion_size(ensemble.experiment, threads)
    streams = [in_portions(variant.scenarios(scenarios, seed), size) for variant in drawn.values()]
    portions: list[dict[str, BatchResult]] = []
    done = 0
    try:
        for chosen in zip(*streams, strict=True):

            def report(share: float, before: int = done, count: int = len(chosen[0])) -> None:
                if progress:
                    progress((before + share * count) / scenarios)

            portions.append(_run_portion(dict(zip(drawn, chosen, strict=True)), threads, report))
            done += len(chosen[0])
    except KeyboardInterrupt:
        if not portions:
            raise
    contenders = {
        name: _gathered(controller, [part[name] for part in portions]) for name, controller in controllers.items()
    }
    return Comparison(ensemble, seed, scenarios, contenders)


def _run_portion(
    chosen: Mapping[str, list[Scenario]], threads: int, report: Callable[[float], None]
) -> dict[str, BatchResult]:
    """The next scenarios by every controller, or an interrupt: pairs need all of them."""
    results: dict[str, BatchResult] = {}
    for number, (name, scenarios) in enumerate(chosen.items()):

        def say(share: float, before: int = number) -> None:
            report((before + share) / len(chosen))

        results[name] = rollout([], np.empty((1, 0)), scenarios, threads=threads, progress=say)
        if results[name].interrupted:
            raise KeyboardInterrupt
    return results


def _with_controller(ensemble: Ensemble, name: str, controller: Controller) -> Ensemble:
    for key in ensemble.distributions:
        if key.startswith("controller."):
            raise ConfigurationError(
                f"{key}: is drawn in the ensemble '{ensemble.name}'; a comparison needs the controllers as they are"
            )
    experiment = replace(ensemble.experiment, controller=controller)
    try:
        check(experiment)
    except ConfigurationError as error:
        raise ConfigurationError(f"{name}: {error}") from error
    return replace(ensemble, experiment=experiment)


def _gathered(controller: Controller, parts: list[BatchResult]) -> Contender:
    metrics = {name: np.concatenate([part.metrics[name][0] for part in parts]) for name in parts[0].metrics}
    return Contender(controller, np.concatenate([part.outcomes[0] for part in parts]), metrics)
