"""The command line. Heavy imports stand inside the commands, so that ``--help`` answers at once."""

import os
import signal
import sys
from pathlib import Path
from typing import Annotated, Literal, NoReturn

from cyclopts import App, CycloptsError, Parameter

from dualwinch import __version__

DONE, FAILED, WRONG_INPUT = 0, 1, 2
"""Exit codes."""

app = App(
    name="dualwinch",
    help="""Control of a vehicle towed by two winches: simulate, reproduce the paper, generate compiled code.

Start with `dualwinch reproduce`, or look at one run:

    dualwinch simulate --case 4 --plot run.png
    dualwinch simulate --case 4 --set controller.observer.l0=20 --out run.csv
    dualwinch config --case 4 > my.toml && dualwinch simulate --config my.toml
""",
    help_format="markdown",
    version=__version__,
    version_flags=["--version"],
    suppress_keyboard_interrupt=False,
)

ControllerName = Literal["fando-nftsm", "nftsm", "pid-cascade", "super-twisting", "adrc"]
Case = Annotated[int | None, Parameter(help="Case 1 to 4 of the paper.")]


@app.command(
    help_epilogue="""Examples:

    dualwinch reproduce
    dualwinch reproduce --cases 4 --controllers fando-nftsm,nftsm --out case4
    dualwinch reproduce --extended
"""
)
def reproduce(
    *,
    out: Annotated[Path, Parameter(help="Folder for figures, data, metrics and the report.")] = Path("results"),
    cases: Annotated[str, Parameter(help="Cases to run, separated by commas.")] = "1,2,3,4",
    controllers: Annotated[
        str, Parameter(help="Controllers to compare, separated by commas.")
    ] = "fando-nftsm,nftsm,pid-cascade",
    extended: Annotated[
        bool, Parameter(help="Also compare all position laws and coordinations, beyond the paper's.", negative="")
    ] = False,
) -> None:
    """Run the paper's cases and controllers, and write every figure, the data and one report.

    Prints the figures of merit and, where Case 4 runs with both sliding-mode controllers, the reductions of
    Figure 21 beside the paper's.
    """
    from dualwinch.reproduce import reproduce as run

    run(out, cases.split(","), controllers.split(","), extended=extended)


@app.command(
    help_epilogue="""Examples:

    dualwinch simulate --case 4
    dualwinch simulate --case 4 --controller pid-cascade --plot pid.png
    dualwinch simulate --set plant.vehicle.mass=1.1e4 --set disturbance.vortex=true --out heavy.parquet
    dualwinch simulate --ensemble sea --scenarios 100 --seed 7 --out sea.csv --plot sea.png
"""
)
def simulate(
    *,
    case: Case = None,
    config: Annotated[Path | None, Parameter(help="Experiment to read, TOML (see `dualwinch config`).")] = None,
    controller: Annotated[ControllerName | None, Parameter(help="Position law.")] = None,
    set_: Annotated[
        list[str] | None,
        Parameter(name="--set", help="key=value, any key of `dualwinch config`; may be repeated.", negative=""),
    ] = None,
    ensemble: Annotated[
        str | None, Parameter(help="Run an ensemble of scenarios: `sea`, or a TOML file (see `config --ensemble`).")
    ] = None,
    scenarios: Annotated[int | None, Parameter(help="Scenarios of the ensemble (default 100).")] = None,
    seed: Annotated[int | None, Parameter(help="Seed of the ensemble's draws (default 0).")] = None,
    out: Annotated[
        Path | None,
        Parameter(help="File for the data: .csv, .parquet, .npz, .mat (one run) or .json (ensemble)."),
    ] = None,
    plot: Annotated[Path | None, Parameter(help="File for a figure: .png, .svg or .pdf.")] = None,
    stride: Annotated[int, Parameter(help="Keep every n-th sample in the data.")] = 1,
    engine: Annotated[
        Literal["compiled", "interpreter"], Parameter(help="Compiled C, or CasADi's interpreter (slow).")
    ] = "compiled",
) -> None:
    """Simulate one experiment and print its figures of merit.

    Without --case or --config the defaults of every key are used (the paper's Case 2).

    With --ensemble, many scenarios are drawn and run on all cores. --case or --config give the values that the
    ensemble's file does not have; --controller and --set change its nominal values, and distributions relative to
    those follow. The data hold one row a scenario, the figure is a fan chart.
    """
    from model.errors import ConfigurationError

    if ensemble is not None:
        for word, given in (("--stride", stride != 1), ("--engine", engine != "compiled")):
            if given:
                raise ConfigurationError(f"{word} and --ensemble: give one of them")
        from dualwinch.simulate_ensemble import ensemble as drawn
        from dualwinch.simulate_ensemble import simulate_ensemble

        simulate_ensemble(drawn(ensemble, case, config, controller, set_ or []), scenarios, seed, out, plot)
        return
    if scenarios is not None:
        raise ConfigurationError("--scenarios: needs --ensemble")
    if seed is not None:
        raise ConfigurationError("--seed: needs --ensemble; the seed of one run is --set disturbance.seed=N")
    from dualwinch.simulate_command import simulate as run

    run(case, config, controller, set_ or [], out, plot, stride, engine)


