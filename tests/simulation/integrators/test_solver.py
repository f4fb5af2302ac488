"""Which integrator solves an experiment, and with how many sub-steps it is stable."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from dualwinch.controllers.limits import Limits
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.model.ropes import Rope, RopeLaw, Track
from dualwinch.model.scalar import Scalar
from dualwinch.model.winch import Winch
from dualwinch.simulation.batch.scenarios import check_group, scenario_groups
from dualwinch.simulation.ensembles.ensemble import Drawn, Ensemble, Uniform
from dualwinch.simulation.ensembles.run import run_ensemble
from dualwinch.simulation.experiment import Experiment, IntegratorName, Simulation
from dualwinch.simulation.integrators import INTEGRATORS
from dualwinch.simulation.integrators.stability import fastest_rate, swing_rate
from dualwinch.simulation.loop.structure import Solver, solver_of, stable_substeps, substeps_for, swing_rates
from dualwinch.simulation.paper import case
from dualwinch.simulation.prepare import prepare
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from tests.last_bit import LAST_BIT, SEEDS, perturbed
from tests.own_ropes import Bedding, Stiffening
from tests.tiers import all_but


@pytest.mark.parametrize("integrator", ["adaptive", "exponential", "rk4"])
def test_kelvin_voigt_ropes_take_the_integrator_that_is_asked_for(integrator: IntegratorName) -> None:
    asked = override(case(4), {"simulation.integrator": integrator, "simulation.substeps": 3})
    assert solver_of(asked) == Solver(integrator, 3)


@pytest.mark.parametrize("integrator", ["adaptive", "exponential", "rk4"])
def test_any_other_rope_takes_rk4(integrator: str) -> None:
    assert solver_of(override(case(4, rope=Stiffening()), {"simulation.integrator": integrator})).integrator == "rk4"
    mixed = override(case(4), {"simulation.integrator": integrator})
    assert solver_of(replace(mixed, plant=replace(mixed.plant, rope_2=Bedding()))).integrator == "rk4"


def test_its_sub_steps_keep_up_with_the_stiffest_spring() -> None:
    soft, stiff = case(4, rope=Stiffening()), case(4, rope=Stiffening(soft=4e8))
    assert solver_of(soft).substeps < solver_of(stiff).substeps
    assert solver_of(stiff).substeps & (solver_of(stiff).substeps - 1) == 0
    assert solver_of(override(stiff, {"simulation.substeps": 100})).substeps == 100
    assert (
        solver_of(override(stiff, {"controller.coordination.tension_max": 6e4})).substeps >= solver_of(stiff).substeps
    )


def test_the_fastest_swing_is_that_of_the_shortest_rope() -> None:
    rope, winch, track = Rope(damping=0.0), Winch(), Track()
    assert fastest_rate(rope, winch, track, (1000.0,)) == pytest.approx(swing_rate(rope, winch, track))
    overdamped = Rope(damping=1e6)
    decay = 0.8**2 / 1.8 * 1e6
    assert fastest_rate(overdamped, winch, track, (1000.0,)) == pytest.approx(decay, rel=0.01)


@dataclass(frozen=True)
class Weak(RopeLaw):
    """A rope that never pulls more than 3 kN."""

    kind: ClassVar = "weak"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:  # noqa: ARG002
        strain = stretch / length
        return 3000 * strain / (strain + 1e-3)


@dataclass(frozen=True)
class Backwards(RopeLaw):
    """A rope that pushes."""

    kind: ClassVar = "backwards"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:  # noqa: ARG002
        return -1e6 * stretch


@pytest.mark.parametrize("rope", [Weak(), Backwards()], ids=["weak", "backwards"])
def test_a_rope_that_cannot_hold_the_tensions_is_an_error(rope: Any) -> None:
    with pytest.raises(ConfigurationError) as caught:
        prepare(case(4, rope=rope))
    message = f"plant.rope_1: the tension of '{rope.kind}' must grow with the stretch, at 200 to 9000 N too"
    assert str(caught.value) == message


def both(experiment: Experiment, /, **values: float) -> Experiment:
    """The experiment with the same numbers on both sides: ``rope__damping`` is that of either rope."""
    parts = {name.replace("__", "_{}.", 1): value for name, value in values.items()}
    keys = {f"plant.{name.format(side)}": value for name, value in parts.items() for side in (1, 2)}
    return override(experiment, keys | {"simulation.duration": 0.2})


def fastest(experiment: Experiment) -> float:
    integrator = solver_of(experiment).integrator
    return max(map(float, swing_rates(experiment.plant, integrator, experiment.controller.limits).values()))


GEARED = {"winch__inertia": 120.0, "winch__rotor_inertia": 0.02, "winch__gear_stiffness": 1.4e6}
STEEL = {"rope__mass_per_length": 2.36}
STIFF: dict[str, dict[str, float]] = {
    "damped rope with mass": STEEL | {"rope__damping": 3e4},
    "light damped rope": {"rope__mass_per_length": 0.3, "rope__damping": 2e4},
    "eight segments": STEEL | {"rope__segments": 8, "winch__inertia": 120.0},
    "loss factor": STEEL | {"rope__loss_factor": 10.0},
    "hysteresis": STEEL | {"rope__hysteresis": 14.0},
    "damped gearbox": GEARED | {"winch__gear_damping": 1e6},
    "stiff gearbox": GEARED | {"winch__gear_stiffness": 1e9, "winch__gear_damping": 500.0},
    "loss of the gearbox": STEEL | {"winch__gear_loss": 0.5, "winch__inertia": 1.0},
    "sheaves": STEEL | {"winch__sheave_friction": 0.5, "winch__inertia": 1.0},
    "viscous friction": STEEL | {"winch__viscous_friction": 2e6},
    "sag": {"rope__mass_per_length": 0.05, "rope__submerged_weight": 10.0, "rope__damping": 100.0},
}


def verlet_step(plant: Any, h: float, x: float) -> Any:
    """Matrix of one Verlet step, about rest at x, written out for rope 2 without sag, in stretches and speeds.

    In positions the common one would give the eigenvalue 1 twice with a single eigenvector, which a relative error of
    1e-16 moves by 1e-8.
    """
    rope, winch, length = plant.rope_2, plant.winch_2, x + plant.track.rope_offset
    radius, n = winch.drum_radius, rope.segments if rope.mass_per_length else 1
    mu, scaled = rope.mass_per_length, max(length, rope.shortest_mass)
    rotor = winch.gear_ratio**2 * winch.rotor_inertia / radius**2
    drum = winch.inertia / radius**2 + mu * (plant.track.length - x + scaled / 2 / n)
    masses = [rotor, drum, *[mu * scaled / n] * (n - 1), plant.vehicle.mass + mu * scaled / 2 / n]
    spring, viscosity = rope.modulus * rope.area / length, rope.damping
    viscosity += 2 / math.pi * rope.loss_factor * math.sqrt(rope.modulus * rope.area * mu)
    pulls = np.zeros((n + 2, n + 1))  # force on each body by the stretch rate of each link, and by its stretch
    forces, dampings = pulls.copy(), pulls.copy()
    for link in range(n + 1):
        loss = (1 + winch.gear_loss) * math.exp(winch.sheave_friction) - 1 if link == 1 else 0.0
        pulls[link : link + 2, link] = -1 - loss, 1
        stiff, viscous = (n * spring, n * viscosity) if link else (winch.gear_stiffness, winch.gear_damping)
        scale = 1 if link else radius**2
        forces[:, link], dampings[:, link] = pulls[:, link] * stiff / scale, pulls[:, link] * viscous / scale
    rubbing = 2 * rope.hysteresis / (rope.hysteresis_strain * length)  # along the whole rope
    forces[1, 1:] -= rubbing
    forces[n + 1, 1:] += rubbing
    used = slice(0 if winch.gear_stiffness else 1, None)
    weights = np.array(masses)[used, None]
    apart = -np.diff(np.eye(len(weights)), axis=0)  # speeds -> stretch rates
    k, damping = forces[used, used] / weights, dampings[used, used] @ apart / weights
    place = 1 if winch.gear_stiffness else 0
    damping[place, place] -= winch.viscous_friction / radius**2 / masses[1]
    bodies, links = k.shape
    drift = np.block([[np.eye(links), h / 2 * apart], [np.zeros((bodies, links)), np.eye(bodies)]])
    kick = np.block([[np.eye(links), np.zeros((links, bodies))], [h * k, np.eye(bodies)]]) @ drift
    kick[links:, links:] += h * damping  # the damping force is that of the speed at the beginning
    return drift @ kick


def growth(plant: Any, h: float) -> list[float]:
    """Spectral radius of a Verlet step with its longest or shortest rope, on each of ten computers."""
    steps = [verlet_step(plant, h, x) for x in (0.0, plant.track.length)]
    return [max(float(np.abs(np.linalg.eigvals(step)).max()) for step in perturbed(steps, seed)) for seed in SEEDS]


@pytest.mark.parametrize("values", [each for name, each in STIFF.items() if name != "sag"], ids=[*STIFF][:-1])
def test_the_limit_of_verlet_is_that_of_its_matrix(values: Mapping[str, float]) -> None:
    plant = both(case(4), **values).plant
    limit = 2 / fastest(both(case(4), **values))
    assert (
        max(growth(plant, 0.99 * limit)) < 1 + 10 * LAST_BIT
    )  # all eigenvalues near 1 are simple and well conditioned
    assert min(growth(plant, 1.01 * limit)) > 1.01


@pytest.mark.parametrize("name", all_but([*STIFF][::4], STIFF))
def test_stability_limits_do_not_hang_on_the_last_bit(name: str) -> None:
    experiment = both(case(4), **STIFF[name])
    for integrator in ("verlet", "rk4"):
        rates = swing_rates(experiment.plant, integrator, experiment.controller.limits)
        for seed in SEEDS:
            moved = perturbed(experiment, seed)
            near = swing_rates(moved.plant, integrator, moved.controller.limits)
            tolerance = 1e-12 if integrator == "verlet" else 1e-7  # poles may be double
            assert np.array([*near.values()], float) == pytest.approx(np.array([*rates.values()], float), rel=tolerance)


@pytest.mark.parametrize("values", STIFF.values(), ids=STIFF)
def test_stiff_plants_are_refused_or_right(values: Mapping[str, float]) -> None:
    """One sub-step less than required is refused, or increased; that many give the peak tension of very short ones."""
    adaptive = both(case(4), **values)
    experiment = override(adaptive, {"simulation.integrator": "verlet"})
    needed = math.ceil(fastest(experiment) * 1e-3 / INTEGRATORS["verlet"].reach)
    with pytest.raises(
        ConfigurationError, match=rf"^simulation\.substeps = {needed - 1}: must be >= {needed} for verl"
    ):
        prepare(override(experiment, {"simulation.substeps": needed - 1}))
    solver = solver_of(override(adaptive, {"simulation.substeps": needed - 1}))
    assert needed <= solver.substeps < 2 * needed
    assert solver_of(override(adaptive, {"simulation.substeps": needed})).substeps == needed
    found, fine = (simulate(override(experiment, {"simulation.substeps": n})) for n in (needed, 256))
    assert found.outcome == fine.outcome == "completed"
    assert found.metrics.peak_tension == pytest.approx(fine.metrics.peak_tension, rel=1e-3)


def test_a_massless_damped_rope_needs_shorter_steps_of_each_explicit_method() -> None:
    damped = both(case(4), rope__damping=1e5)
    for integrator, needed in (("rk4", 13), ("verlet", 22)):
        with pytest.raises(ConfigurationError, match=rf"must be >= {needed} for {integrator} .*the shortest rope "):
            prepare(override(damped, {"simulation.integrator": integrator}))
    prepare(damped)


def test_many_plants_at_once_have_the_rates_of_each() -> None:
    plant = both(case(4), **GEARED, **STEEL, rope__submerged_weight=20.0, rope__hysteresis=7.0).plant
    numbers = {
        "plant.rope_1.loss_factor": [0.01, 10.0, 3.0],
        "plant.rope_2.shortest_mass": [6.0, 0.0, 80.0],
        "plant.rope_2.damping": [1e3, 1e4, 1e4],
        "plant.winch_2.gear_damping": [0.0, 500.0, 1e6],
        "plant.track.roller_spacing": [0.0, 0.02, 1.0],
        "plant.vehicle.mass": [1e4, 1.0, 1e5],
    }
    columns = {key: np.array(values) for key, values in numbers.items()}
    each = [with_leaves(plant, {key: values[row] for key, values in numbers.items()}, "plant.") for row in range(3)]
    for integrator in ("verlet", "rk4"):
        rest = Simulation(), integrator, Limits()
        together = substeps_for(with_leaves(plant, columns, "plant."), *rest)
        assert together == pytest.approx([float(substeps_for(one, *rest)) for one in each], rel=1e-9)


def test_draws_with_stiffer_ropes_have_the_sub_steps_they_need() -> None:
    stiff = both(case(4), **STEEL)
    needed = solver_of(override(stiff, {"simulation.substeps": 1})).substeps
    nominal = override(stiff, {"simulation.substeps": needed, "simulation.duration": 0.05})
    factor = Drawn(Uniform(0.5, 20.0), relative=True, together="lot")
    ensemble = Ensemble("", "", nominal, {f"plant.rope_{number}.modulus": factor for number in (1, 2)})
    draws = ensemble.chosen(range(8), 0)
    alone = [solver_of(draw.experiment).substeps for draw in draws]
    groups = scenario_groups(draws)
    assert len(groups) == len(set(alone)) > 1
    for group in groups:
        check_group(group, draws)
        assert {solver_of(group.experiment).substeps} == {alone[place] for place in group.members}
    together = run_ensemble(ensemble, 8, 0, traces=False).metrics["peak_tension"]
    for place, draw in enumerate(draws):
        assert together[place] == pytest.approx(simulate(draw.experiment).metrics.peak_tension)


@dataclass(frozen=True)
class Fibre(RopeLaw):
    """A Kelvin–Voigt rope as a user's own law."""

    kind: ClassVar = "fibre"

    def tension(self, stretch: Scalar, stretch_rate: Scalar, length: Scalar) -> Scalar:
        return 36.16e6 * stretch / length + 1000 * stretch_rate


