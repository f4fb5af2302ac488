"""Which run to make: the library's call, with names in the place of objects."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from typing import Literal

from dualwinch.commands.identify import believed_of
from dualwinch.identification.excitation import search
from dualwinch.identification.excitation.excited import Excited
from dualwinch.identification.excitation.motions import room_of
from dualwinch.simulation.ensembles.ensemble import Ensemble
from dualwinch.simulation.experiment import Experiment


def excite(
    keys: str | Sequence[str],
    experiment: Experiment | None = None,
    *,
    duration: float = 60.0,
    ensemble: str | PathLike[str] | Ensemble | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    criterion: Literal["D", "A"] = "D",
    track: float | None = None,
    speed: float | None = None,
    acceleration: float | None = None,
    torque: float | None = None,
    trials: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    threads: int | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Excited:
    """Design a motion whose log tells some numbers of a machine well, before anybody moves a winch.

    Candidates go from rest to rest through way-points. The closed loop carries each of them out in a simulation, and
    the filter of `identify` says what its log would tell; CMA-ES looks for the one that tells most.

    Args:
        keys: what is to be fitted, as for `identify`.
        experiment: what is believed of machine, sensors and sea; its controller carries the motion out; default: the
            ensemble's, or ``Experiment()``.
        duration: of the run in s.
        ensemble: name or file of an ensemble, such as ``rig``: what it draws is fitted as well, as in `identify`.
        priors: key → mean and standard deviation of what is known beforehand.
        criterion: ``D``: the volume of the estimates' confidence region; ``A``: the mean of their variances, each over
            what is believed.
        track: farthest position in m; default: a metre before the end.
        speed: largest in m/s; default: the reference's.
        acceleration: largest in m/s²; default: what half of the ropes' largest net force gives the vehicle.
        torque: largest of a motor in N m; default: any. Tensions stay within the controller's limits anyway.
        trials: motions that are simulated; default: 200, or any number within `seconds`.
        seconds: time of the search.
        seed: of the search.
        threads: default: one a core.
        progress: called now and then with the share that is done.

    Returns:
        The experiment with that motion, and the standard deviations to expect, beside those of the motion there was.

    Raises:
        ConfigurationError: a key, prior or limit that cannot be, or no motion within the limits.
        DualwinchError: no compiler, or no usable cache folder.
        KeyboardInterrupt: interrupted.
    """
    believed, wanted, known = believed_of(keys, experiment, ensemble, priors)
    room = room_of(believed, track=track, speed=speed, acceleration=acceleration, torque=torque)
    return search.excite(
        wanted,
        believed,
        room,
        duration=duration,
        criterion=criterion,
        priors=known,
        trials=trials,
        seconds=seconds,
        seed=seed,
        threads=threads,
        progress=progress,
    )
