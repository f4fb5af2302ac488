"""What functions say of arguments that they do not understand: one line, and no file; a row each."""

# pyright: reportArgumentType=false

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dualwinch as dw
from dualwinch.analysis.describing_function import amplitude_sweep
from dualwinch.analysis.linear_loop import linear_closed_loop, linear_open_loop
from dualwinch.analysis.preload import optimal_preload
from dualwinch.analysis.resonance import resonance_gains
from dualwinch.config.experiment_file import assigned
from dualwinch.controllers.laws.adrc import Adrc
from dualwinch.controllers.laws.nftsm import NftsmGains
from dualwinch.controllers.limits import Limits
from dualwinch.controllers.nominal import Nominal
from dualwinch.model.linear.properties import is_observable
from dualwinch.model.vehicle import Vehicle
from dualwinch.simulation.batch.scenarios import check_batch
from dualwinch.simulation.exogenous.signals import named_words
from dualwinch.simulation.prepare import prepare
from tests.own_ropes import Stiffening

SEA = dw.load_ensemble("sea")
L0, PRELOAD = "controller.observer.l0", "controller.coordination.preload"


def case(**values: Any) -> dw.Experiment:
    """Case 4 with other values; two underscores for a dot."""
    return dw.override(dw.case(4), {key.replace("__", "."): value for key, value in values.items()})


def built(**parts: Any) -> dw.Experiment:
    """An experiment of parts, those of its controller among them."""
    own = {name: parts.pop(name) for name in ("law", "limits", "nominal") if name in parts}
    return dw.Experiment(controller=dw.Controller(**own), **parts)


def checked(names: list[str], row: list[float], *scenarios: Any) -> None:
    """Check a batch of one row."""
    check_batch(names, np.array([row]), list(scenarios or [case()]))


def drawn(key: str, distribution: Any, *, relative: bool = False, **values: Any) -> dw.Ensemble:
    """An ensemble about Case 4 that draws one value."""
    return dw.Ensemble("one", "", case(**values), {key: dw.Drawn(distribution, relative=relative)})


EVEN, ADRC = {"controller__nftsm__p": 4}, {"controller__kind": "adrc"}