OWN = {
    "eight segments": STEEL | {"rope__segments": 8, "winch__inertia": 120.0},
    "four light segments": {"rope__mass_per_length": 1.0, "rope__segments": 4},
    "gearbox": {"winch__rotor_inertia": 0.001, "winch__gear_stiffness": 1e8},
}


@pytest.mark.parametrize("values", OWN.values(), ids=OWN)
def test_own_ropes_get_the_sub_steps_of_their_whole_chain(values: Mapping[str, float]) -> None:
    given = both(case(4), **values)
    own = override(both(case(4, rope=Fibre()), **values), {"simulation.substeps": 1})
    substeps = stable_substeps(given.plant, given.simulation, "verlet", given.controller.limits)
    assert substeps <= solver_of(own).substeps < 2 * max(substeps, 8)
    found, fine = simulate(own), simulate(override(given, {"simulation.substeps": 256}))
    assert found.outcome == "completed"
    assert found.metrics.peak_tension == pytest.approx(fine.metrics.peak_tension, rel=1e-2)


BEYOND = {
    "hysteresis": ({"rope__hysteresis": 1e12}, "plant.rope_1.hysteresis = 1e+12"),
    "rotor": (
        {"winch__rotor_inertia": 1e-300, "winch__gear_stiffness": 1e6},
        "plant.winch_1.rotor_inertia = 1e-300, plant.winch_1.gear_stiffness = 1e+06",
    ),
    "loss factor": (STEEL | {"rope__loss_factor": 1e300}, "plant.rope_1.loss_factor = 1e+300"),
    "bristles": ({"vehicle": 1e20}, "plant.vehicle.bristle_stiffness = 1e+20"),
}


