"""``dualwinch certify``: the paper's stability theorem for given gains and a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dualwinch.cli.options import ControllerOptions, Figure, NominalMachine
from dualwinch.cli.output import check_file, print_figures, versions, write_figure, write_json
from dualwinch.cli.progress import ProgressLine


def certify(
    *,
    ensemble: NominalMachine = None,
    given: ControllerOptions = ControllerOptions(),
    out: Path | None = None,
    plot: Annotated[Figure, Parameter(help="File for a figure of V(t) and dV/dt: .png, .svg or .pdf.")] = None,
) -> None:
    """Check the paper's stability theorem for given gains and a scenario.

    The theorem covers the position laws fando-nftsm and nftsm. Prints every condition with both sides and a verdict,
    the share of the run in which the theorem's Lyapunov function decreases, nearby gains that satisfy the conditions
    (or why there are none), what the proof assumes, and, beside the theorem, the rule for the drums' resonance.

    Args:
        out: File for the report: .json.

    Examples:
        dualwinch certify --case 4
        dualwinch certify --case 3 --plot lyapunov.png --out certificate.json
        dualwinch certify --case 4 --controller nftsm --set controller.nftsm.k=2
    """
    from dualwinch.analysis.stability import certify as certificate_of
    from dualwinch.analysis.stability import nearby_gains
    from dualwinch.analysis.stability_figures import StabilityReport
    from dualwinch.config.experiment_file import to_toml

    experiment = given.nominal(ensemble)
    check_file(out, ".json")
    with ProgressLine("simulating", command="certify", patient=True) as progress:
        certificate = certificate_of(experiment, progress=progress)
        progress(0.0, "searching nearby gains")
        report = StabilityReport(certificate, nearby_gains(certificate, progress=progress))
    print_figures(report.figures)
    write_json(out, {**report.to_record(), "configuration": to_toml(experiment), "versions": versions()})
    write_figure(plot, "lyapunov", certificate)
