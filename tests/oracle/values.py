"""Every number of the system and its default, by the product's configuration keys, in SI units."""

from collections.abc import Mapping
from types import SimpleNamespace

Values = Mapping[str, float]

_ROPE = {"area": 4.52e-4, "modulus": 80e9, "damping": 1000.0}
_WINCH = {
    "inertia": 1.8,
    "drum_radius": 0.8,
    "gear_ratio": 36.0,
    "coulomb_friction": 0.0,
    "viscous_friction": 0.0,
    "layer_thickness": 0.0,
    "layer_laps": 20.0,
    "radius_error": 0.0,
    "eccentricity": 0.0,
    "eccentricity_angle": 0.0,
    "torque_error": 0.0,
    "torque_ripple": 0.0,
    "ripple_waves": 6.0,
    "ripple_angle": 0.0,
}
_CREEP = {"elongation": 0.0, "time": 60.0}
_SENSORS = ("position_bias", "load_cell_error_1", "load_cell_error_2", "load_cell_zero_1", "load_cell_zero_2")
_WINCH_GAINS = {"kp": 5e-4, "ki": 2e-2, "kd": 0.0}

DEFAULTS: dict[str, float] = {
    "plant.rope_slack": True,
    "plant.vehicle.mass": 1e4,
    "plant.vehicle.added_mass": 0.0,
    "plant.vehicle.drag_coefficient": 0.3,
    "plant.vehicle.drag_area": 6.0,
    "plant.vehicle.diameter": 2.0,
    "plant.vehicle.height": 3.0,
    "plant.vehicle.water_density": 1000.0,
    "plant.vehicle.normal_force": 4.9e3,
    "plant.vehicle.friction_coefficient": 0.1,
    "plant.vehicle.friction_velocity": 0.01,
    "plant.track.length": 50.0,
    "plant.track.rope_offset": 0.5,
    **{f"plant.rope_{i}.{name}": value for i in (1, 2) for name, value in _ROPE.items()},
    **{f"plant.winch_{i}.{name}": value for i in (1, 2) for name, value in _WINCH.items()},
    **{f"plant.creep_{i}.{name}": value for i in (1, 2) for name, value in _CREEP.items()},
    "disturbance.vortex": False,
    "disturbance.vortex_amplitude": 0.2,
    "disturbance.strouhal": 0.2,
    "disturbance.integrated_phase": False,
    "controller.speed_filter_time": 0.0,
    "controller.nftsm.beta": 0.05,
    "controller.nftsm.eta": 0.05,
    "controller.nftsm.k": 0.5,
    "controller.nftsm.phi": 0.5,
    "controller.nftsm.p": 5,
    "controller.nftsm.q": 3,
    "controller.nftsm.smoothing": 1e-5,
    "controller.nftsm.linear_speed": 0.0,
    "controller.observer.l0": 5.0,
    "controller.observer.kf": 5.0,
    "controller.observer.error_scale": 0.1,
    "controller.observer.rate_scale": 0.5,
    "controller.observer.filter_time": 0.2,
    "controller.auxiliary.gamma": 1e-5,
    "controller.auxiliary.gamma_force": 1e-5,
    "controller.auxiliary.k_a": 1.0,
    "controller.pid_cascade.kp1": 10.0,
    "controller.pid_cascade.ki1": 0.1,
    "controller.pid_cascade.kd1": 0.0,
    "controller.pid_cascade.kp2": 2.0,
    "controller.pid_cascade.ki2": 0.05,
    "controller.pid_cascade.kd2": 0.0,
    "controller.coordination.preload": 2000.0,
    "controller.coordination.tension_min": 200.0,
    "controller.coordination.tension_max": 6000.0,
    **{f"controller.winch_{i}.{name}": value for i in (1, 2) for name, value in _WINCH_GAINS.items()},
    "simulation.sample_time": 1e-3,
    "simulation.delay_samples": 0,
    **{f"sensors.{name}": 0.0 for name in _SENSORS},
}


def group(values: Values, prefix: str) -> SimpleNamespace:
    """The values whose keys begin with a prefix, as attributes."""
    return SimpleNamespace(
        **{key.removeprefix(prefix): value for key, value in values.items() if key.startswith(prefix)}
    )
