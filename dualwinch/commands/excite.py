"""The command ``excite``: the run that tells some numbers best, as a table, a file for other commands, and drawn."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from dualwinch.codegen.files import atomic
from dualwinch.commands.identify import believed_from, prior_from
from dualwinch.commands.output import check_folder, check_plot, terminal
from dualwinch.commands.progress import ProgressLine
from dualwinch.commands.tune import seconds_from
from dualwinch.config.experiment_file import to_toml
from dualwinch.identification.excitation import excite
from dualwinch.model.errors import ConfigurationError


def run_excite(
    fit: Sequence[str],
    case: int | None,
    config: Path | None,
    assignments: Sequence[str],
    *,
    ensemble: str | None,
    priors: Sequence[str],
    duration: str,
    criterion: Literal["D", "A"],
    track: float | None,
    speed: float | None,
    acceleration: float | None,
    torque: float | None,
    trials: int | None,
    time: str | None,
    seed: int,
    out: Path | None,
    plot: Path | None,
) -> None:
    """Search, print, write. Everything that can be wrong with words is found before anything is run.

    Raises:
        ConfigurationError: anything wrong with a key or value, or no motion within the limits.
        KeyboardInterrupt: interrupted; nothing is written.
    """
    length, known = seconds_from(duration, "--duration"), dict(map(prior_from, priors))
    limit = None if time is None else seconds_from(time)
    if out and out.suffix.lower() != ".toml":
        raise ConfigurationError(f"--out {out}: must end in .toml")
    if out:
        check_folder(out.parent)
    check_plot(plot)
    experiment, drawn = believed_from(case, config, ensemble, assignments)
    console = terminal(stderr=True)
    with ProgressLine("searching") as progress:
        found = excite(
            fit,
            experiment,
            duration=length,
            ensemble=drawn,
            priors=known,
            criterion=criterion,
            track=track,
            speed=speed,
            acceleration=acceleration,
            torque=torque,
            trials=trials,
            seconds=limit,
            seed=seed,
            progress=progress,
        )
    terminal(soft_wrap=True).print(repr(found), highlight=False)
    if out:
        with atomic(out) as unfinished:
            unfinished.write_text(to_toml(found.experiment), encoding="utf-8")
        console.print(f"wrote {out}", soft_wrap=True, highlight=False)
    if plot:
        from dualwinch.simulation.plots import save

        save(found.plot(), plot)
        console.print(f"wrote {plot}", soft_wrap=True, highlight=False)
