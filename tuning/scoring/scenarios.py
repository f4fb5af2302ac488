"""Which scenarios to tune and to choose in: typical ones for the means, and hard ones for what is the worst.

A few draws as they come are a poor mean: one that asks for nearly all the force there is outweighs the others. So the
draws that stand for all are spread evenly by the force that they ask for.

Gains that hold in a handful of draws need not hold in hundreds. They fail in two ways. Where the reference asks for
more force than the motors can give, the vehicle falls behind and has to recover without a peak and without a slack
rope; how far does not depend on the gains (`simulation.analysis.required_force`). So there are draws that ask for the
most. And where several values of the plant lie at the ends of their ranges, the loop may be unstable. So there are
vertices of the box of draws; those that the motors can hold, for most of the others are far harder than any draw.

In one draw of some hundreds the vehicle falls behind by centimetres. Gains that were tuned without anything of the kind
may end there in kilonewtons, and no draw that comes up in their stead warns of it. So a vertex or two are among the
hard ones where it falls behind as far (`overwhelming`). As all values lie at the ends of their ranges there, tensions
are higher than in any draw, and bounds need not be kept to quite (`tuning.scoring.runs.LEEWAY`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice

from dualwinch.simulation.analysis.required_force import Demand, demand
from dualwinch.simulation.batch.threads import map_all
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.scenario import Scenario
from dualwinch.tuning.scoring.exact import exact

LOOKED_AT = 600
"""Draws that are looked at."""

FURTHEST = 0.01
"""How far in m the vehicle falls behind at most in hard draws. There are few in which it falls behind further."""

BEHIND = (0.025, 0.015, 0.035)
"""How far in m it falls behind in overwhelming vertices: as in the hardest of some hundreds of draws, not further."""

BEYOND_SHARE, VERTEX_SHARE = 1 / 3, 1 / 6
"""Shares of further hard scenarios that are overwhelming vertices, and vertices that the motors can hold.