WRONG: list[tuple[Callable[[Path], object], str]] = [
    # linear loops
    (lambda _: dw.certify(case(controller__observer__l0=0.0)), "must be > 0, V divides"),
    (lambda _: amplitude_sweep(case(**ADRC)), "has no odd power"),
    (lambda _: amplitude_sweep(case(), amplitudes=(0.0,)), "amplitude = 0"),
    (lambda _: dw.large_signal_stability(case(**ADRC)), "has no odd power"),
    (lambda _: dw.large_signal_stability(case(), largest=1e-5), "largest = 1e-05: must be a finite number > 0.0001"),
    (lambda _: resonance_gains(case(controller__kind="pid-cascade")), "laws with odd powers of the speed error"),
    (lambda _: linear_closed_loop(case(), 60.0, 0.5), "x = 60"),
    (lambda _: linear_closed_loop(case(controller__coordination__kind="master-slave"), 25.0, 1.8), "no steady motion"),
    (lambda _: linear_open_loop(case(), opening="tau_3"), "unknown opening 'tau_3'; did you mean 'tau_"),
    (
        lambda _: is_observable(dw.linearise(case(), 25.0), ["omega1"]),
        "unknown output 'omega1'; did you mean 'omega_1'",
    ),
    (lambda _: optimal_preload(case(), minimise="torque"), "minimise = 'torque': must be one of load, peak, energy"),
    (lambda _: optimal_preload(case(), every=0), "every = 0: must be 1 to 12500 (a quarter of the samples)"),
    # experiments
    (lambda _: dw.override(dw.Experiment(), "a=b"), "values: must be a dictionary of keys and values, not str"),
    (lambda _: dw.override(dw.Experiment(), {1: 1}), "values: must be a text as key, not int"),
    (lambda _: dw.Experiment(plant=None), "plant: must be a Plant, not NoneType"),
    (lambda _: dw.Experiment(disturbance=dw.Disturbance(force=5.0)), "disturbance.force: must be a Signal, not float"),
    (lambda _: built(plant=dw.Plant(vehicle=Vehicle(mass=-1.0))), "plant.vehicle.mass = -1.0: must be a finite"),
    (lambda _: built(law=dw.Nftsm(NftsmGains(beta=0.0))), "controller.nftsm.beta = 0.0: must be a finite number > 0"),
    (lambda _: built(law=Adrc(observer_bandwidth=float("nan"))), "controller.adrc.observer_bandwidth = nan: must be"),
    (lambda _: built(limits=Limits(reserve=-1.0)), "controller.coordination.reserve = -1.0: must be a finite"),
    (lambda _: built(nominal=Nominal(mass=0.0)), "controller.nominal.mass = 0.0: must be a finite number > 0 kg"),
    (lambda _: built(simulation=dw.Simulation(substeps=257)), "substeps = 257: must be a whole number >= 1 and <= 256"),
    (lambda _: built(simulation=dw.Simulation(delay_samples=1.5)), "delay_samples = 1.5: must be a whole number >= 0"),
    (lambda _: built(reference=dw.Reference(kind="ramp")), 'reference.kind = "ramp": must be "uniform" or "profile"'),
    (lambda _: dw.load(None), "file: must be a path, not NoneType"),
    (lambda _: dw.load_ensemble(None), "file: must be a path, not NoneType"),
    (lambda _: prepare(None), "experiment: must be an Experiment, not NoneType"),
    (lambda _: dw.block(dw.Experiment()), "unknown block Experiment(plant="),
    (lambda _: dw.paper_controller(case()), "own: must be a Controller"),
    (
        lambda _: prepare(dw.case(4, rope=Stiffening(soft=1e12))),
        'for plant.rope_1.kind = "stiffening", which oscillates at ',
    ),
    (lambda _: case(simulation__seed=2**64), "seed = 18446744073709551616: must be"),
    *((lambda _, seed=seed: named_words(seed, [0], ["a"]), f"seed = {seed}: must be a whole") for seed in (-1, 2**64)),
    (lambda _: case(simulation__engine="casadis"), 'must be "compiled" or "casadi" or "interpreter"'),
    # runs
    (lambda _: dw.simulate(case(), engine="casadis"), "unknown engine 'casadis'; did you mean 'casadi'"),
    (lambda _: dw.simulate(case(reference__speed=1e3)), "plant.track.length"),
    (lambda _: dw.simulate(case(simulation__duration=1e6)), "stride = 1: must be >= "),
    *(
        (lambda _, stride=stride: dw.simulate(case(), stride=stride), "must be a whole number >= 0")
        for stride in (-1, 1.5, "2")
    ),
    (lambda _: dw.block("plnt"), "did you mean 'plant'? Must be one of controller, plant, closed-loop"),
    # batches
    (lambda _: checked(["simulation.sample_time"], [1e-3]), "unknown parameter 'simulation.sample_time'"),
    (lambda _: checked([], [], case(), case(**EVEN)), "scenarios[1]: controller.nftsm.p = 4: must be odd"),
    (
        lambda _: checked([], [], dw.Scenario(17, case(**EVEN), case().plant, {})),
        "scenario 17: controller.nftsm.p = 4: must be odd",
    ),
    (
        lambda _: dw.rollout(
            [], np.empty((1, 0)), [case(), case(simulation__sample_time=2e-3, simulation__duration=100)]
        ),
        "scenarios[1]: must have the structure and the length",
    ),
    (
        lambda _: dw.rollout(["plant.rope_1.damping"], [[1e3], [1e5]], [case(simulation__integrator="verlet")]),
        "parameters[1]: simulation.substeps = 5: must be >= ",
    ),
    # ensembles
    (
        lambda _: drawn("plant.vehicle.mass", dw.Uniform(-2, -1)).scenario(0, 0).experiment,
        "plant.vehicle.mass = -",
    ),
    (lambda _: dw.run_ensemble(SEA, 0, 1), "scenarios = 0: must be"),
    (lambda _: dw.run_ensemble(SEA, 1, -1), "seed = -1: must be"),
    (lambda _: dw.run_ensemble(drawn(PRELOAD, dw.Choice((100.0,))), 3, 0), f"scenario 0: {PRELOAD} = 100"),
    (lambda _: dw.compare({"a": case().controller}, SEA, 0, 0), "must be a whole number"),
    (lambda _: dw.compare({"a": case().controller}, SEA, 1, -1), "must be a whole number"),
    (lambda _: dw.compare({"a": case(**EVEN).controller}, SEA, 1, 0), "a: controller.nftsm.p = 4: must be odd"),
    (
        lambda _: dw.compare({"a": case().controller}, drawn(L0, dw.Uniform(1.0, 2.0), relative=True), 1, 0),
        f"{L0}: is drawn",
    ),
]


