"""Write tables and sentences of README and documents that rest on runs.

``python -m benchmarks.quoted --list`` names the blocks, ``python -m benchmarks.quoted machine ensembles`` runs what
those of some pages need and writes them between their marks. Without a name: every block that takes seconds.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.document import put
from benchmarks.quoted import heavy, identified, paper_gains, sea, served, tuned


@dataclass(frozen=True)
class Quoted:
    """A block of a page.

    Attributes:
        page: file that it stands in, from the repository's root.
        mark: name of its two marks there.
        text: makes it.
        minutes: how long that takes on two cores, where it is more than seconds.
    """

    page: str
    mark: str
    text: Callable[[], str]
    minutes: float = 0.0

    @property
    def names(self) -> tuple[str, str]:
        """What selects it: the page's name, and that with the mark."""
        page = Path(self.page).stem.lower()
        return page, f"{page}/{self.mark.replace(' ', '-')}"


BLOCKS = (
    Quoted("README.md", "what reproduces", paper_gains.reproduces),
    Quoted("README.md", "what tuning gains", tuned.tuning, 2),
    Quoted("docs/machine.md", "forces", paper_gains.forces),
    Quoted("docs/stability.md", "modes", paper_gains.modes),
    Quoted("docs/sensitivities.md", "derivatives", paper_gains.derivatives),
    Quoted("docs/stability.md", "conditions", paper_gains.conditions),
    Quoted("docs/stability.md", "nearby gains", paper_gains.nearby),
    Quoted("docs/stability.md", "margins", paper_gains.loop_margins),
    Quoted("docs/stability.md", "amplitudes", paper_gains.amplitudes),
    Quoted("docs/position-laws.md", "laws", paper_gains.laws),
    Quoted("docs/preload.md", "preloads", paper_gains.preload),
    Quoted("docs/position-laws.md", "quality", paper_gains.predictive),
    Quoted("docs/ensembles.md", "laws in the sea", sea.ensemble),
    Quoted("docs/ensembles.md", "speed noise", sea.noise),
    Quoted("docs/rig.md", "tuned in rig", tuned.rig, 8),
    Quoted("docs/stress.md", "breakdown", tuned.breakdown, 2),
    Quoted("docs/stress.md", "heavy machines", tuned.heavy_breakdown, 8),
    Quoted("docs/site.md", "resonance", heavy.resonance),
    Quoted("docs/site.md", "preloads", heavy.preloads, 1),
    Quoted("docs/site.md", "leads", heavy.leads, 1),
    Quoted("docs/commissioning.md", "outage", served.outage),
    Quoted("docs/commissioning.md", "registers", served.registers),
    Quoted("docs/commissioning.md", "clock", served.clock, 3),
    Quoted("docs/identify.md", "alternatives", identified.alternatives),
    Quoted("docs/identify.md", "identified", identified.example, 1),
    Quoted("docs/observability.md", "learnt", tuned.learnt, 5),
)
"""Every block, in the order of the pages."""


def main(words: Sequence[str] | None = None) -> int:
    """List the blocks, or make and write some."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.quoted", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="page, such as rig, or block, such as rig/tuned-in-rig"
    )
    parser.add_argument("--list", action="store_true", help="name the blocks, and run nothing")
    chosen = parser.parse_args(words)
    unknown = set(chosen.names) - {name for block in BLOCKS for name in block.names}
    if unknown:
        parser.error(f"{', '.join(sorted(unknown))}: no such page or block; --list names them")
    for block in BLOCKS:
        if chosen.list:
            print(f"{block.names[1]:40} {f'{block.minutes:g} min' if block.minutes else 'seconds'}")
        elif set(block.names) & set(chosen.names) or not (chosen.names or block.minutes):
            sys.stderr.write(f"{block.page}: {block.mark}\n")
            put(Path(block.page), block.mark, block.text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
