"""The command line, one command a file; the computations are functions of the other packages.

Heavy imports stand inside the commands, so that ``--help`` answers at once.
"""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every failure is one line on standard error.

    Args:
        arguments: words of the command line; default: those of the process.
    """
    # commands of toolboxes import options of this package while the application is being composed
    from dualwinch.cli.app import main as run

    run(arguments)