@pytest.mark.parametrize(("call", "message"), WRONG, ids=[message for _, message in WRONG])
def test_wrong_calls_are_one_line(call: Callable[[Path], object], message: str, tmp_path: Path) -> None:
    with pytest.raises(dw.ConfigurationError) as caught:
        call(tmp_path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


APART = [
    ("controller.nftsm.p=4", "controller.nftsm.p = 4: must be odd"),
    ("controller.nftsm.q=2", "controller.nftsm.q = 2: must be odd"),
    ("controller.nftsm.p=3", "controller.nftsm.p = 3: must be > controller.nftsm.q"),
    (f"{PRELOAD}=400", f"{PRELOAD} = 400: must be > 400 and < 12000 N"),
    (f"{PRELOAD}=12000", f"{PRELOAD} = 12000: must be > 400 and < 12000 N"),
    (
        "controller.coordination.tension_min=6000 controller.coordination.tension_max=200",
        "controller.coordination.tension_min = 6000: must be < controller.coordination.tension_max = 200 N",
    ),
    ("simulation.duration=1e-4", "simulation.duration = 0.0001: must be one to 1e+09 sample times"),
    ("simulation.duration=1e7", "simulation.duration = 1e+07: must be one to 1e+09"),
    ("simulation.integrator=rk4 simulation.substeps=1", "substeps = 1: must be >= 2 for rk4 at simulation.sample_time"),
    (
        "simulation.integrator=exponential simulation.substeps=8 simulation.sample_time=0.01",
        "simulation.substeps = 8: must be >= 9 for exponential",
    ),
    ("reference.accelerate_until=30", "accelerate_until, cruise_until, brake_until = 30, 29, 41: must be in ascending"),
    ("reference.jerk_limit=0.04", "jerk_limit = 0.04: must be >= 0.05 m/s^3, to change the speed by 1.8 m/s in 12 s"),
    ("reference.kind=uniform reference.jerk_limit=0.009", "reference.jerk_limit = 0.009: must be >= 0.0096 m/s^3"),
    (
        "reference.kind=uniform reference.speed=2.1",
        "reference.speed, simulation.duration: the reference ends at 52.5 m, must be <= plant.track.length = 50 m",
    ),
    ("reference.kind=uniform reference.speed=2.1 reference.jerk_limit=2", "the reference ends at 50.3"),
    ("plant.track.length=46", "the reference ends at 46.8 m, must be <= plant.track.length = 46 m"),
    ("reference.kind=file", 'reference.file: must be given where reference.kind = "file"'),
    ("reference.kind=way-points", "reference.points: must be one position or more"),
    ("reference.kind=way-points reference.points=[20,51]", "reference.points[1] = 51: must be <= plant.track.length"),
    (
        "reference.kind=way-points reference.points=[20,5] reference.pauses=[1]",
        "reference.pauses: has 1 numbers: must have 2, one a point",
    ),
    (
        "disturbance.current.times=[0,1] disturbance.current.values=[0,1] disturbance.current.unit=N",
        'disturbance.current: values: unit "N": must be one of m/s',
    ),
    (
        "disturbance.force.times=[0,1] disturbance.force.values=[0,1]",
        'disturbance.force: values: has no unit; say which: unit = "N"',
    ),
    ("sensors.tension=none", 'sensors.tension = "none": must be "load-cells"'),
    ("sensors.tension=none", "controller.tension_observer.bandwidth"),
    ("sensors.speed=none controller.estimator=none", 'sensors.speed = "none": must be "wheel"'),
    ("sensors.speed=none controller.estimator=kalman", "controller.kalman.speed_sensor = false"),
    ("plant.winch_1.drum_radius=1e200", "too extreme"),
    ("plant.rope_1.modulus=1e-323 plant.rope_1.area=1e-9", "too extreme"),
    (
        "plant.rope_2.modulus=1e-300 plant.rope_2.area=1e-9 controller.coordination.tension_max=1e20",
        "too extreme",
    ),
    ("plant.rope_*.mass_per_length=1e-308", "too extreme"),
]
"""Values of Case 2 that do not go together."""


@pytest.mark.parametrize(("words", "message"), APART)
def test_values_that_do_not_go_together_are_one_line(words: str, message: str) -> None:
    with pytest.raises(dw.ConfigurationError) as caught:
        prepare(dw.override(dw.case(2), assigned(words.split())))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
