"""Make every imperfection larger until gains break, and find out at which size that is."""

import math
from collections.abc import Callable, Mapping, Sequence

from dualwinch.controllers.controller import Controller
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.check import check
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.tuning.constraint import Constraint
from dualwinch.tuning.stress.bench import Bench
from dualwinch.tuning.stress.found import Break, Row
from dualwinch.tuning.stress.imperfection import ALL, Imperfection, all_together, imperfections, union
from dualwinch.tuning.stress.ladder import STEPS, Search, size
from dualwinch.tuning.stress.limits import Broken, Limit, broken, limits_of
from dualwinch.tuning.stress.reach import Reach, reach_of, reach_together, sizes_at
from dualwinch.tuning.stress.result import Stress
from dualwinch.tuning.stress.scaling import Scaling

PAPER = "paper"
"""Name of the yardstick: the paper's gains."""

HALVINGS = int(math.log2(STEPS))
"""Rounds of a search behind its ladder."""


def stress(
    controllers: Mapping[str, Controller],
    base: Ensemble,
    ensemble: Ensemble,
    constraints: Sequence[Constraint],
    *,
    scenarios: int,
    seed: int,
    threads: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Stress:
    """Find what breaks first.

    Each imperfection that the ensemble has and the base does not is made larger, alone and with all the others, until a
    constraint is broken in the scenarios: the same ones, with the same quantiles of every distribution, at every size
    and for all gains. Everything else is the base's.

    Args:
        controllers: name → controller, that with the paper's gains (`PAPER`) among them.
        base: what the imperfections come on top of; its own controller is not used.
        ensemble: gives the imperfections, at size 1.
        constraints: what must be kept to; factors are on what the paper's gains reach in the base.
        scenarios: how many.
        seed: of the draws.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Raises:
        ConfigurationError: no imperfection, a count or seed out of range, or a controller that does not fit.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    for word, value, least in (("scenarios", scenarios, 1), ("seed", seed, 0)):
        if value < least:
            raise ConfigurationError(f"{word} = {value}: must be a whole number >= {least}")
    ensemble = union(base, ensemble)
    scaling = Scaling(base, ensemble, imperfections(base, ensemble), scenarios, seed)
    for name, controller in controllers.items():
        _check(scaling, name, controller)
    single = {imperfection: reach_of(scaling, imperfection) for imperfection in scaling.single}
    reaches = single | ({all_together(scaling.single): reach_together(scaling, single)} if len(single) > 1 else {})
    sizes = sum(len(reach.rungs) + HALVINGS for reach in reaches.values())
    bench = Bench(scaling, len(controllers) * (1 + sizes), threads, progress)

    def sizes_of(imperfection: Imperfection, rung: int) -> dict[str, float]:
        return sizes_at(rung, single if imperfection.name == ALL else {imperfection: reaches[imperfection]})

    tried = [sizes_of(imperfection, rung) for imperfection, reach in reaches.items() for rung in reach.rungs]
    bench.compile(controllers.values(), [{}, *tried])
    plain = {name: bench.run(controller, [{}])[0] for name, controller in controllers.items()}
    limits = {name: limits_of(constraints, plain[PAPER], runs) for name, runs in plain.items()}
    lost = {name: broken((), runs) for name, runs in plain.items()}
    found = {
        name: _breaks(bench, controller, limits[name], reaches, sizes_of)
        for name, controller in controllers.items()
        if not lost[name]
    }
    rows = [
        Row(imperfection, reach, {name: breaks[imperfection] for name, breaks in found.items()})
        for imperfection, reach in reaches.items()
    ]
    if progress:
        progress(1.0)
    return Stress(scaling, dict(controllers), limits, lost, tuple(rows))


def _check(scaling: Scaling, name: str, controller: Controller) -> None:
    try:
        check(scaling.scenario(0, controller, {}).experiment)
    except ConfigurationError as error:
        raise ConfigurationError(f"{name}: {error}") from error


def _breaks(
    bench: Bench,
    controller: Controller,
    limits: Sequence[Limit],
    reaches: Mapping[Imperfection, Reach],
    sizes_of: Callable[[Imperfection, int], dict[str, float]],
) -> dict[Imperfection, Break]:
    """Search under all imperfections at once: each round is one batch."""
    searches = {imperfection: Search(reach.bottom, reach.top) for imperfection, reach in reaches.items()}
    found: dict[tuple[Imperfection, int], tuple[Broken, ...]] = {}
    while wanted := [(imperfection, rung) for imperfection, search in searches.items() for rung in search.wanted()]:
        sizes = [sizes_of(imperfection, rung) for imperfection, rung in wanted]
        for (imperfection, rung), runs in zip(wanted, bench.run(controller, sizes), strict=True):
            found[imperfection, rung] = broken(limits, runs)
            searches[imperfection].tried[rung] = bool(found[imperfection, rung])
    return {
        imperfection: Break(
            size=None if search.broken is None else size(search.broken),
            held=0.0 if search.held is None else size(search.held),
            broken=() if search.broken is None else found[imperfection, search.broken],
            monotone=search.monotone,
        )
        for imperfection, search in searches.items()
    }
