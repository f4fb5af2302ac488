"""``dualwinch certify``: the paper's stability theorem for given gains and a scenario."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter
from rich.text import Text

from dualwinch.cli.linearise import print_resonance, resonance_tables
from dualwinch.cli.options import ControllerOptions, Figure, NominalMachine
from dualwinch.cli.output import (
    FigureColumn,
    FigureTable,
    check_file,
    records,
    styled,
    terminal,
    versions,
    write_figure,
    write_json,
)
from dualwinch.cli.progress import ProgressLine

if TYPE_CHECKING:
    from dualwinch.analysis.stability import Certificate, Condition, NearbyGains


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
    from dualwinch.analysis.stability import certify as judge
    from dualwinch.analysis.stability import nearby_gains

    experiment = given.nominal(ensemble)
    check_file(out, ".json")
    with ProgressLine("simulating", command="certify", patient=True) as progress:
        certificate = judge(experiment, progress=progress)
        progress(0.0, "searching nearby gains")
        near = nearby_gains(certificate, progress=progress)
    record = to_record(certificate, near)
    print_certificate(record, certificate, near)
    write_json(out, record)
    write_figure(plot, "lyapunov", certificate)


POINTS = 2000
"""Most points of V(t) in a file."""


def print_certificate(record: dict[str, Any], certificate: Certificate, near: NearbyGains) -> None:
    """Print the verdict on every condition, the decrease of V, and the nearby gains."""
    from dualwinch.analysis.stability import GAPS

    console = terminal(soft_wrap=True)
    result = certificate.result
    kind = result.experiment.controller.law.kind
    console.print(styled("bold", kind, f": {result.outcome} at {result.end_time:g} s"))
    console.print(conditions_table(certificate.conditions).render())
    console.print("As the paper prints them:", style="dim")
    for statement in dict.fromkeys(condition.statement for condition in certificate.conditions):
        console.print(f"  {statement}", style="dim", highlight=False)
    console.print()
    console.print(_verdict(record))
    console.print(
        f"V decreases over {100 * certificate.decreasing:.4g} % of the samples, and at the rate of the paper's last "
        f"line over {100 * certificate.within_claim:.4g} %. "
        f"Largest V {record['largest_V']:.4g}, last {record['last_V']:.4g}."
    )
    console.print(_search(near))
    console.print("\nAssumptions of the proof, whatever the gains:")
    for gap in GAPS:
        console.print(f"  - {gap}", highlight=False)
    console.print()
    print_resonance(resonance_tables(result.experiment))


def conditions_table(conditions: Sequence[Condition]) -> FigureTable:
    """The conditions with both sides and verdict, a row each."""
    verdicts = {True: styled("green", "holds"), False: styled("red", "fails")}
    columns = (
        FigureColumn("condition", ""),
        FigureColumn("disturbance", ""),
        FigureColumn("left"),
        FigureColumn("right"),
        FigureColumn("holds", "", "", words=verdicts),
    )
    rows = [(each.name, each.basis, each.left, each.right, bool(each.holds)) for each in conditions]
    return FigureTable("conditions", columns, rows)


def _verdict(record: dict[str, Any]) -> Text:
    from dualwinch.analysis.stability import REAL

    if record["outcome"] != "completed":
        return styled("bold", "Not certified", ": the run did not reach its end.")
    if record["certified_with_ropes"]:
        return styled("bold", "Certified", ", also with the force that the ropes do not deliver as a disturbance.")
    if record["certified"]:
        return styled("bold", "Certified as printed", f", but not with {REAL}: the force lags behind its command.")
    judged, failing, with_ropes = record["judged_conditions"], *record["failing_conditions"].values()
    words = f"{failing} of the paper's {judged['printed']} conditions fail"
    if with_ropes > failing:
        words += f"; with {REAL}, {with_ropes - failing} more"
    return styled("bold", "Not certified", f": {words} ({with_ropes} of the {judged['with_ropes']} rows above).")


def _search(near: NearbyGains) -> str:
    if near.found and not near.changes:
        return f"Nearby gains: none needed, {near.reason}."
    changes = ", ".join(f"{key} {before:g} -> {after:.4g}" for key, (before, after) in near.changes.items())
    if near.found:
        better = f"V then decreases over {100 * near.certificate.decreasing:.4g} % of the samples"
        return f"Nearby gains that satisfy every condition: {changes}; {near.reason}. {better}."
    attempts = "\n".join(f"  - {line}" for line in near.history[1:])
    return f"Nearby gains that satisfy every condition: none found, {near.reason}.\nTried:\n{attempts}"


def to_record(certificate: Certificate, near: NearbyGains) -> dict[str, Any]:
    """The report as plain values."""
    from dualwinch.analysis.stability import GAPS, REAL
    from dualwinch.config.experiment_file import to_toml

    result, terms, conditions = certificate.result, certificate.terms, certificate.conditions
    by_basis = {"printed": [each for each in conditions if each.basis != REAL], "with_ropes": conditions}
    stride = max(1, -(-len(result["t"]) // POINTS))
    names = ("surface", "auxiliary", "estimate", "adaptation")
    curves = {"t": result["t"], "V": terms.total} | {name: getattr(terms, name) for name in names}
    return {
        "outcome": result.outcome,
        "end_time": result.end_time,
        "certified": certificate.certified,
        "certified_with_ropes": certificate.certified_with_ropes,
        "conditions": [asdict(condition) for condition in conditions],
        "bounds": {basis: asdict(bounds) for basis, bounds in certificate.bounds.items()},
        "decreasing_share": certificate.decreasing,
        "within_claim_share": certificate.within_claim,
        "largest_V": float(terms.total.max()),
        "last_V": float(terms.total[-1]),
        "failing_conditions": {name: sum(not each.holds for each in those) for name, those in by_basis.items()},
        "judged_conditions": {name: len(those) for name, those in by_basis.items()},
        "units": {"end_time": "s", "t": "s", "decreasing_share": "1", "within_claim_share": "1"},
        "curves": {name: values[::stride] for name, values in curves.items()}
        | {"dV_dt": certificate.rate[::stride].tolist()},
        "nearby_gains": {
            "found": near.found,
            "changes": {key: {"given": a, "tried": b} for key, (a, b) in near.changes.items()},
            "reason": near.reason,
            "history": near.history,
            "decreasing_share": near.certificate.decreasing if near.certificate else None,
        },
        "gaps": list(GAPS),
        **records(resonance_tables(result.experiment)),
        "configuration": to_toml(result.experiment),
        "versions": versions(),
    }
