"""Run the single-precision controller of Case 4 on emulated Cortex-M processors and print what it costs."""

import sys

from benchmarks.document import command, publish


def main() -> int:
    """Run the command line; 0 done, 1 where a program is missing or fails."""
    parser = command(__doc__)
    chosen = parser.parse_args()
    if chosen.write and not chosen.write.is_file():
        parser.error(f"--write {chosen.write}: there is no such file")

    from benchmarks.embedded.board import missing
    from benchmarks.embedded.report import report

    lacking = missing()
    if lacking:
        packages = "gcc-arm-none-eabi, libnewlib-arm-none-eabi, qemu-system-arm"
        print(f"error: {', '.join(lacking)} not found; install {packages}", file=sys.stderr)
        return 1
    try:
        publish(chosen.write, {"table": report()})
    except RuntimeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
