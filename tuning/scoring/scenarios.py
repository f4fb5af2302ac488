"""Which scenarios to tune and to choose in: draws of an ensemble, and corners of it, where gains fail.

Gains that hold in a handful of draws need not hold in hundreds. They fail in two ways. Where several values of the
plant lie at the ends of their ranges, the loop may be unstable. And where the reference asks for more force than the
motors can give, the vehicle falls behind and has to recover without a peak and without a slack rope; how far does not
depend on the gains (`simulation.analysis.required_force`). So half of the corners are some where it
falls behind as far as it does in one draw of some hundreds.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from dualwinch.simulation.analysis.required_force import shortfall
from dualwinch.simulation.batch.jobs import run_all
from dualwinch.simulation.ensembles.ensemble import Ensemble, Scenario

CORNER_SHARE = 0.75
"""Share of the scenarios that are corners. A few draws give a mean; what is the worst takes more."""

LOOKED_AT = 200
"""Corners that are looked at."""

FURTHEST, PROMISED = 0.015, 0.01
"""How far in m the vehicle falls behind at most where gains are tuned, and where they are chosen.

It falls behind further in one draw of some hundreds, and gains that had to hold there would be cautious everywhere.
"""


@dataclass(frozen=True)
class Pick:
    """A scenario to be: number `index` of the ensemble's draws, or of its corners."""

    index: int
    corner: bool = False

    def drawn(self, ensemble: Ensemble, seed: int) -> Scenario:
        """The scenario."""
        return ensemble.scenario(self.index, seed, extreme=self.corner)


def pick(ensemble: Ensemble, count: int, more: int, seed: int) -> tuple[list[Pick], list[Pick]]:
    """Scenarios of an ensemble, draws and corners spread evenly: there are some of each among the first of them.

    Args:
        ensemble: what is drawn from.
        count: how many.
        more: how many further corners.
        seed: of the draws.

    Returns:
        The scenarios, and the further corners.
    """
    number = int(CORNER_SHARE * count)
    plain = [Pick(index) for index in range(count - number)]
    chosen = corners(ensemble, number + more, seed)
    places = [((place + 0.5) / len(sort), one) for sort in (plain, chosen[:number]) for place, one in enumerate(sort)]
    return [one for _, one in sorted(places, key=lambda entry: entry[0])], chosen[number:]


def corners(ensemble: Ensemble, count: int, seed: int, furthest: float = FURTHEST) -> list[Pick]:
    """Corners of an ensemble: the hardest that is not too hard, the first of the others, the next hardest, and so on.

    The first of many are the same ones as those of a few.

    Args:
        ensemble: what is drawn from.
        count: how many.
        seed: of the draws.
        furthest: how far in m the vehicle falls behind, at most.
    """
    behind = _shortfalls([ensemble.scenario(index, seed, extreme=True) for index in range(max(LOOKED_AT, 2 * count))])
    waiting = [index for index, way in enumerate(behind) if way <= furthest]
    waiting += sorted(set(range(len(behind))) - set(waiting), key=lambda index: behind[index])
    found: list[Pick] = []
    while len(found) < count:
        hardest = max(waiting, key=lambda index: (behind[index] <= furthest, behind[index]))
        one = waiting[0] if len(found) % 2 else hardest
        waiting.remove(one)
        found.append(Pick(one, corner=True))
    return found


def promised(scenarios: Sequence[Scenario]) -> list[Scenario]:
    """The scenarios in which gains are chosen: all but those where the vehicle falls behind by more than `PROMISED`."""
    behind = _shortfalls(scenarios)
    return [one for one, way in zip(scenarios, behind, strict=True) if way <= PROMISED] or list(scenarios)


def _shortfalls(scenarios: Sequence[Scenario]) -> list[float]:
    found = [0.0] * len(scenarios)

    def look(place: int) -> None:
        found[place] = shortfall(scenarios[place].experiment)

    if not run_all([lambda place=place: look(place) for place in range(len(scenarios))]):
        raise KeyboardInterrupt
    return found
