"""Where the paper is wrong or silent, and what dualwinch does instead; rendered to docs/errata.md and the report."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Note:
    """One entry of the table.

    Attributes:
        id: E1 to E11 for errata, A1 to A15 for assumptions; code and configuration refer to it.
        kind: ``erratum`` (the paper prints something wrong) or ``assumption`` (it leaves something open).
        subject: in a few words.
        paper: text or gap of the paper, with its section.
        here: solution in dualwinch.
        keys: configuration keys, or tables of keys, of that solution.
        modules: source files of that solution.
        effect: in numbers, where it matters.
        page: page of the documents with these numbers.
    """

    id: str
    kind: Literal["erratum", "assumption"]
    subject: str
    paper: str
    here: str
    keys: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()
    effect: str = ""
    page: str = ""


NOTES = (
    Note(
        "E1",
        "erratum",
        "direction of winch 2",
        "The elongation of rope 2, x − R θ₂ (2.2), counts paid-out rope as positive, the winch equations (2.4) "
        "retrieved rope.",
        "Retrieval is positive for both winches: rope 2 is stretched by R₂ θ₂ + x.",
        modules=("model/plant.py",),
    ),
    Note(
        "E2",
        "erratum",
        "sign of friction and drag",
        "Friction μ F_N and drag ½ C_d ρ A ẋ² are printed without a sign (2.3). The drag's A is also the symbol of the "
        "rope's cross-section.",
        "Friction follows tanh(v / friction_velocity), drag v |v|. The drag has an area of its own.",
        keys=("plant.vehicle.drag_area", "plant.vehicle.friction_velocity"),
        modules=("model/vehicle.py",),
    ),
    Note(
        "E3",
        "erratum",
        "drum radius lost",
        "The winch equations (2.4) lose the drum radius: a force is added to torques.",
        "The rope's torque on the drum is R F, as in the equation the paper starts from.",
        keys=("plant.winch_1.drum_radius", "plant.winch_2.drum_radius"),
        modules=("model/winch.py",),
    ),
    Note(
        "E4",
        "erratum",
        "phase of the vortices",
        "The vortex force is a sine of 2π f t with the frequency f of the present speed (4.3); while the speed "
        "changes, its own frequency differs from f. Along the flow vortices push twice in a period, with about half "
        "the amplitude.",
        "The paper's form. With integrated_phase the frequency is integrated. Twice the strouhal number and half the "
        "vortex_amplitude are the push along the flow.",
        keys=("disturbance.integrated_phase", "disturbance.strouhal", "disturbance.vortex_amplitude"),
        modules=("model/disturbance.py",),
    ),
    Note(
        "E5",
        "erratum",
        "jump in the reference",
        "The constant-speed piece of the profile is 1.8 t + 9 (4.1): the reference would jump by 25.2 m at 18 s and "
        "back at 29 s.",
        "The piece is 1.8 t − 16.2, with which the profile is continuous.",
        keys=("reference.kind",),
        modules=("model/reference.py",),
    ),
    Note(
        "E6",
        "erratum",
        "acceleration in the observer",
        "The disturbance observer (3.1.3) uses the acceleration error ė₂, which is not measured.",
        "The speed error's difference over a sample and the acceleration of the last command.",
        modules=("controllers/laws/observer.py",),
    ),
    Note(
        "E7",
        "erratum",
        "factor lost in the switching control",
        "u_sw (3.1.1) lacks the factor p/(q β) |e₂|^(p/q−1) of its condition: the sliding variable follows the "
        "reaching law times that factor.",
        "The printed control.",
        keys=("controller.nftsm",),
        modules=("controllers/laws/nftsm.py",),
    ),
    Note(
        "E8",
        "erratum",
        "one γ, two units",
        "The same γ multiplies the anti-saturation state in the sliding surface and in the force (3.1.2).",
        "Two gains: gamma in m/(N s²) for the surface, gamma_force in 1/s for the force.",
        keys=("controller.auxiliary.gamma", "controller.auxiliary.gamma_force"),
        modules=("controllers/laws/auxiliary.py",),
    ),
    Note(
        "E9",
        "erratum",
        "algebraic loop in the winch control",
        "The feedforward torque (3.3) contains the drum's acceleration, which the same torque causes.",
        "The acceleration of the reference, divided by the drum radius.",
        modules=("controllers/coordinations/winch_pid.py", "controllers/controller.py"),
    ),
    Note(
        "E10",
        "erratum",
        "sign of the tension error",
        "The winch controllers' error is tension minus command (3.3): positive gains would drive the tension away.",
        "The error is command minus tension.",
        keys=("controller.winch_1", "controller.winch_2"),
        modules=("controllers/coordinations/winch_pid.py",),
    ),
    Note(
        "E11",
        "erratum",
        "limit of the wrong winch",
        "One condition for the saturation of winch 2 uses the upper limit of winch 1 (3.2).",
        "Both winches have the limits tension_min and tension_max.",
        keys=("controller.coordination.tension_min", "controller.coordination.tension_max"),
        modules=("controllers/coordinations/differential_tension.py",),
    ),
    Note(
        "A1",
        "assumption",
        "rope of zero length",
        "The stiffness E A / x of rope 2 (2.2) is infinite at the start, where x = 0.",
        "Each rope has a dead length between its drum and the rail's end.",
        keys=("plant.track.rope_offset",),
        modules=("model/ropes.py",),
    ),
    Note(
        "A2",
        "assumption",
        "slack ropes",
        "The tension equations (2.2) let a rope push.",
        "The sum of spring and damper force is never negative; a rope shorter than its rest length has no tension. "
        "With rope_slack = false the rope is the paper's.",
        keys=("plant.rope_slack",),
        modules=("model/ropes.py",),
    ),
    Note(
        "A3",
        "assumption",
        "rail friction",
        "The friction coefficient μ is not in Table 1.",
        "0.1, with the change of sign smoothed over 0.01 m/s.",
        keys=("plant.vehicle.friction_coefficient", "plant.vehicle.friction_velocity"),
        modules=("model/vehicle.py",),
    ),
    Note(
        "A4",
        "assumption",
        "area of the drag",
        "The area A_v of the drag is not given.",
        "6 m², diameter times height of the vehicle.",
        keys=("plant.vehicle.drag_area",),
        modules=("model/vehicle.py",),
    ),
    Note(
        "A5",
        "assumption",
        "winch friction",
        "The friction torque τ_f of the winches is not given.",
        "None by default; Coulomb and viscous friction can be set.",
        keys=(
            "plant.winch_1.coulomb_friction",
            "plant.winch_1.viscous_friction",
            "plant.winch_2.coulomb_friction",
            "plant.winch_2.viscous_friction",
        ),
        modules=("model/winch.py",),
    ),
    Note(
        "A6",
        "assumption",
        "added mass",
        "Neglected; for a full cylinder of the vehicle's size it would be about 9.4 × 10³ kg, as much as the vehicle.",
        "None by default; added_mass sets it.",
        keys=("plant.vehicle.added_mass",),
        modules=("model/vehicle.py",),
    ),
    Note(
        "A7",
        "assumption",
        "chatter of the odd power",
        "The term |e₂|^(1/3) (3.1.1) has an infinite slope at zero; sampled, it chatters.",
        "Below a speed error of 10⁻⁵ m/s every odd power is smoothed.",
        keys=("controller.nftsm.smoothing",),
        modules=("controllers/laws/nftsm.py",),
    ),
    Note(
        "A8",
        "assumption",
        "fuzzy rules",
        "Labels, membership functions, rules and scales of the fuzzy system (3.1.3) are not given.",
        "Five triangular labels per input, product inference, a symmetric table of rules; scaled, filtered inputs.",
        keys=(
            "controller.observer.error_scale",
            "controller.observer.rate_scale",
            "controller.observer.filter_time",
        ),
        modules=("controllers/laws/observer.py",),
    ),
    Note(
        "A9",
        "assumption",
        "gains of the observer",
        "L₀ and K_f (3.1.3) are not given.",
        "5 1/s each: the gain lies between 5 and 10 1/s.",
        keys=("controller.observer.l0", "controller.observer.kf"),
        modules=("controllers/laws/observer.py",),
    ),
    Note(
        "A10",
        "assumption",
        "gains of the anti-saturation system",
        "γ and k_a (3.1.2) are not given.",
        "10⁻⁵ for both γ, 1 1/s for k_a.",
        keys=("controller.auxiliary",),
        modules=("controllers/laws/auxiliary.py",),
    ),
    Note(
        "A11",
        "assumption",
        "gains of the winch controllers",
        "The PID gains of the winch controllers (3.3) are not given.",
        "5 × 10⁻⁴ N m/N, 2 × 10⁻² N m/(N s) and no derivative, for both winches.",
        keys=("controller.winch_1", "controller.winch_2"),
        modules=("controllers/coordinations/winch_pid.py",),
    ),
    Note(
        "A12",
        "assumption",
        "structure of the PID cascade",
        "The baseline is described by four numbers (4.1).",
        "A position loop commands a speed, a speed loop an acceleration; the integrals are held while they would drive "
        "the force further beyond its limit.",
        keys=("controller.pid_cascade",),
        modules=("controllers/laws/pid_cascade.py",),
    ),
    Note(
        "A13",
        "assumption",
        "window of the steady state",
        "The time interval of the steady-state figures (4.3) is not given.",
        "The constant-speed phase of the reference: 18 to 29 s of the profile, the last fifth of a uniform run "
        "(20 to 25 s).",
        keys=("reference.accelerate_until", "reference.cruise_until"),
        modules=("model/reference.py",),
    ),
    Note(
        "A14",
        "assumption",
        "mass and weight of ropes, winches",
        "Ropes have neither mass nor weight (2.2), gearboxes are rigid (2.4), and a drum of 1.6 m diameter has an "
        "inertia of 1.8 kg m² (Table 1). The rail is level, and friction on it the same at all speeds (2.3).",
        "The same by default. All of it can be set; the ensemble `site` has it.",
        keys=(
            "plant.rope_1.mass_per_length",
            "plant.rope_1.submerged_weight",
            "plant.track.roller_spacing",
            "plant.winch_1.rotor_inertia",
            "plant.winch_1.gear_stiffness",
            "plant.rope_1.hysteresis",
            "plant.vehicle.stiction",
            "plant.vehicle.bristle_stiffness",
            "plant.track.tilt",
        ),
        modules=("model/heavy_ropes.py", "model/winch.py", "model/friction.py", "model/vehicle.py"),
        page="site.md",
    ),
    Note(
        "A15",
        "assumption",
        "damping of the drums",
        "The winch controllers (3.3) act on the tension alone, which hardly damps a heavy drum on its rope.",
        "The same by default. With damping, the motor also opposes the drum's deviation from the reference speed.",
        keys=("controller.winch_1.damping",),
        modules=("controllers/coordinations/winch_pid.py",),
        page="site.md",
    ),
)
"""Every entry, errata first."""

INTRODUCTION = """\
The paper is Wu et al., "Motion Control of a Flexible-Towed Underwater Vehicle Based on Dual-Winch Differential
Tension Coordination Control", J. Mar. Sci. Eng. 2025, 13(6), 1120, doi:10.3390/jmse13061120. Its sections are given
in parentheses. An erratum (E) is a printed statement that cannot be meant; an assumption (A) supplies what the paper
leaves open and a simulation needs.
"""


def places(note: Note) -> tuple[str, ...]:
    """Configuration keys and source files of a note, in that order."""
    return note.keys + note.modules


def errata_markdown() -> str:
    """The table as Markdown: the whole content of docs/errata.md."""
    sources = (
        "The report of `dualwinch reproduce` has keys and source files of each, [the paper](paper.md) their effects."
    )
    lines = ["# Errata and assumptions", "", INTRODUCTION, sources, ""]
    for kind, heading in (("erratum", "Errata"), ("assumption", "Assumptions")):
        paper = "the paper prints" if kind == "erratum" else "the paper leaves open"
        lines += [
            f"## {heading}",
            "",
            f"| | about | {paper} | dualwinch does |",
            "|---|---|---|---|",
        ]
        for note in NOTES:
            if note.kind == kind:
                cells = (
                    note.id,
                    note.subject,
                    note.paper,
                    " ".join(filter(None, (note.here, note.effect, f"([more]({note.page}))" if note.page else ""))),
                )
                lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        lines.append("")
    return "\n".join(lines).rstrip("\n") + "\n"
