"""What the candidates of one call have come to while it goes on."""

from collections.abc import Sequence
from dataclasses import dataclass

from dualwinch.simulation.analysis.worst_margins import WorstMargin
from dualwinch.simulation.batch.rollout import BatchResult
from dualwinch.tuning.scoring.evaluation import Candidate, Evaluation

Margins = dict[str, WorstMargin]
"""Kind of a stability margin → the worst of some machines."""


@dataclass
class Tried:
    """The candidates of a call, and what they have come to so far.

    Attributes:
        candidates: all of them.
        judged: what each came to.
        results: row of a candidate → its runs in what all meet, and in what it has met beyond; without the given up.
        margins: of each candidate.
    """

    candidates: Sequence[Candidate]
    judged: list[Evaluation]
    results: dict[int, BatchResult]
    margins: list[Margins | None]
