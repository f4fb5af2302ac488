"""What each erratum and assumption is worth: the headline with another choice, or a fact of the printed form.

`benchmarks.paper_claims` puts the table into docs/paper.md.
"""

from dataclasses import dataclass, replace
from functools import cache
from math import pi, sqrt
from typing import Any, ClassVar

import numpy as np

import dualwinch as dw
from benchmarks.document import markdown
from dualwinch.controllers.coordinations.differential_tension import DifferentialTension

LAW, WITHOUT = "fando-nftsm", "nftsm"
OBSERVER = "controller.observer."


@dataclass(frozen=True)
class Choice:
    """Another choice for one note: what is set, in words and as configuration keys."""

    note: str
    words: str
    settings: dict[str, Any]


def both(name: str, value: float, tables: tuple[str, str] = ("plant.winch_1.", "plant.winch_2.")) -> dict[str, Any]:
    """The same number for both winches."""
    return {f"{table}{name}": value for table in tables}


WINCHES = ("controller.winch_1.", "controller.winch_2.")
CHOICES = (
    Choice("E4", "vortex frequency integrated", {"disturbance.integrated_phase": True}),
    Choice("A1", "dead length 0.1 m in place of 0.5 m", {"plant.track.rope_offset": 0.1}),
    Choice("A1", "dead length 2 m", {"plant.track.rope_offset": 2.0}),
    Choice("A2", "ropes that push (the paper's equations)", {"plant.rope_slack": False}),
    Choice("A3", "rail friction coefficient 0 in place of 0.1", {"plant.vehicle.friction_coefficient": 0.0}),
    Choice("A3", "rail friction coefficient 0.3", {"plant.vehicle.friction_coefficient": 0.3}),
    Choice("A4", "drag area 3 m² in place of 6 m²", {"plant.vehicle.drag_area": 3.0}),
    Choice("A4", "drag area 12 m²: the reference is no longer feasible", {"plant.vehicle.drag_area": 12.0}),
    Choice("A5", "Coulomb friction of 20 N m at each drum", both("coulomb_friction", 20.0)),
    Choice("A6", "added mass 9.4 t in place of 0", {"plant.vehicle.added_mass": 9.4e3}),
    Choice("A7", "smoothing 10⁻⁷ m/s in place of 10⁻⁵ m/s", {"controller.nftsm.smoothing": 1e-7}),
    Choice("A7", "smoothing 10⁻³ m/s", {"controller.nftsm.smoothing": 1e-3}),
    Choice("A8", "scales of the fuzzy inputs ÷ 5", {f"{OBSERVER}error_scale": 0.02, f"{OBSERVER}rate_scale": 0.1}),
    Choice("A8", "scales of the fuzzy inputs × 5", {f"{OBSERVER}error_scale": 0.5, f"{OBSERVER}rate_scale": 2.5}),
    Choice("A8", "no fuzzy system: K_f = 0", {f"{OBSERVER}kf": 0.0}),
    Choice("A9", "L₀ = K_f = 2.5 1/s in place of 5 1/s", {f"{OBSERVER}l0": 2.5, f"{OBSERVER}kf": 2.5}),
    Choice("A9", "L₀ = K_f = 50 1/s", {f"{OBSERVER}l0": 50.0, f"{OBSERVER}kf": 50.0}),
    Choice(
        "A10",
        "γ = 10⁻³ in place of 10⁻⁵, both",
        {"controller.auxiliary.gamma": 1e-3, "controller.auxiliary.gamma_force": 1e-3},
    ),
    Choice("A11", "winch gains 0: feedforward alone", both("kp", 0.0, WINCHES) | both("ki", 0.0, WINCHES)),
    Choice("A11", "winch gains × 10", both("kp", 5e-3, WINCHES) | both("ki", 0.2, WINCHES)),
)
"""Choices that a configuration can make, in the order of the notes."""


class PrintedTensionError(DifferentialTension):
    """Tension loops whose error has the printed sign (E10)."""

    kind: ClassVar = "printed-tension-error"

    def step(self, state: Any, force: Any, estimate: Any, setpoint: Any, context: Any) -> Any:
        """One sample with both gains negated, which is what the printed sign amounts to."""
        printed = (replace(gains, kp=-gains.kp, ki=-gains.ki) for gains in (self.winch_1, self.winch_2))
        return DifferentialTension(*printed).step(state, force, estimate, setpoint, context)


def settings_of(choice: Choice, law: str) -> dict[str, Any]:
    """The keys of a choice that a law has."""
    return {key: value for key, value in choice.settings.items() if law == LAW or not key.startswith(OBSERVER)}


@cache
def metrics(number: int, law: str, index: int | None = None) -> dw.Metrics:
    """Figures of merit of a case, with the paper's choices or with those of one entry of `CHOICES`."""
    settings = {} if index is None else settings_of(CHOICES[index], law)
    return dw.simulate(dw.override(dw.case(number, law), settings), stride=0).metrics


def reduction(number: int, index: int | None = None) -> float:
    """Change of the mean steady-state error by the observer, in percent."""
    with_observer, without = (metrics(number, law, index).steady_mae for law in (LAW, WITHOUT))
    return 100 * (with_observer / without - 1)