@app.command(
    help_epilogue="""Examples:

    dualwinch linearise --x 25 --v 1.8
    dualwinch linearise --x 25 --out plant.json --plot bode.png
    dualwinch linearise --sweep x=1:47:2 --plot modes.png --out track.mat
    dualwinch linearise --sweep v=0:2.4:0.2 --plot poles.svg --figure poles
    dualwinch linearise --loop closed --v 0.5 --plot poles.png
    dualwinch linearise --loop broken --cut tau_1 --v 0.5 --plot margins.png
    dualwinch linearise --loop broken --v 0.5 --plot amplitude.png --figure amplitude
"""
)
def linearise(
    *,
    x: Annotated[float | None, Parameter(help="Position in m (default 25).")] = None,
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
    config: Annotated[Path | None, Parameter(help="Experiment to read, TOML (see `dualwinch config`).")] = None,
    controller: Annotated[ControllerName | None, Parameter(help="Position law of the closed or broken loop.")] = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", help="key=value; may be repeated.", negative="")] = None,
    out: Annotated[Path | None, Parameter(help="File for the matrices: .json, .mat or .npz.")] = None,
    plot: Annotated[Path | None, Parameter(help="File for a figure: .png, .svg or .pdf.")] = None,
    figure: Annotated[
        Literal["amplitude", "bode", "modes", "poles", "shapes"] | None,
        Parameter(
            help="Which figure. open: bode (default of one point), modes (of a sweep), poles, shapes; closed: poles; "
            "broken: bode with margins (default), or margins against the amplitude of the speed error."
        ),
    ] = None,
) -> None:
    """Linearise the plant at an operating point or along a sweep; print its modes and what they demand.

    At rest the operating point is an equilibrium, else a steady cruise with constant tensions. Every derivative is
    exact.

    The closed loop is that of one sample of plant and controller, the broken one is it cut open at a signal; of it,
    gain, phase, delay and disk margins are printed, and how they depend on the amplitude of the speed error.
    """
    from dualwinch.linearise_command import linearise as run

    run(case, config, controller, set_ or [], x, v, preload, sweep, loop, cut, dt, out, plot, figure)


