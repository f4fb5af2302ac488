"""The numbers a rollout takes at run time."""

from collections.abc import Mapping
from typing import Annotated, NamedTuple, get_type_hints


class Parameters(NamedTuple):
    """Numbers of an experiment, each with its key; ``hand_loop.c`` has them in the same order."""

    sample_time: Annotated[float, "simulation.sample_time"]
    mass: Annotated[float, "plant.vehicle.mass"]
    added_mass: Annotated[float, "plant.vehicle.added_mass"]
    drag_coefficient: Annotated[float, "plant.vehicle.drag_coefficient"]
    drag_area: Annotated[float, "plant.vehicle.drag_area"]
    diameter: Annotated[float, "plant.vehicle.diameter"]
    water_density: Annotated[float, "plant.vehicle.water_density"]
    normal_force: Annotated[float, "plant.vehicle.normal_force"]
    friction_coefficient: Annotated[float, "plant.vehicle.friction_coefficient"]
    friction_velocity: Annotated[float, "plant.vehicle.friction_velocity"]
    track_length: Annotated[float, "plant.track.length"]
    rope_offset: Annotated[float, "plant.track.rope_offset"]
    area_1: Annotated[float, "plant.rope_1.area"]
    modulus_1: Annotated[float, "plant.rope_1.modulus"]
    damping_1: Annotated[float, "plant.rope_1.damping"]
    area_2: Annotated[float, "plant.rope_2.area"]
    modulus_2: Annotated[float, "plant.rope_2.modulus"]
    damping_2: Annotated[float, "plant.rope_2.damping"]
    inertia_1: Annotated[float, "plant.winch_1.inertia"]
    drum_radius_1: Annotated[float, "plant.winch_1.drum_radius"]
    gear_ratio_1: Annotated[float, "plant.winch_1.gear_ratio"]
    inertia_2: Annotated[float, "plant.winch_2.inertia"]
    drum_radius_2: Annotated[float, "plant.winch_2.drum_radius"]
    gear_ratio_2: Annotated[float, "plant.winch_2.gear_ratio"]
    vortex: Annotated[float, "disturbance.vortex"]
    vortex_amplitude: Annotated[float, "disturbance.vortex_amplitude"]
    strouhal: Annotated[float, "disturbance.strouhal"]
    nominal_mass: Annotated[float, "nominal.vehicle.mass"]
    nominal_added_mass: Annotated[float, "nominal.vehicle.added_mass"]
    nominal_drag_coefficient: Annotated[float, "nominal.vehicle.drag_coefficient"]
    nominal_friction_coefficient: Annotated[float, "nominal.vehicle.friction_coefficient"]
    beta: Annotated[float, "controller.nftsm.beta"]
    eta: Annotated[float, "controller.nftsm.eta"]
    k: Annotated[float, "controller.nftsm.k"]
    phi: Annotated[float, "controller.nftsm.phi"]
    p: Annotated[float, "controller.nftsm.p"]
    q: Annotated[float, "controller.nftsm.q"]
    smoothing: Annotated[float, "controller.nftsm.smoothing"]
    l0: Annotated[float, "controller.observer.l0"]
    kf: Annotated[float, "controller.observer.kf"]
    error_scale: Annotated[float, "controller.observer.error_scale"]
    rate_scale: Annotated[float, "controller.observer.rate_scale"]
    filter_time: Annotated[float, "controller.observer.filter_time"]
    gamma: Annotated[float, "controller.auxiliary.gamma"]
    gamma_force: Annotated[float, "controller.auxiliary.gamma_force"]
    k_a: Annotated[float, "controller.auxiliary.k_a"]
    preload: Annotated[float, "controller.coordination.preload"]
    tension_min: Annotated[float, "controller.coordination.tension_min"]
    tension_max: Annotated[float, "controller.coordination.tension_max"]
    kp_1: Annotated[float, "controller.winch_1.kp"]
    ki_1: Annotated[float, "controller.winch_1.ki"]
    kp_2: Annotated[float, "controller.winch_2.kp"]
    ki_2: Annotated[float, "controller.winch_2.ki"]


def parameters_from(values: Mapping[str, float]) -> Parameters:
    """The parameters out of all numbers of an experiment by their keys."""
    hints = get_type_hints(Parameters, include_extras=True)
    return Parameters(*(values[hint.__metadata__[0]] for hint in hints.values()))