Which of those that overwhelm are hard is much the same for all good gains, but hardly depends on how far the vehicle
falls behind.
"""


@dataclass(frozen=True)
class Pick:
    """A scenario to be: number `index` of the ensemble's draws, or of the vertices of the box of draws.

    Attributes:
        index: the number.
        vertex: whether it is a vertex.
        hard: whether it counts in what is the worst only.
        overwhelming: whether it is harder than any draw (`overwhelming`).
        exact: whether machine and sensors are without errors (`tuning.scoring.exact`).
    """

    index: int
    vertex: bool = False
    hard: bool = False
    overwhelming: bool = False
    exact: bool = False


def drawn(picks: Sequence[Pick], ensemble: Ensemble, seed: int) -> list[Scenario]:
    """The scenarios of picks, in their order."""
    found: dict[Pick, Scenario] = {}
    for vertex, perfect in ((False, False), (False, True), (True, False)):
        alike = [picked for picked in picks if (picked.vertex, picked.exact) == (vertex, perfect)]
        chosen = ensemble.chosen([picked.index for picked in alike], seed, vertex=vertex)
        chosen = exact(chosen) if perfect else chosen
        marked = (
            replace(scenario, hard=picked.hard, overwhelming=picked.overwhelming)
            for picked, scenario in zip(alike, chosen, strict=True)
        )
        found |= zip(alike, marked, strict=True)
    return [found[picked] for picked in picks]


def pick(ensemble: Ensemble, count: int, more: int, seed: int) -> tuple[list[Pick], list[Pick]]:
    """Scenarios of an ensemble, typical and hard ones in turns.

    Args:
        ensemble: what is drawn from.
        count: how many; half of them hard, of these again half draws and half vertices, the last an overwhelming one.
        more: how many further hard ones: draws, overwhelming vertices and others.
        seed: of the draws.

    Returns:
        The scenarios, and the further hard ones.
    """
    number, few = count // 2, count // 4
    further = round(VERTEX_SHARE * more)
    corners = vertices(ensemble, few + further, seed)
    beyond = overwhelming(ensemble, seed, corners, 1 + round(BEYOND_SHARE * more)) if few else []
    held = few - len(beyond[:1])
    demands = _demands(ensemble.chosen(range(max(LOOKED_AT, count + more)), seed))
    plain = typical(demands, count - number)
    draws = hardest(demands, number + more, {picked.index for picked in plain})
    ours = _in_turns(draws[: number - few], [*corners[:held], *beyond[:1]])
    more_corners = corners[held:][:further]
    more_draws = draws[number - few :][: more - len(beyond[1:]) - len(more_corners)]
    return _in_turns(plain, ours), _in_turns(more_draws, beyond[1:], more_corners)


def _in_turns(*kinds: Sequence[Pick]) -> list[Pick]:
    """One of each kind, again and again, for as long as there are any."""
    longest = max(map(len, kinds), default=0)
    return [kind[place] for place in range(longest) for kind in kinds if place < len(kind)]


def typical(demands: Sequence[Demand], count: int) -> list[Pick]:
    """Draws that stand for all: those in the middle of as many equal shares, by the force that they ask for.

    Two of three are on machines without errors. There gains differ in their own errors alone, and hardly in what a
    filter has to learn; those that are best in the mean of bad machines may be mediocre on a good one.
    """
    order = sorted(range(len(demands)), key=lambda index: demands[index].share)
    middles = (order[int((share + 0.5) / count * len(order))] for share in range(count))
    return [Pick(index, exact=number % 3 > 0) for number, index in enumerate(middles)]


def hardest(demands: Sequence[Demand], count: int, others: set[int]) -> list[Pick]:
    """Draws that ask for the most force, without those too hard (`FURTHEST`) and without some others."""
    waiting = [index for index in range(len(demands)) if index not in others]
    waiting.sort(key=lambda index: (demands[index].shortfall > FURTHEST, -demands[index].share))
    return [Pick(index, hard=True) for index in waiting[:count]]


def demanding(ensemble: Ensemble, count: int, among: range, seed: int) -> list[Pick]:
    """The hardest of some draws, given by their numbers (`hardest`)."""
    demands = _demands(ensemble.chosen(among, seed))
    return [replace(picked, index=among[picked.index]) for picked in hardest(demands, count, set())]


def vertices(ensemble: Ensemble, count: int, seed: int) -> list[Pick]:
    """Vertices of the box of draws: of twice as many the first that the motors can hold, then the least too hard."""
    demands = _demands(ensemble.chosen(range(2 * count), seed, vertex=True))
    order = sorted(range(len(demands)), key=lambda index: demands[index].shortfall)
    return [Pick(index, vertex=True, hard=True) for index in order[:count]]


def overwhelming(ensemble: Ensemble, seed: int, others: Sequence[Pick], count: int = len(BEHIND)) -> list[Pick]:
    """Vertices in which the vehicle falls behind by about `BEHIND` in turns, without some others; fewer if need be."""
    demands = _demands(ensemble.chosen(range(LOOKED_AT), seed, vertex=True))
    taken = {picked.index for picked in others}
    waiting = [index for index, asked in enumerate(demands) if asked.shortfall > FURTHEST and index not in taken]
    found: list[int] = []
    for wanted in islice(cycle(BEHIND), min(count, len(waiting))):
        found.append(min(waiting, key=lambda index: abs(demands[index].shortfall - wanted)))
        waiting.remove(found[-1])
    return [Pick(index, vertex=True, hard=True, overwhelming=True) for index in found]


def choosable(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """The scenarios in which gains are chosen: where the vehicle falls behind by no more than `FURTHEST`.

    Where it falls behind at all, that is most of the error, and hardly depends on gains: such count as hard ones.
    """
    demands = _demands(scenarios)
    kept = [
        replace(scenario, hard=asked.share > 1)
        for scenario, asked in zip(scenarios, demands, strict=True)
        if asked.shortfall <= FURTHEST
    ]
    return kept if any(not scenario.hard for scenario in kept) else list(scenarios)


def _demands(scenarios: Sequence[Scenario]) -> list[Demand]:
    return map_all(lambda scenario: demand(scenario.experiment), scenarios)