@app.command(
    help_epilogue="""Examples:

    dualwinch compare paper best.toml
    dualwinch compare paper best.toml calm.toml --scenarios 500 --seed 1 --out gains.json --plot gains.png
"""
)
def compare(
    *files: Annotated[str, Parameter(help="TOML files of gains; `paper` means the paper's gains.")],
    ensemble: Annotated[str, Parameter(help="Ensemble of scenarios: `sea`, or a TOML file.")] = "sea",
    scenarios: Annotated[int, Parameter(help="Scenarios, the same for every file.")] = 200,
    seed: Annotated[int, Parameter(help="Seed of the draws and of the intervals.")] = 0,
    config: Annotated[
        Path | None, Parameter(help="Experiment that gives the values the ensemble's file does not have.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        Parameter(name="--set", help="key=value of the ensemble's nominal values; may be repeated.", negative=""),
    ] = None,
    out: Annotated[Path | None, Parameter(help="File for the statistics: .json.")] = None,
    plot: Annotated[Path | None, Parameter(help="File for a figure: .png, .svg or .pdf.")] = None,
) -> None:
    """Compare files of gains in the same scenarios, with confidence intervals on the ratios to the first.

    A file is an experiment as `dualwinch config` prints one, or a part of it. Its [controller] tables are compared:
    position law, gains, estimator, coordination and preload; keys it does not have keep their defaults. Plant, sea and
    sensors come from the ensemble alone.
    """
    from dualwinch.compare_command import compare as run

    run(files, ensemble, config, set_ or [], scenarios, seed, out, plot)


@app.command(
    help_epilogue="""Examples:

    dualwinch tune --ensemble sea --time 60s
    dualwinch tune --case 4 --space controller.nftsm --space controller.observer.l0=1:50:log --trials 500
    dualwinch tune --ensemble sea --objective mean.mse --objective mean.chatter --trials 2000 --out front
    dualwinch tune --ensemble sea --constraint "worst.peak_tension<=5500" --constraint "mean.chatter<=0.25*paper"
    dualwinch tune --ensemble sea --time 10min --storage postgresql+psycopg://me@host/studies --study sea
"""
)
def tune(
    *,
    case: Case = None,
    config: Annotated[Path | None, Parameter(help="Experiment to start from, TOML.")] = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", help="key=value; may be repeated.", negative="")] = None,
    ensemble: Annotated[str | None, Parameter(help="Tune in scenarios of an ensemble: `sea`, or a TOML file.")] = None,
    scenarios: Annotated[int | None, Parameter(help="Scenarios of the ensemble a candidate is tuned on.")] = None,
    space: Annotated[
        list[str] | None,
        Parameter(
            help="Gain or table of gains, e.g. controller.nftsm.beta, with bounds `=0.005:5:log` if not its own; "
            "controller.winch.* ties both winches; controller.nftsm.p/q=5/3,7/5; or a TOML file. May be repeated. "
            "Default: all gains in use.",
            negative="",
        ),
    ] = None,
    objective: Annotated[
        list[str] | None,
        Parameter(
            help="mean, median, p95 or worst of a metric, e.g. mean.mse; may be repeated: Pareto front.", negative=""
        ),
    ] = None,
    constraint: Annotated[
        list[str] | None,
        Parameter(
            help="e.g. worst.peak_tension<=6000, mean.chatter<=0.25*paper; may be repeated; none: no constraint. "
            "Default: no slack, no peak near tension_max, chatter below the paper's.",
            negative="",
        ),
    ] = None,
    method: Annotated[
        str | None,
        Parameter(
            help="cmaes (default), gradient, hybrid, tpe, gp, random, qmc, nsga2 (default of several objectives), nsga3"
        ),
    ] = None,
    trials: Annotated[int | None, Parameter(help="Trials (default 1000 without --time).")] = None,
    time: Annotated[str | None, Parameter(help="Time for everything, e.g. 60s, 5min.")] = None,
    storage: Annotated[
        str | None,
        Parameter(help="Journal file, or postgresql+psycopg://USER@HOST/DATABASE.", env_var="DUALWINCH_STORAGE"),
    ] = None,
    study: Annotated[str, Parameter(help="Name of the study.")] = "tuning",
    workers: Annotated[int, Parameter(help="Processes on this machine; more than one needs a database.")] = 1,
    resume: Annotated[bool, Parameter(help="Go on with a study that has trials.", negative="")] = False,
    seed: Annotated[int, Parameter(help="Seed of scenarios and optimiser.")] = 0,
    out: Annotated[Path, Parameter(help="Folder for best.toml and study.json.")] = Path("tuning-results"),
) -> None:
    """Search for better gains, and score the best in scenarios that the search never saw.

    The first trial is the paper's gains. Every candidate is tried in the same scenarios; Ctrl-C ends the search and
    keeps the best so far. best.toml is a configuration: `dualwinch simulate --config best.toml`.
    """
    from dualwinch.tune_command import Options, seconds_from
    from dualwinch.tune_command import tune as run
    from dualwinch.tuning_setup import problem_of

    limits = None if constraint is None else [one for one in constraint if one != "none"]
    seconds = None if time is None else seconds_from(time)
    problem = problem_of(case, config, set_ or [], ensemble, space or [], objective or [], limits, scenarios, seed)
    run(problem, Options(method, trials, seconds, storage, study, workers, resume, out))


@app.command(
    help_epilogue="""Examples:

    dualwinch worker --storage postgresql+psycopg://me@host/studies --study sea
    DUALWINCH_STORAGE=postgresql+psycopg://me:secret@host/studies dualwinch worker --study sea
"""
)
def worker(
    *,
    storage: Annotated[
        str | None, Parameter(help="postgresql+psycopg://USER@HOST/DATABASE.", env_var="DUALWINCH_STORAGE")
    ] = None,
    study: Annotated[str, Parameter(help="Name of the study.")] = "tuning",
    threads: Annotated[int | None, Parameter(help="Threads (default: one a core).")] = None,
) -> None:
    """Join a study that `dualwinch tune` has begun in a database, and work on it until it is over."""
    from dualwinch.worker import worker as run

    run(storage, study, threads)


@app.command(
    name="config",
    help_epilogue="""Examples:

    dualwinch config > my.toml
    dualwinch config --case 4 --set controller.kind=nftsm
    dualwinch config --ensemble sea > my-sea.toml
""",
)
def config_(
    *,
    case: Case = None,
    set_: Annotated[list[str] | None, Parameter(name="--set", help="key=value; may be repeated.", negative="")] = None,
    ensemble: Annotated[str | None, Parameter(help="Print the file of an ensemble, such as `sea`, instead.")] = None,
) -> None:
    """Print the complete configuration as TOML, each key with unit, meaning, range and source."""
    if ensemble is not None:
        from dualwinch.ensembles import find_ensemble, load_ensemble
        from model.errors import ConfigurationError

        if case is not None or set_:
            raise ConfigurationError("--ensemble: prints a file as it is; give --case or --set to 'simulate'")
        load_ensemble(ensemble)
        sys.stdout.write(find_ensemble(ensemble).read_text(encoding="utf-8"))
        return
    from dualwinch.config import to_toml
    from dualwinch.simulate_command import experiment

    sys.stdout.write(to_toml(experiment(case, None, None, set_ or [])))


@app.command(
    help_epilogue="""Examples:

    dualwinch certify --case 4
    dualwinch certify --case 3 --plot lyapunov.png --out certificate.json
    dualwinch certify --case 4 --controller nftsm --set controller.nftsm.k=2
"""
)
def certify(
    *,
    case: Case = None,
    config: Annotated[Path | None, Parameter(help="Experiment to read, TOML (see `dualwinch config`).")] = None,
    controller: Annotated[
        Literal["fando-nftsm", "nftsm"] | None, Parameter(help="Position law the theorem is about.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        Parameter(name="--set", help="key=value, any key of `dualwinch config`; may be repeated.", negative=""),
    ] = None,
    out: Annotated[Path | None, Parameter(help="File for the report: .json.")] = None,
    plot: Annotated[Path | None, Parameter(help="File for a figure of V(t) and dV/dt: .png, .svg or .pdf.")] = None,
) -> None:
    """Hold the paper's stability theorem against given gains and a scenario.

    Prints every condition with both its sides and a verdict, over how much of the run the theorem's Lyapunov
    function decreases, nearby gains that would satisfy the conditions (or why there are none), and what the proof
    takes for granted.
    """
    from dualwinch.certification import certify as run

    run(case, config, controller, set_ or [], out, plot)


export = App(
    name="export",
    help="""Write controller, plant and closed loop as code for other people's tools.

Everything comes from the functions that `dualwinch simulate` runs, with the values of an experiment.
""",
    help_format="markdown",
)
app.command(export)

What = Literal["controller", "plant", "closed-loop"]
Out = Annotated[Path, Parameter(help="Folder for the files; made where there is none.")]
Config = Annotated[Path | None, Parameter(help="Experiment to read, TOML (see `dualwinch config`).")]
Set = Annotated[
    list[str] | None,
    Parameter(name="--set", help="key=value, any key of `dualwinch config`; may be repeated.", negative=""),
]


@export.command(
    name="c",
    help_epilogue="""Examples:

    dualwinch export c --out controller
    dualwinch export c --precision float --freeze --out firmware
    dualwinch export c --what plant --case 4 --out plant
""",
)
def export_c(
    *,
    out: Out,
    what: Annotated[What, Parameter(help="Which part.")] = "controller",
    precision: Annotated[
        Literal["double", "float"], Parameter(help="Of every number; float: no double-precision operation at all.")
    ] = "double",
    freeze: Annotated[
        bool, Parameter(help="Write the parameters as constants instead of an argument.", negative="")
    ] = False,
    case: Case = None,
    config: Config = None,
    set_: Set = None,
) -> None:
    """Write a self-contained C99 package: source, header, CMake file, README and an example.

    No heap, no globals, no recursion; several instances may run at once.
    """
    from dualwinch.export import export_c as run
    from dualwinch.simulate_command import experiment

    run(experiment(case, config, None, set_ or []), what, precision, out, freeze=freeze)


@export.command(
    name="fmu",
    help_epilogue="""Examples:

    dualwinch export fmu --what plant --case 4 --out plant.fmu
    dualwinch export fmu --what controller --fmi 3 --out controller.fmu
    dualwinch export fmu --what plant --kind model-exchange --platforms linux64,win64,darwin64 --out plant.fmu
""",
)
def export_fmu(
    *,
    out: Annotated[Path, Parameter(help="File to write, .fmu.")],
    what: Annotated[What, Parameter(help="Which part.")] = "controller",
    fmi: Annotated[Literal[2, 3], Parameter(help="Version of FMI.")] = 2,
    kind: Annotated[
        Literal["co-simulation", "model-exchange", "both"] | None,
        Parameter(help="Interfaces (default: both for the plant, else co-simulation)."),
    ] = None,
    platforms: Annotated[
        str | None,
        Parameter(
            help="Binaries to include, separated by commas: linux64, win64, darwin64, aarch64-linux, aarch64-darwin, "
            "or all (default: this machine's)."
        ),
    ] = None,
    case: Case = None,
    config: Config = None,
    set_: Set = None,
) -> None:
    """Write a Functional Mock-up Unit: model description, C sources and binaries.

    Binaries for other platforms are compiled here by zig (`pip install 'dualwinch[zig]'`).
    """
    from dualwinch.export_fmu import export_fmu as run
    from dualwinch.simulate_command import experiment

    run(experiment(case, config, None, set_ or []), what, out, fmi, kind, platforms)


@export.command(
    name="mex",
    help_epilogue="""Examples:

    dualwinch export mex --case 4 --out mex
""",
)
def export_mex(*, out: Out, case: Case = None, config: Config = None, set_: Set = None) -> None:
    """Write plant and controller as MEX sources for MATLAB and GNU Octave, with a closed loop in their language."""
    from dualwinch.export import export_mex as run
    from dualwinch.simulate_command import experiment

    run(experiment(case, config, None, set_ or []), out)


@export.command(
    name="casadi",
    help_epilogue="""Examples:

    dualwinch export casadi --case 4 --out functions
""",
)
def export_casadi(*, out: Out, case: Case = None, config: Config = None, set_: Set = None) -> None:
    """Write the functions of controller, plant and closed loop as CasADi files, with the names of all variables."""
    from dualwinch.export import export_casadi as run
    from dualwinch.simulate_command import experiment

    run(experiment(case, config, None, set_ or []), out)


@app.command
def doctor() -> None:
    """Say which compiler, cache folder, processor features and optional parts are in use."""
    from dualwinch.doctor import doctor as run

    run()


def _fail(message: object, code: int) -> NoReturn:
    text = " ".join(str(message).split())
    sys.stderr.write(f"dualwinch: error: {text}\n")
    sys.stderr.flush()
    raise SystemExit(code)


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; every failure is one line on standard error.

    Args:
        arguments: default: those of the process.
    """
    try:
        app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except CycloptsError as error:
        _fail(str(error), WRONG_INPUT)
    except KeyboardInterrupt:
        _fail("interrupted; files already written are complete", FAILED)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(128 + signal.SIGPIPE) from None
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}", FAILED)
    except Exception as error:
        from codegen.errors import DualwinchError
        from model.errors import ConfigurationError

        if not isinstance(error, DualwinchError):
            raise
        _fail(error, WRONG_INPUT if isinstance(error, ConfigurationError) else FAILED)
