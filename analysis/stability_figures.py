"""Figures of the stability theorem's certificate: conditions, decrease of V, nearby gains, and the drums' resonance."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from dualwinch.analysis.linear_figures import resonance_figures
from dualwinch.analysis.stability import GAPS, REAL, Certificate, Condition, NearbyGains
from dualwinch.model.quantities.figures import FigureColumn, Figures, FigureTable, Sentence, to_record

POINTS = 2000
"""Most points of V(t) in a record."""


@dataclass(frozen=True, eq=False)
class StabilityReport:
    """A certificate, and the gains near those certified that satisfy every condition."""

    certificate: Certificate
    near: NearbyGains

    @cached_property
    def figures(self) -> Figures:
        """The verdict on every condition, the decrease of V, the nearby gains, and the rule for the resonance."""
        certificate, result = self.certificate, self.certificate.result
        values = certificate.terms.total
        return [
            Sentence(f": {result.outcome} at {result.end_time:g} s", result.experiment.controller.law.kind),
            conditions_table(certificate.conditions),
            Sentence("As the paper prints them:", style="dim"),
            *(
                Sentence("", f"  {statement}", "dim")
                for statement in dict.fromkeys(condition.statement for condition in certificate.conditions)
            ),
            self._verdict,
            Sentence(
                f"V decreases over {100 * certificate.decreasing:.4g} % of the samples, and at the rate of the paper's "
                f"last line over {100 * certificate.within_claim:.4g} %. "
                f"Largest V {float(values.max()):.4g}, last {float(values[-1]):.4g}."
            ),
            *map(Sentence, self._nearby_gains),
            Sentence("Assumptions of the proof, whatever the gains:"),
            *(Sentence(f"  - {gap}") for gap in GAPS),
            *self._resonance,
        ]

    @cached_property
    def _resonance(self) -> Figures:
        return resonance_figures(self.certificate.result.experiment)

    @property
    def _by_basis(self) -> dict[str, Sequence[Condition]]:
        """Conditions as the paper prints them, and with those for the force that the ropes do not deliver."""
        conditions = self.certificate.conditions
        return {"printed": [each for each in conditions if each.basis != REAL], "with_ropes": conditions}

    @property
    def failing(self) -> dict[str, int]:
        """Number of conditions that fail, as printed and with ropes."""
        return {name: sum(not each.holds for each in conditions) for name, conditions in self._by_basis.items()}

    @property
    def judged(self) -> dict[str, int]:
        """Number of conditions, as printed and with ropes."""
        return {name: len(conditions) for name, conditions in self._by_basis.items()}

    @property
    def _verdict(self) -> Sentence:
        certificate, failing, totals = self.certificate, self.failing, self.judged
        if certificate.result.outcome != "completed":
            return Sentence(": the run did not reach its end.", "Not certified")
        if certificate.certified_with_ropes:
            return Sentence(", also with the force that the ropes do not deliver as a disturbance.", "Certified")
        if certificate.certified:
            return Sentence(f", but not with {REAL}: the force lags behind its command.", "Certified as printed")
        words = f": {failing['printed']} of the paper's {totals['printed']} conditions fail"
        if further_failures := failing["with_ropes"] - failing["printed"]:
            words += f"; with {REAL}, {further_failures} more"
        return Sentence(f"{words} ({failing['with_ropes']} of the {totals['with_ropes']} rows above).", "Not certified")

    @property
    def _nearby_gains(self) -> list[str]:
        near, title = self.near, "Nearby gains that satisfy every condition:"
        if not near.found:
            return [f"{title} none found, {near.reason}.", "Tried:", *(f"  - {line}" for line in near.history[1:])]
        if not near.changes:
            return [f"Nearby gains: none needed, {near.reason}."]
        changes = ", ".join(f"{key} {before:g} -> {after:.4g}" for key, (before, after) in near.changes.items())
        decrease = f"V then decreases over {100 * near.certificate.decreasing:.4g} % of the samples"
        return [f"{title} {changes}; {near.reason}. {decrease}."]

    def to_record(self) -> dict[str, Any]:
        """The report as plain values; curves with at most `POINTS` points."""
        certificate, near = self.certificate, self.near
        result, terms = certificate.result, certificate.terms
        stride = max(1, -(-len(result["t"]) // POINTS))
        names = ("surface", "auxiliary", "estimate", "adaptation")
        curves = {"t": result["t"], "V": terms.total} | {name: getattr(terms, name) for name in names}
        curves["dV_dt"] = certificate.rate
        return {
            "outcome": result.outcome,
            "end_time": result.end_time,
            "certified": certificate.certified,
            "certified_with_ropes": certificate.certified_with_ropes,
            "conditions": [asdict(condition) for condition in certificate.conditions],
            "bounds": {basis: asdict(bounds) for basis, bounds in certificate.bounds.items()},
            "decreasing_share": certificate.decreasing,
            "within_claim_share": certificate.within_claim,
            "largest_V": float(terms.total.max()),
            "last_V": float(terms.total[-1]),
            "failing_conditions": self.failing,
            "judged_conditions": self.judged,
            "units": {"end_time": "s", "t": "s", "decreasing_share": "1", "within_claim_share": "1"},
            "curves": {name: values[::stride] for name, values in curves.items()},
            "nearby_gains": {
                "found": near.found,
                "changes": {key: {"given": a, "tried": b} for key, (a, b) in near.changes.items()},
                "reason": near.reason,
                "history": near.history,
                "decreasing_share": near.certificate.decreasing if near.certificate else None,
            },
            "gaps": list(GAPS),
            **to_record(self._resonance),
            "notes": to_record(self.figures)["notes"],
        }


def conditions_table(conditions: Sequence[Condition]) -> FigureTable:
    """The conditions with both sides and verdict, a row each."""
    columns = (
        FigureColumn("condition", ""),
        FigureColumn("disturbance", ""),
        FigureColumn("left"),
        FigureColumn("right"),
        FigureColumn("holds", "", "", words={True: "holds", False: "fails"}, styles={True: "green", False: "red"}),
    )
    rows = [(each.name, each.basis, each.left, each.right, bool(each.holds)) for each in conditions]
    return FigureTable("conditions", columns, rows)