def row(words: str, index: int | None = None) -> list[str]:
    """One line of the table."""
    four, first = metrics(4, LAW, index), metrics(1, LAW, index)
    return [
        words,
        f"{reduction(4, index):.1f}".replace("-", "−"),
        f"{1e3 * four.steady_mae:.2f}",
        f"{four.chatter:.2f}",
        f"{1e3 * first.steady_mae:.1f}",
        f"{first.min_tension:.0f}".replace("-", "−"),
    ]


def choices_table() -> str:
    """Every choice that a configuration can make, beside the paper's numbers as they stand here."""
    headings = [
        "choice", "Case 4: by the observer, %", "steady mean error, mm", "chatter, N", "Case 1: steady mean error, mm",
        "smallest tension, N",
    ]  # fmt: skip
    rows = [row("as it stands")]
    rows += [row(f"{choice.note}: {choice.words}", index) for index, choice in enumerate(CHOICES)]
    return markdown(headings, rows)


def window(start: float, end: float) -> float:
    """Change of the mean error by the observer in Case 4 between two times in s, in percent (A13)."""
    runs = [dw.simulate(dw.case(4, law)) for law in (LAW, WITHOUT)]
    errors = [np.abs(run["e"][(run["t"] >= start) & (run["t"] < end)]).mean() for run in runs]
    return 100 * (errors[0] / errors[1] - 1)


def facts() -> dict[str, str]:
    """Note → what the printed form, or another reading, amounts to, where no configuration can make it."""
    plant = dw.Plant()
    winch, rope, vehicle = plant.winch_1, dw.Rope(), plant.vehicle
    middle = plant.track.length / 2 + plant.track.rope_offset
    stiffness, lever = rope.modulus * rope.area / middle, winch.drum_radius**2 / winch.inertia
    half = lever * rope.damping / 2
    growth = half + sqrt(half**2 + lever * stiffness)
    push = vehicle.friction_coefficient * vehicle.normal_force / vehicle.mass
    run = dw.simulate(dw.case(4))
    cruise = (run["t"] > 18) & (run["t"] < 29)
    gains = run.experiment.controller.law.nftsm  # pyright: ignore[reportAttributeAccessIssue]
    power = gains.p / gains.q
    factor = power / gains.beta * np.abs(run["v"] - run["v_ref"])[cruise] ** (power - 1)
    low, high = np.percentile(factor, [5, 95])
    wrong = dw.simulate(dw.case(4, coordination=PrintedTensionError()), stride=0)
    pid = dw.simulate(dw.case(4, "pid-cascade"), stride=0).metrics
    saturated = dw.simulate(dw.case(1, "pid-cascade"), stride=0).metrics.saturated_share
    swing = 1000 * 2 * pi * 5 * 1e-3
    return {
        "E1": f"Winding in loosens rope 2: at mid-track tensions run away by a factor of e in {1e3 / growth:.1f} ms.",
        "E2": f"A vehicle at rest would accelerate backwards at {push:.3f} m/s².",
        "E3": f"A torque for 3000 N would hold {3000 * winch.drum_radius:.0f} N.",
        "E5": "The reference would jump by 25.2 m, twice.",
        "E6": f"A known force that swings by 1 kN at 5 Hz enters the observer as {swing:.0f} N.",
        "E7": f"In Case 4 the sliding variable approaches zero at {low:.2f} to {high:.2f} times the printed rate.",
        "E8": "None in Cases 2 and 4, where Z_a stays 0; for Cases 1 and 3 see A10.",
        "E9": "The equation for the torque has no solution.",
        "E10": f"Case 4 ends as `{wrong.outcome}` after {wrong.end_time:.1f} s.",
        "E11": "None here: both winches have the same limits.",
        "A12": f"The baseline's error is {1e3 * pid.steady_mae:.0f} mm in Case 4; in Case 1 its force is at the limit "
        f"for {100 * saturated:.0f} % of the time.",
        "A13": f"By the observer: {window(20, 29):.1f} % over 20 to 29 s, {window(18, 25):.1f} % over 18 to 25 s, "
        f"{window(0, 50.1):.1f} % over the whole run.".replace("-", "−"),
        "A14": heavy(plant),
        "A15": "None here: it is off.",
    }


def heavy(plant: dw.Plant) -> str:
    """What a rope of 24 mm weighs, and how it sags and swings, beside the paper's drum (A14)."""
    rope, length = dw.Rope(), plant.track.length + plant.track.rope_offset
    mass, weight, tension = 2.36 * length, 20.2, 1000.0
    light = plant.winch_1.inertia / plant.winch_1.drum_radius**2
    stiffness = rope.modulus * rope.area
    softer = 1 + weight**2 * stiffness / (12 * tension**3)
    return (
        f"A steel rope of 24 mm weighs {mass:.0f} kg, {mass / light:.0f} times what Table 1's drum comes to at the "
        f"rope; on rollers every metre it is {softer:.2f} times as soft at 1000 N."
    )


def facts_table() -> str:
    """What the printed forms amount to, a line a note."""
    return "\n".join(["| | effect |", "|---|---|", *(f"| {note} | {text} |" for note, text in facts().items())])
