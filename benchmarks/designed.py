"""Starts designed for drawn machines: which are stable, which satisfy every bound, and what limits them.

``uv run python -m benchmarks.designed`` draws 30 machines (`machine`), designs a controller for each
(`dualwinch.designed`) and prints a row for each; ``--write FILE`` puts the table between the file's two marks.
``--tune ROLLOUTS`` searches from each start as well; ``--machines 3 17`` takes some of them.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import dualwinch as dw
from benchmarks.document import markdown, put, times
from dualwinch.analysis.design import Design, designed
from dualwinch.analysis.large_signal import large_signal_stability
from dualwinch.analysis.margin_survey import UNSTABLE
from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.ensembles.ensemble import Drawn, Ensemble, LogUniform, Uniform
from dualwinch.simulation.loop.structure import stable_substeps
from dualwinch.tuning.options import TuningOptions
from dualwinch.tuning.problem import DESIGN, TuningProblem
from dualwinch.tuning.scoring.rollouts import run_pairs, worst_of
from dualwinch.tuning.scoring.training_set import controlled_as, training_scenarios
from dualwinch.tuning.tune import tune
from dualwinch.tuning.tuning_problem import tuning_problem

MACHINES, SEED = 30, 0
"""Number of machines, and the seed from which each is drawn with its number."""

STEEL, GRAVITY, STRENGTH, ROPE_MODULUS, FILL = 7850.0, 9.81, 630e6, 1e11, 0.455
"""Density in kg/m³ and gravity; of a steel wire rope: breaking force over diameter² in Pa, 6x36 of grade 1770
(EN 12385-4), modulus in Pa, and metallic area over diameter²."""

HEADINGS = (
    "machine",
    "mass (t)",
    "track (m)",
    "rope (mm)",
    "sample (ms)",
    "bandwidth (rad/s)",
    "limited by",
    "left by margins",
    "stable",
    "disk",
    "speed errors up to (cm/s)",
    "violated",
)


def machine(number: int) -> Ensemble:
    """A drawn machine with all effects and sensors of the ensemble ``site``, each in proportion to its size.

    Log-uniform draws: mass (1 to 200 t), length (5 to 300 m), acceleration (0.05 to 0.5 m/s²), speed (0.2 to 2 m/s, at
    most what a fifth of the track allows), sampling (0.5 to 10 ms); and reserves: of the motors over the force that the
    motion demands (2 to 4), of the rope's breaking force over the motors' (6 to 25; the rope 3 to 50 mm), of the drum's
    radius over the rope's diameter (10 to 35), of the drum's inertia over that of its shell (1 to 3). From these:

    - Vehicle: frontal area and width grow with mass^(2/3) and mass^(1/3), from those of the paper; so does the rail's
      load, with mass.
    - Force: acceleration, friction at its upper tolerance, drag at full speed with the current. Motors: that times the
      reserve; preload and least tension are the paper's shares of it.
    - Drum: one layer of rope, a shell half as thick as the rope. Motor: 1500 revolutions a minute at full speed; the
      rotor's inertia is 3.5e-5 kg m² of a motor of 1 N m and grows by the power 1.3 (as from servo motors of 2 to
      1500 N m); the gearbox turns by 1/300 rad at full torque, with a loss factor
      of 0.07 at the resonance of the rotor; 2 % of the torque is friction.
    - Rope: 1 mm of its diameter weighs 0.409/100 kg/m; a loss factor of 0.05 at the resonance of the drum.
    - Tolerances are those of ``site``; where they are sizes there, they are the same shares of this machine.
    """
    random = np.random.default_rng([SEED, number])

    def between(low: float, high: float) -> float:
        return float(low * (high / low) ** random.random())

    site = dw.load_ensemble("site")
    mass, length = between(1e3, 2e5), between(5.0, 300.0)
    acceleration, speed = between(0.05, 0.5), between(0.2, 2.0)
    sample_time = between(0.5e-3, 1e-2)
    of_motors, of_rope, of_drum, of_shell = between(2, 4), between(6, 25), between(10, 35), between(1, 3)
    size = (mass / 1e4) ** (1 / 3)
    speed = min(speed, math.sqrt(0.2 * length * acceleration))
    rail_load, area = 0.49 * mass, 6.0 * size**2
    current = 0.154
    force = mass * acceleration + 0.1 * 1.5**2 * rail_load + 0.5 * 1000 * 0.3 * 1.2 * area * (speed + current) ** 2
    tension = of_motors * force
    diameter = min(max(math.sqrt(of_rope * tension / STRENGTH), 3e-3), 0.05)
    weight = 4090 * diameter**2
    stiffness = FILL * diameter**2 * ROPE_MODULUS
    radius, spare = of_drum * diameter, 0.2 * length
    width = (length + spare) / (2 * math.pi * radius) * 1.1 * diameter
    inertia = of_shell * 2 * math.pi * radius * width * 0.5 * diameter * STEEL * radius**2
    torque, ratio = tension * radius, 50 * math.pi * radius / speed
    rotor = 3.5e-5 * (torque / ratio) ** 1.3
    gear, reflected = 300 * torque, rotor * ratio**2
    drum_spring = stiffness / (length / 2)
    sides = {
        "rope": {
            "diameter": diameter,
            "area": FILL * diameter**2,
            "modulus": ROPE_MODULUS,
            "damping": 0.05 * math.sqrt(drum_spring * (inertia + reflected)) / radius,
            "mass_per_length": weight,
            "submerged_weight": GRAVITY * weight * (1 - 1000 / STEEL),
            "added_mass_per_length": 0.25 * weight,
            "spare_length": spare,
            "shortest_mass": 0.3 * length,
            "hysteresis": tension * 1e-3,
        },
        "winch": {
            "inertia": inertia,
            "drum_radius": radius,
            "gear_ratio": ratio,
            "rotor_inertia": rotor,
            "gear_stiffness": gear,
            "gear_damping": 0.07 * math.sqrt(gear * reflected),
            "coulomb_friction": 0.02 * torque,
        },
    }
    values = {
        f"plant.{part}_{number}.{name}": value
        for number in (1, 2)
        for part, numbers in sides.items()
        for name, value in numbers.items()
    }
    begin, way = 0.9 * length, min(0.8 * length, 20 * speed)
    values |= {
        "plant.vehicle.mass": mass,
        "plant.vehicle.diameter": 2.0 * size,
        "plant.vehicle.height": 3.0 * size,
        "plant.vehicle.drag_area": area,
        "plant.vehicle.normal_force": rail_load,
        "plant.vehicle.bristle_stiffness": 0.1 * rail_load / 1e-4,
        "plant.vehicle.bristle_damping": 0.4 * math.sqrt(0.1 * rail_load / 1e-4 * mass),
        "plant.track.length": length,
        "plant.track.rope_offset": max(0.01 * length, 0.1),
        "controller.coordination.tension_max": tension,
        "controller.coordination.tension_min": tension / 30,
        "controller.coordination.preload": tension / 3,
        "reference.kind": "way-points",
        "reference.points": [begin, begin - way],
        "reference.pauses": [3.0, 3.0],
        "reference.speed": speed,
        "reference.acceleration": acceleration,
        "reference.jerk_limit": acceleration,
        "simulation.sample_time": sample_time,
        "simulation.torque_step": 1e-3 * torque / ratio,
        "sensors.tension_noise": tension / 600,
    }
    relative = {
        "rope_{}.damping": LogUniform(0.1, 1.0),
        "rope_{}.hysteresis": Uniform(0.2, 2.0),
        "winch_{}.gear_stiffness": Uniform(0.36, 2.0),
    }
    absolute = {
        "plant.winch_{}.eccentricity": Uniform(0, diameter / 240),
        "plant.winch_{}.layer_thickness": Uniform(0, diameter / 120),
        "plant.creep_{}.elongation": Uniform(0, 1e-5 * length),
        "sensors.load_cell_zero_{}": Uniform(-tension / 200, tension / 200),
    }
    drawn = dict(site.distributions) | {
        f"plant.{key.format(number)}": Drawn(distribution, relative=True)
        for key, distribution in relative.items()
        for number in (1, 2)
    }
    drawn |= {key.format(number): Drawn(distribution) for key, distribution in absolute.items() for number in (1, 2)}
    return with_stable_substeps(Ensemble(f"machine {number}", "", dw.override(site.experiment, values), drawn))


def with_stable_substeps(ensemble: Ensemble) -> Ensemble:
    """The ensemble with sub-steps for its stiffest draws, a power of four: few structures, so little to compile."""
    experiment = ensemble.experiment
    simulation, limits = experiment.simulation, experiment.controller.limits
    draws = ensemble.chosen(range(64), SEED)
    needed = max(stable_substeps(draw.experiment.plant, simulation, "verlet", limits) for draw in draws)
    steps = 4 ** math.ceil(math.log(1.1 * needed, 4))
    return replace(ensemble, experiment=dw.override(experiment, {"simulation.substeps": steps}))


@dataclass(frozen=True)
class Start:
    """A designed start, and its worst violations of bounds on runs in the training set."""

    problem: TuningProblem
    design: Design
    violations: tuple[str, ...]

    @classmethod
    def of(cls, ensemble: Ensemble) -> "Start":
        """The start of a search on a machine, as `tune` designs it."""
        options = TuningOptions(population=60)
        problem = tuning_problem(ensemble=ensemble, seed=SEED, options=options)
        seed, checks = problem.stream(DESIGN), problem.options.machines
        design = designed(problem.drawn_ensemble, seed=seed, checks=checks, compiled=True)
        random, hard = training_scenarios(problem)
        runs = run_pairs([], [[]], controlled_as(design.experiment, [*random, *hard]), 1)
        violations = [bound.statistic.name for bound in problem.constraints if (worst_of(runs, [bound]) > 0).any()]
        return cls(problem, design, (*design.violations, *violations))

    @property
    def stable(self) -> bool:
        """Whether the loop is stable on all machines of the survey."""
        return not any(margin.reason == UNSTABLE for margin in self.design.margins.values())

    def row(self) -> list[str]:
        """The cells of the table."""
        design, plant = self.design, self.design.experiment.plant
        try:
            speed = f"{100 * large_signal_stability(design.experiment).amplitude:.3g}"
        except ConfigurationError:
            speed = "–"
        left = design.bandwidth / design.limits[0].bandwidth
        return [
            f"{plant.vehicle.mass / 1e3:.3g}",
            f"{plant.track.length:.3g}",
            f"{1e3 * plant.rope_1.diameter:.3g}",
            f"{1e3 * design.experiment.simulation.sample_time:.2g}",
            f"{design.bandwidth:.3g}",
            design.limits[0].cause,
            f"{100 * left:.0f} %",
            "yes" if self.stable else "no",
            f"{design.margins['disk'].value:.2f}",
            speed,
            ", ".join(self.violations) or "–",
        ]


TUNED = "best", "start's mean MSE over the best's", "draws with a violation"
"""Further headings where a search begins with each start."""


def tuned_row(start: Start, rollouts: int) -> list[str]:
    """Further cells: what a search makes of a start, and the certified probability of a violation."""
    verdict = tune(start.problem, rollouts=rollouts, test_scenarios=100).verdict
    errors = [verdict.statistics(name, feasible=True)["mean.mse"] for name in ("start", "best")]
    certificate = verdict.certificate
    stated = f"≤ {100 * certificate.supported:.2g} %" if certificate else "–"
    certified = "" if certificate and certificate.satisfied else ", not certified"
    best = f"trial {verdict.best.number}" if verdict.improved else "the start"
    return [f"{best}{certified}", times(errors[0] / errors[1]), stated]


def table(numbers: Sequence[int], rollouts: int | None = None) -> str:
    """A row for each machine; below it what all have in common, and the shares that are stable and feasible."""
    starts, rows = list[Start](), list[list[str]]()
    for number in numbers:
        start = Start.of(machine(number))
        starts.append(start)
        rows.append([str(number), *start.row(), *(tuned_row(start, rollouts) if rollouts else ())])
        sys.stderr.write(f"{' | '.join(rows[-1])}\n")
        sys.stderr.flush()
    stable = sum(start.stable for start in starts)
    feasible = sum(not start.violations for start in starts)
    columns = [*zip((*HEADINGS, *(TUNED if rollouts else ())), *rows, strict=True)]
    common = [f"{heading}: {cells[0]}" for heading, *cells in columns if len(rows) > 1 and len({*cells}) == 1]
    headings, *rows = zip(*(column for column in columns if len(rows) == 1 or len({*column[1:]}) > 1), strict=True)
    summary = f"Common to all: {'; '.join(common)}. " if common else ""
    shares = f"{stable} of {len(starts)} starts are stable, {feasible} satisfy every bound."
    return f"{markdown(headings, rows)}\n\n*{summary}{shares}*"


def main() -> None:
    """Design, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--machines", nargs="+", type=int, default=range(MACHINES), metavar="N")
    parser.add_argument("--tune", type=int, metavar="ROLLOUTS", help="search from each start")
    parser.add_argument("--write", type=Path, metavar="FILE", help="document whose table is replaced")
    arguments = parser.parse_args()
    text = table(arguments.machines, arguments.tune)
    print(text)
    if arguments.write:
        put(arguments.write, "designed", text)


if __name__ == "__main__":
    main()
