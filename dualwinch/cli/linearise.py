"""Options of ``dualwinch linearise``."""

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import App, Parameter

from dualwinch.cli.options import (
    AssignmentsInBrief,
    Case,
    Config,
    Estimator,
    Figure,
    Law,
    Plugins,
    use_parts,
    with_estimator,
)

app = App(
    name="linearise",
    help_epilogue="""Examples:

    dualwinch linearise --x 25 --v 1.8
    dualwinch linearise --x 25 --out plant.json --plot bode.png
    dualwinch linearise --sweep x=1:47:2 --plot modes.png --out track.mat
    dualwinch linearise --sweep v=0:2.4:0.2 --plot poles.svg --figure poles
    dualwinch linearise --loop closed --v 0.5 --plot poles.png
    dualwinch linearise --loop broken --cut tau_1 --v 0.5 --plot margins.png
    dualwinch linearise --loop broken --v 0.5 --plot amplitude.png --figure amplitude
""",
)


@app.default
def linearise(
    *,
    x: Annotated[float | None, Parameter(help="Position in m (default: middle of the track).")] = None,
    v: Annotated[float | None, Parameter(help="Speed in m/s (default 0); negative: towards winch 2.")] = None,
    preload: Annotated[
        float | None, Parameter(help="Sum of both tensions in N (default: controller.coordination.preload).")
    ] = None,
    sweep: Annotated[str | None, Parameter(help="Many points: name=first:last:step, the name x, v or preload.")] = None,
    loop: Annotated[
        Literal["open", "closed", "broken"],
        Parameter(help="What to linearise: plant alone, closed loop over a sample, or that loop cut open."),
    ] = "open",
    cut: Annotated[
        Literal["u", "tau_1", "tau_2"] | None,
        Parameter(help="broken: where the loop is cut, at the force command (default) or at a winch's torque."),
    ] = None,
    dt: Annotated[
        float | None, Parameter(help="Sample time in s: discrete time, inputs held (default: continuous).")
    ] = None,
    case: Case = None,
    config: Config = None,
    controller: Law = None,
    estimator: Estimator = None,
    set_: AssignmentsInBrief = None,
    plugin: Plugins = None,
    out: Annotated[Path | None, Parameter(help="File for the matrices: .json, .mat or .npz.")] = None,
    plot: Figure = None,
    figure: Annotated[
        Literal["amplitude", "bode", "modes", "poles", "shapes"] | None,
        Parameter(
            help="Which figure. open: bode (default of one point), modes (of a sweep), poles, shapes; closed: poles; "
            "broken: bode with margins (default), or margins against the amplitude of the speed error."
        ),
    ] = None,
) -> None:
    """Linearise the plant at an operating point or along a sweep; print its modes and the sample rate they need.

    At rest the operating point is an equilibrium, else steady motion with constant tensions. Every derivative is
    exact.

    The closed loop is that of one sample of plant and controller, the broken one is it cut open at a signal; of it,
    gain, phase, delay and disk margins are printed, and how they depend on the amplitude of the speed error.
    """
    from dualwinch.commands.linearise import linearise as run
    from dualwinch.config.experiment_file import experiment_from

    use_parts(plugin)
    run(
        experiment_from(case, config, controller, with_estimator(estimator, set_)),
        {"x": x, "v": v, "preload": preload},
        sweep,
        loop=loop,
        cut=cut,
        dt=dt,
        out=out,
        plot=plot,
        figure=figure,
    )