@pytest.mark.parametrize("rope", [None, Fibre()], ids=["kelvin-voigt", "own"])
@pytest.mark.parametrize(("values", "key"), BEYOND.values(), ids=BEYOND)
def test_no_more_sub_steps_are_asked_for_than_are_allowed(values: Mapping[str, float], key: str, rope: Any) -> None:
    if rope and "loss" in key:
        return
    stiffness = {"plant.vehicle.bristle_stiffness": values["vehicle"]} if "vehicle" in values else {}
    others = {name: value for name, value in values.items() if name != "vehicle"}
    experiment = override(both(case(4, rope=rope) if rope else case(4), **others), stiffness)
    with pytest.raises(ConfigurationError) as caught:
        prepare(experiment)
    message = str(caught.value)
    named = re.escape('plant.rope_1.kind = "fibre"' if rope and "rope" in key else key)
    assert re.match(rf"simulation\.sample_time = 0\.001: must be <= \S+ s for {named}", message)
    assert "with 256 sub-steps of verlet" in message
    assert len(message) < 300


def test_a_sample_time_that_is_short_enough_is_accepted() -> None:
    experiment = both(case(4), rope__hysteresis=1e6)
    with pytest.raises(ConfigurationError) as caught:
        prepare(experiment)
    allowed = float(re.findall(r"must be <= (\S+) s", str(caught.value))[0])
    prepare(override(experiment, {"simulation.sample_time": 0.999 * allowed, "simulation.substeps": 256}))
