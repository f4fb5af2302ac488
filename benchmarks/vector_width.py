"""What narrower vector registers cost: the kernels built for another processor beside those for this one, in turns.

``python -m benchmarks.vector_width`` builds everything by gcc for ``haswell``, which has AVX2 and no more, and for this
processor, each in a process of its own, and prints ratios of rates (``--write FILE`` puts them between the file's two
marks): batches over the hand-written scalar loop of the
same algorithm on one core, built for the same processor; ensembles over the batch of Case 4; gradients by twelve gains
over plain rollouts. Times are the processor's, the least of all rounds. A last column says whether both gave the same
bits.
"""

import argparse
import os
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.document import markdown, put
from benchmarks.peers.gcc import MARCH
from benchmarks.peers.peer import Peer, Run

RATIOS = (
    ("batch-1", "hand-c-adaptive", "batch of Case 4 over the hand-written loop"),
    ("sea-1", "batch-1", "`sea`, 16 scenarios × 4 candidates, over the batch of Case 4"),
    ("rig-1", "batch-1", "`rig`, likewise"),
    ("sea-kernel", "batch-1", "`sea`, 64 scenarios, over the batch of Case 4"),
    ("rig-kernel", "batch-1", "`rig`, likewise"),
    ("sensitivities", "default", "gradient by 12 gains over a plain rollout"),
)
"""Keys of two of `benchmarks.peers`, and what their rates say."""

KEYS = tuple(dict.fromkeys(key for *pair, _ in RATIOS for key in reversed(pair)))


@dataclass
class Build:
    """The peers in a process of their own, built for one processor.

    Attributes:
        march: that processor, as gcc names it.
        seconds: key → least time of a rollout.
        answers: key → what the peer computed.
    """

    march: str
    process: "subprocess.Popen[str]"
    seconds: dict[str, float] = field(default_factory=dict)
    answers: dict[str, str] = field(default_factory=dict)

    def run(self, key: str) -> None:
        """Run a peer once."""
        to, back = self.process.stdin, self.process.stdout
        if to is None or back is None:
            raise ValueError("process: must have pipes")
        print(key, file=to, flush=True)
        seconds, self.answers[key] = back.readline().split(maxsplit=1)
        self.seconds[key] = min(float(seconds), self.seconds.get(key, float("inf")))


def start(march: str, duration: float) -> Build:
    """Start the process of a build."""
    command = [sys.executable, "-m", "benchmarks.vector_width", "--child", "--duration", str(duration)]
    environment = os.environ | {"DUALWINCH_CC": f"gcc -march={march}", MARCH: march}
    pipe = subprocess.PIPE
    return Build(march, subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True))


def answer(duration: float) -> None:
    """Run the peers whose keys arrive, and answer with the time of a rollout and its figures of merit."""
    from benchmarks.peers import peers

    rows: dict[str, Peer] = {peer.key: peer for peer in peers(duration)}
    runs: dict[str, Run] = {}
    for line in sys.stdin:
        key = line.strip()
        peer = rows[key]
        if key not in runs:
            runs[key] = peer.prepare(peer.case)
            runs[key]()
        began = time.process_time()
        found = runs[key]()
        print((time.process_time() - began) / peer.rollouts, found.metrics, flush=True)


def table(builds: list[Build]) -> str:
    """The ratios of all builds, as a Markdown table."""
    rows = []
    for key, base, words in RATIOS:
        ratios = [f"{build.seconds[base] / build.seconds[key]:.2f} ×" for build in builds]
        same = len({build.answers[key] for build in builds}) == 1
        rows.append([words, *ratios, "yes" if same else "no"])
    return markdown(["rate", *(build.march for build in builds), "same figures of merit"], rows)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--march", default="haswell", metavar="NAME", help="the other processor (haswell)")
    parser.add_argument("--rounds", type=int, default=15, metavar="N", help="number of interleaved rounds (15)")
    parser.add_argument("--duration", type=float, default=50.0, metavar="S", help="simulated time (50 s)")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.child:
        answer(chosen.duration)
        return 0
    builds = [start(march, chosen.duration) for march in (chosen.march, "native")]
    for _ in range(chosen.rounds):
        for key in KEYS:
            for build in builds:
                build.run(key)
    for build in builds:
        build.process.communicate()
    text = table(builds)
    print(text)
    if chosen.write:
        put(chosen.write, "vector width", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
