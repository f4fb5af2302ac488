"""Run the single-precision controller of Case 4 on emulated Cortex-M processors and print what it costs."""

import argparse
import sys
from pathlib import Path


def main() -> int:
    """Run the command line; 0 done, 1 where a program is missing or fails."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.embedded", description=__doc__)
    parser.add_argument("--write", type=Path, metavar="FILE", help="put the tables between the marks of a document")
    chosen = parser.parse_args()
    if chosen.write and not chosen.write.is_file():
        parser.error(f"--write {chosen.write}: there is no such file")

    from benchmarks.document import put
    from benchmarks.embedded.board import missing
    from benchmarks.embedded.report import report

    lacking = missing()
    if lacking:
        packages = "gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm"
        print(f"error: {', '.join(lacking)} not found; install {packages}", file=sys.stderr)
        return 1
    try:
        text = report()
    except RuntimeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(text)
    if chosen.write:
        put(chosen.write, "table", text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
