"""Options of ``dualwinch tune``."""

from pathlib import Path
from typing import Annotated

from cyclopts import App, Parameter

from dualwinch.cli.options import WHOLE, AssignmentsInBrief, Case, Plugins, use_parts

app = App(
    name="tune",
    help_epilogue="""Examples:

    dualwinch tune --ensemble sea --time 60s
    dualwinch tune --case 4 --space controller.nftsm --space controller.observer.l0=1:50:log --trials 500
    dualwinch tune --plugin my_law.py --set controller.kind=my-law --space controller.my_law.k=0.1:10:log
    dualwinch tune --ensemble sea --objective mean.mse --objective mean.chatter --trials 2000 --out front
    dualwinch tune --ensemble sea --constraint "worst.peak_tension<=5500" --constraint "mean.chatter<=0.25*paper"
    dualwinch tune --ensemble sea --time 60s --stress --out tuned
    dualwinch tune --ensemble sea --constraint "worst.delay_margin>=5ms" --constraint "worst.gain_margin>=6dB"
    dualwinch tune --ensemble sea --time 10min --storage postgresql+psycopg://me@host/studies --study sea
""",
)


@app.default
def tune(
    *,
    case: Case = None,
    config: Annotated[Path | None, Parameter(help="Experiment to start from, TOML.")] = None,
    set_: AssignmentsInBrief = None,
    plugin: Plugins = None,
    ensemble: Annotated[
        str | None, Parameter(help="Tune in scenarios of an ensemble: `sea`, `rig`, or a TOML file.")
    ] = None,
    scenarios: Annotated[
        int | None, WHOLE, Parameter(help="Scenarios of the ensemble in which each candidate is tried.")
    ] = None,
    space: Annotated[
        list[str] | None,
        Parameter(
            help="Gain or table of gains, e.g. controller.nftsm.beta, with bounds `=0.005:5:log` if not its own; "
            "controller.winch.* gives both winches the same gains; controller.nftsm.p/q=5/3,7/5; or a TOML file. "
            "May be repeated. Default: all gains in use.",
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
            help="e.g. worst.peak_tension<=6000, mean.chatter<=0.25*paper, worst.delay_margin>=5ms (gain, phase, disk "
            "likewise); may be repeated; none: no constraint. "
            "Default, also beside stability margins: no slack, no peak beyond tension_max, little chatter.",
            negative="",
        ),
    ] = None,
    method: Annotated[
        str | None,
        Parameter(
            help="hybrid (default), cmaes, gradient, tpe, gp, random, qmc, nsga2 (default of several objectives), nsga3"
        ),
    ] = None,
    trials: Annotated[int | None, WHOLE, Parameter(help="Trials (default 1000 without --time and --rollouts).")] = None,
    time: Annotated[str | None, Parameter(help="Time of the search, e.g. 60s, 5min; some seconds are added.")] = None,
    rollouts: Annotated[
        int | None, WHOLE, Parameter(help="Rollouts of the search, so that slow laws are tried as often as fast ones.")
    ] = None,
    storage: Annotated[
        str | None,
        Parameter(help="Journal file, or postgresql+psycopg://USER@HOST/DATABASE.", env_var="DUALWINCH_STORAGE"),
    ] = None,
    study: Annotated[str, Parameter(help="Name of the study.")] = "tuning",
    workers: Annotated[int, WHOLE, Parameter(help="Processes on this machine; more than one needs a database.")] = 1,
    resume: Annotated[bool, Parameter(help="Continue a study that has trials.", negative="")] = False,
    seed: Annotated[int, WHOLE, Parameter(help="Seed of scenarios and optimiser.")] = 0,
    out: Annotated[Path, Parameter(help="Folder for best.toml and study.json.")] = Path("tuning-results"),
    stress: Annotated[
        bool, Parameter(help="Afterwards find what breaks the best first (`dualwinch stress`), for the report.")
    ] = False,
) -> None:
    """Search for better gains, and score the best in held-out scenarios.

    The first trials are the paper's gains and the experiment's own. All candidates run in the same scenarios; Ctrl-C
    ends the search and keeps the best so far. The result is never worse than the start: if nothing is better, the start
    is kept and remedies are listed. best.toml is a configuration: `dualwinch simulate --config best.toml`.
    """
    from dualwinch.commands.progress import StatusLine

    with StatusLine() as status:
        status.phase("reading the problem")
        from dualwinch.commands.tune import Options, check_options, recall_parts, seconds_from
        from dualwinch.commands.tune import tune as run
        from dualwinch.tuning.tuning_problem import check_words, tuning_problem

        options = Options(
            method=method,
            trials=trials,
            seconds=None if time is None else seconds_from(time),
            rollouts=rollouts,
            storage=storage,
            study=study,
            workers=workers,
            resume=resume,
            out=out,
            stress=stress,
        )
        check_options(options)
        for text in space or []:
            check_words(text)
        use_parts(plugin)
        recall_parts(options)
        problem = tuning_problem(
            case=case,
            config=config,
            settings=set_ or [],
            ensemble=ensemble,
            space=space or [],
            objectives=objective or [],
            constraints=constraint,
            scenarios=scenarios,
            seed=seed,
        )
        run(problem, options, status)
