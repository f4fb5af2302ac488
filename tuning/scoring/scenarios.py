"""Which scenarios to tune and to choose in: draws of an ensemble, and vertices of the box of draws, where gains fail.

Gains that hold in a handful of draws need not hold in hundreds. They fail in two ways. Where several values of the
plant lie at the ends of their ranges, the loop may be unstable. And where the reference asks for more force than the
motors can give, the vehicle falls behind and has to recover without a peak and without a slack rope; how far does not
depend on the gains (`simulation.analysis.required_force`). So half of the vertices are some where it
falls behind as far as it does in one draw of some hundreds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from dualwinch.simulation.analysis.required_force import shortfall
from dualwinch.simulation.batch.jobs import run_all
from dualwinch.simulation.ensembles.ensemble import Ensemble, Scenario

VERTEX_SHARE = 0.75
"""Share of the scenarios that are vertices. A few draws give a mean; what is the worst takes more."""

LOOKED_AT = 200
"""Vertices that are looked at."""

TUNED_SHORTFALL, CHOSEN_SHORTFALL = 0.015, 0.01
"""How far in m the vehicle falls behind at most where gains are tuned, and where they are chosen.

It falls behind further in one draw of some hundreds, and gains that had to hold there would be cautious everywhere.
"""


@dataclass(frozen=True)
class Pick:
    """A scenario to be: number `index` of the ensemble's draws, or of the vertices of the box of draws."""

    index: int
    vertex: bool = False


def drawn(picks: Sequence[Pick], ensemble: Ensemble, seed: int) -> list[Scenario]:
    """The scenarios of picks, in their order."""
    found: dict[Pick, Scenario] = {}
    for vertex in (False, True):
        alike = [picked for picked in picks if picked.vertex is vertex]
        chosen = ensemble.chosen([picked.index for picked in alike], seed, vertex=vertex)
        found |= zip(alike, chosen, strict=True)
    return [found[picked] for picked in picks]


def pick(ensemble: Ensemble, count: int, more: int, seed: int) -> tuple[list[Pick], list[Pick]]:
    """Scenarios of an ensemble, draws and vertices spread evenly: there are some of each among the first of them.

    Args:
        ensemble: what is drawn from.
        count: how many.
        more: how many further vertices.
        seed: of the draws.

    Returns:
        The scenarios, and the further vertices.
    """
    number = int(VERTEX_SHARE * count)
    plain = [Pick(index) for index in range(count - number)]
    chosen = vertices(ensemble, number + more, seed)
    spread = [
        ((index + 0.5) / len(sort), picked) for sort in (plain, chosen[:number]) for index, picked in enumerate(sort)
    ]
    return [picked for _, picked in sorted(spread, key=lambda entry: entry[0])], chosen[number:]


def vertices(
    ensemble: Ensemble, count: int, seed: int, *, furthest: float = TUNED_SHORTFALL, looked_at: int | None = None
) -> list[Pick]:
    """Vertices of the box of draws: the hardest that is not too hard, the first of the others, the next hardest, ...

    The first of many are the same ones as those of a few.

    Args:
        ensemble: what is drawn from.
        count: how many.
        seed: of the draws.
        furthest: how far in m the vehicle falls behind, at most.
        looked_at: among how many they are chosen, at least twice their number; default: `LOOKED_AT`.
    """
    among = max(LOOKED_AT if looked_at is None else looked_at, 2 * count)
    behind = _shortfalls(ensemble.chosen(range(among), seed, vertex=True))
    waiting = [index for index, way in enumerate(behind) if way <= furthest]
    waiting += sorted(set(range(len(behind))) - set(waiting), key=lambda index: behind[index])
    found: list[Pick] = []
    while len(found) < count:
        hardest = max(waiting, key=lambda index: (behind[index] <= furthest, behind[index]))
        chosen = waiting[0] if len(found) % 2 else hardest
        waiting.remove(chosen)
        found.append(Pick(chosen, vertex=True))
    return found


def choosable(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """The scenarios in which gains are chosen: where the vehicle falls behind by no more than `CHOSEN_SHORTFALL`."""
    behind = _shortfalls(scenarios)
    return [chosen for chosen, way in zip(scenarios, behind, strict=True) if way <= CHOSEN_SHORTFALL] or list(scenarios)


def _shortfalls(scenarios: Sequence[Scenario]) -> list[float]:
    found = [0.0] * len(scenarios)

    def look(index: int) -> None:
        found[index] = shortfall(scenarios[index].experiment)

    if not run_all([lambda index=index: look(index) for index in range(len(scenarios))]):
        raise KeyboardInterrupt
    return found
