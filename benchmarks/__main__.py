"""Time one rollout of the paper's Case 4 by every peer, in turn, and print the table."""

import argparse
import sys
from pathlib import Path


def main() -> int:
    """Run the command line; 0 done, 1 where a peer's answer differs or dualwinch cannot run."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="5 rounds instead of 21, slow peers in 1 of them")
    parser.add_argument("--rounds", type=int, metavar="N", help="number of interleaved rounds")
    parser.add_argument("--duration", type=float, default=50.0, metavar="S", help="simulated time (50 s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every measured time to a file")
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the table between the two marks of a document")
    chosen = parser.parse_args()
    rounds = chosen.rounds if chosen.rounds is not None else 5 if chosen.quick else 21
    if rounds < 1:
        parser.error(f"--rounds {rounds}: must be >= 1")
    if not 0.01 <= chosen.duration <= 1000:
        parser.error(f"--duration {chosen.duration:g}: must be 0.01 to 1000 s")
    if chosen.json and not chosen.json.parent.is_dir():
        parser.error(f"--json {chosen.json}: there is no such folder")
    if chosen.write and not chosen.write.is_file():
        parser.error(f"--write {chosen.write}: there is no such file")

    from rich.console import Console

    from benchmarks.measure import DisagreementError, measure
    from benchmarks.peers import peers
    from benchmarks.peers.peer import UnavailableError
    from benchmarks.report import show, write_json, write_markdown
    from dualwinch.codegen.errors import DualwinchError

    try:
        with Console(stderr=True).status("preparing") as status:
            timings = measure(peers(chosen.duration), rounds, 1 if chosen.quick else 3, status.update)
        show(timings, chosen.duration)
        if chosen.json:
            write_json(chosen.json, timings, chosen.duration)
        if chosen.write:
            write_markdown(chosen.write, timings)
    except (DisagreementError, UnavailableError, DualwinchError, OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
