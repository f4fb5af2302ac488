"""FMUs of the controller, the plant and the closed loop in the hands of FMPy and CasADi's importer."""

import re
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2Error
from fmpy.validation import validate_fmu

from dualwinch.codegen.compiler import find_compiler
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.loop.closed_loop import exogenous_names
from dualwinch.simulation.paper import case
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.fmu.build import PLATFORMS, compiler_for
from dualwinch.toolboxes.fmu.export import export_fmu
from dualwinch.toolboxes.fmu.model import Version
from tests.conftest import PaperRun
from tests.fmus import Exported, Instance
from tests.tiers import all_but, each_choice, mostly_slow

SENSED = ("x", "v", "F1", "F2")
WANTED = ("x_ref", "v_ref", "a_ref")
TORQUES = ("tau_1", "tau_2")
STATE = ("x", "v", "theta_1", "omega_1", "theta_2", "omega_2")


@pytest.mark.parametrize(("what", "version"), each_choice(["controller", "plant", "closed-loop"], [2, 3]))
def test_fmpy_validates_without_a_message(what: str, version: int, exported: Exported) -> None:
    path = exported(what, version)
    assert validate_fmu(str(path)) == []
    with ZipFile(path) as files:
        assert f"sources/dualwinch_{what.replace('-', '_')}.c" in files.namelist()
    described = fmpy.read_model_description(str(path))
    assert (described.modelExchange is not None) == (what == "plant")
    mass = {"controller": "nominal", "plant": "plant", "closed-loop": "plant"}[what] + ".vehicle.mass"
    found = next(variable for variable in described.modelVariables if variable.name == mass)
    assert (found.unit, found.start, found.min, found.variability) == ("kg", "10000.0", "0.0", "tunable")


@pytest.mark.parametrize(
    ("version", "number"), mostly_slow([(2, 4), (3, 4), (2, 1), (3, 2), (2, 3)], {(2, 3), (3, 4)}.__contains__)
)
def test_plant_and_controller_together_are_the_closed_loop(
    version: int, number: int, exported: Exported, paper_run: PaperRun
) -> None:
    expected = paper_run(number, "fando-nftsm").columns
    plant, controller = Instance(exported("plant", version)), Instance(exported("controller", version))
    plant.set(disturbance__vortex=float(case(number).disturbance.vortex))
    x, tau_1 = [], []
    for reference in exogenous_signals(case(number))[:, :3]:
        sensed = plant.get(*SENSED)
        controller.put([*SENSED, *WANTED], [*sensed, *reference])
        controller.step()
        torques = controller.get(*TORQUES)
        plant.put(TORQUES, torques)
        plant.step()
        x.append(sensed[0])
        tau_1.append(torques[0])
    assert np.abs(np.array(x) - expected["x"]).max() < 1e-9
    assert np.abs(np.array(tau_1) - expected["tau_1"]).max() < 1e-6


@pytest.mark.parametrize(("what", "version"), each_choice(["controller", "plant", "closed-loop"], [2, 3]))
def test_a_step_is_the_interpreters_from_any_state(what: str, version: int, exported: Exported) -> None:
    made, random = block(what, case(4)), np.random.default_rng(5)
    fmu = Instance(exported(what, version))
    names = [re.sub(r"\.(\d+)\.", r"[\1].", f"state.{state.name}") for state in made.states]
    state, given = (np.array([signal.start for signal in signals]) for signals in (made.states, made.inputs))
    parameters = [parameter.start for parameter in made.parameters]
    for _ in range(1000):
        at = state + random.normal(size=state.size) * (0.01 + 0.1 * np.abs(state))
        now = given + random.normal(size=given.size) * (0.01 + np.abs(given))
        fmu.put(names, list(at))
        fmu.put([signal.name for signal in made.inputs], list(now))
        fmu.step()
        expected = np.array(made.step(at, now, parameters)[0]).ravel()
        assert fmu.get(*names) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("version", [2, 3])
def test_closed_loop_says_what_a_run_says(version: int, exported: Exported, paper_run: PaperRun) -> None:
    expected = paper_run(4, "fando-nftsm").columns
    loop = Instance(exported("closed-loop", version))
    for sample, (x, v, a) in enumerate(exogenous_signals(case(4))[:300, :3]):
        loop.set(reference__x=x, reference__v=v, reference__a=a)
        loop.step()
        # at the end of the step: motion is that of the next sample, what answers the reference that of this one
        assert loop.get("x", "F1", "t") == pytest.approx([expected[name][sample + 1] for name in ("x", "F1", "t")])
        assert loop.get("e", "tau_1") == pytest.approx([expected[name][sample] for name in ("e", "tau_1")])


@pytest.mark.slow
@pytest.mark.parametrize("version", all_but([3], [2, 3]))
def test_a_controller_that_looks_ahead_is_told_where_the_motion_goes(version: Version, tmp_path: Path) -> None:
    short = {"speed": 0.03, "accelerate_until": 0.3, "cruise_until": 0.5, "brake_until": 0.8}
    experiment = with_leaves(
        case(2, "mpc"), {f"reference.{key}": value for key, value in short.items()} | {"simulation.duration": 1.0}
    )
    expected = simulate(experiment).columns
    export_fmu(experiment, tmp_path / "loop.fmu", block="closed-loop", fmi=version)
    loop = Instance(tmp_path / "loop.fmu")
    outside = exogenous_signals(experiment)
    names = exogenous_names(experiment.controller)
    called = {re.sub(r"\.(\d+)$", r"[\1]", name): index for index, name in enumerate(names)}
    ahead = [name for name in called if name.startswith("ahead.") and name in loop.references]
    assert len(ahead) == 2 * len(experiment.controller.preview) + 1  # of accelerations the last one counts
    assert (outside[:900, [called[name] for name in ahead]] != 0).any(axis=0).all()
    wanted = ["reference.x", "reference.v", "reference.a", *ahead]
    used = [called[name] for name in wanted]
    for sample in range(900):
        loop.put(wanted, list(outside[sample, used]))
        loop.step()
        assert loop.get("x", "F1") == pytest.approx([expected[name][sample + 1] for name in ("x", "F1")])
        assert loop.get("tau_1") == pytest.approx([expected["tau_1"][sample]])


@pytest.mark.parametrize("version", [2, 3])
def test_state_can_be_kept_restored_and_carried_to_another_instance(version: int, exported: Exported) -> None:
    first, other = Instance(exported("plant", version)), Instance(exported("plant", version))
    first.set(tau_1=60.0, tau_2=5.0)
    first.step(50)
    kept = first.fmu.getFMUState()
    carried = first.fmu.serializeFMUState(kept)
    first.step(50)
    expected = first.get(*STATE)
    first.fmu.setFMUState(kept)
    first.fmu.freeFMUState(kept)
    first.time = 0.05
    first.step(50)
    assert first.get(*STATE) == expected
    other.fmu.setFMUState(other.fmu.deserializeFMUState(carried))
    other.time = 0.05
    other.step(50)
    assert other.get(*STATE) == expected
    with pytest.raises(FMICallException):
        Instance(exported("controller", version)).fmu.deserializeFMUState(carried)


@pytest.mark.parametrize("version", [2, 3])
def test_parameters_are_tuned_before_and_while_running(version: int, exported: Exported) -> None:
    plant = Instance(exported("plant", version), initialise=False)
    plant.enter()
    before = plant.get("theta_1")[0]
    plant.set(controller__coordination__preload=4000.0)
    assert plant.get("theta_1")[0] == pytest.approx(2 * before)
    assert plant.get("F1")[0] == pytest.approx(2000.0)
    plant.fmu.exitInitializationMode()
    plant.set(controller__coordination__preload=3000.0)
    assert plant.get("F1")[0] == pytest.approx(2000.0)  # starting values are no longer asked for
    light, heavy = (Instance(exported("plant", version)) for _ in range(2))
    heavy.set(plant__vehicle__mass=2e4)
    for instance in (light, heavy):
        instance.set(tau_1=100.0)
        instance.step(200)
    assert heavy.get("x")[0] < 0.7 * light.get("x")[0]


@pytest.mark.parametrize("version", all_but([3], [2, 3]))
def test_parameters_that_contradict_each_other_are_refused_before_the_start_and_under_way(
    version: Version, exported: Exported
) -> None:
    controller = Instance(exported("controller", version), initialise=False)
    controller.enter()
    for name, valid, wrong in (("p", 5.0, 4.0), ("q", 3.0, 2.5), ("p", 5.0, 3.0)):
        controller.set(**{f"controller__nftsm__{name}": wrong})
        with pytest.raises(FMICallException):
            controller.fmu.exitInitializationMode()
        controller.set(**{f"controller__nftsm__{name}": valid})
    controller.fmu.exitInitializationMode()
    controller.set(controller__nftsm__p=4.0)
    with pytest.raises(FMICallException):
        controller.step()
    controller.set(controller__nftsm__p=7.0)
    controller.step()


@pytest.mark.parametrize("version", all_but([3], [2, 3]))
def test_what_follows_from_parameters_follows_their_changes(version: Version, tmp_path: Path) -> None:
    """The gain of the Kalman filter: before the start, under way, and back with a state that was kept."""
    experiment = with_leaves(case(4), {"controller.estimator": "kalman"})
    made, path = block("controller", experiment), tmp_path / "kalman.fmu"
    export_fmu(experiment, path, block="controller", fmi=version)
    names = [f"state.{state.name}" for state in made.states]
    at, now = np.array([state.start for state in made.states]), np.array([given.start for given in made.inputs]) + 0.01
    parameters = {parameter.name: parameter.start for parameter in made.parameters}

    def expected(**changed: float) -> np.ndarray:
        changes = {name.replace("__", "."): value for name, value in changed.items()}
        return np.array(made.step(at, now, list((parameters | changes).values()))[0]).ravel()

    def stepped() -> list[float]:
        fmu.put(names, list(at))
        fmu.put([given.name for given in made.inputs], list(now))
        fmu.step()
        return fmu.get(*names)

    fmu = Instance(path, initialise=False)
    fmu.enter()
    fmu.set(controller__kalman__bandwidth=30.0)
    fmu.fmu.exitInitializationMode()
    before, after = expected(controller__kalman__bandwidth=30.0), expected(controller__kalman__bandwidth=90.0)
    assert np.abs(after - before).max() > 1e-3
    assert stepped() == pytest.approx(before, rel=1e-12, abs=1e-12)
    kept = fmu.fmu.getFMUState()
    fmu.set(controller__kalman__bandwidth=90.0)
    assert stepped() == pytest.approx(after, rel=1e-12, abs=1e-12)
    fmu.fmu.setFMUState(kept)
    fmu.fmu.freeFMUState(kept)
    assert stepped() == pytest.approx(before, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("version", [2, 3])
def test_two_instances_in_two_threads_do_not_interfere(version: int, exported: Exported) -> None:
    def run(torque: float) -> list[float]:
        plant = Instance(exported("plant", version))
        plant.set(tau_1=torque)
        for _ in range(100):
            plant.step()
        return plant.get(*STATE)

    torques = (30.0, 90.0)
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(run, torques)) == [run(torque) for torque in torques]


@pytest.mark.parametrize("version", [2, 3])
def test_what_makes_no_sense_is_refused_and_changes_nothing(version: int, exported: Exported) -> None:
    plant = Instance(exported("plant", version))
    before = plant.get(*STATE)
    for names, value in ((["tau_1"], np.nan), (["tau_1"], np.inf), (["plant.vehicle.mass"], 0.0), (["x"], 0.0)):
        with pytest.raises(FMICallException):
            plant.put(names, [value])
    for duration in (0.0, 1.5e-3, -1e-3, np.nan, np.inf, 1e300):
        with pytest.raises(FMICallException):
            plant.fmu.doStep(0.0, duration)
    assert plant.get(*STATE) == before
    assert plant.get("plant.vehicle.mass") == [1e4]
    plant.set(tau_1=1e300)
    with pytest.raises(FMICallException):  # a state beyond all numbers is an error, never a NaN
        plant.step(1000)
    assert np.isfinite(plant.get(*STATE)).all()


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize(("stop", "interval"), [(0.0105, 1e-3), (0.1, 1 / 60)])
def test_a_step_that_is_no_multiple_of_the_sample_time_ends_the_simulation(
    version: int, stop: float, interval: float, exported: Exported
) -> None:
    # an importer repeats what an FMU 2 discards
    with pytest.raises(FMICallException) as refused:
        fmpy.simulate_fmu(str(exported("plant", version)), stop_time=stop, output_interval=interval)
    assert refused.value.status == fmi2Error


@pytest.mark.parametrize("what", all_but(["controller"], ["controller", "plant"]))
def test_fuzzing_finds_no_trap_no_value_that_is_not_finite_and_no_torque_beyond_its_limits(
    what: str, exported: Exported, tmp_path: Path
) -> None:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("needs gcc with its sanitizers")
    with ZipFile(exported(what, 2)) as files:
        source = files.read(f"sources/dualwinch_{what}.c").decode()
    fuzzer = Path(__file__).parent / "fmu_fuzz.c"
    (tmp_path / "fuzz.c").write_text(f"#include <stdint.h>\n{source}{fuzzer.read_text()}")
    sanitizers = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    strict = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1")
    subprocess.run([gcc, *strict, *sanitizers, "fuzz.c", "-o", "fuzz", "-lm"], cwd=tmp_path, check=True)
    done = subprocess.run([str(tmp_path / "fuzz"), "200000", "7"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    assert min(map(int, re.findall(r"\d+", done.stdout))) > 10_000


@pytest.mark.external
def test_sources_compile_for_windows_and_strictly(exported: Exported, tmp_path: Path) -> None:
    for what, version in (("plant", 2), ("controller", 3)):
        with ZipFile(exported(what, version)) as files:
            files.extract(f"sources/dualwinch_{what}.c", tmp_path)
    strict = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O0", "-c")
    zig, _ = compiler_for(PLATFORMS["win64"])  # linking for Windows takes a minute the first time
    for command in (zig.command, find_compiler().command):
        for source in sorted((tmp_path / "sources").glob("*.c")):
            subprocess.run([*command, *strict, source.name, "-o", "out.o"], cwd=source.parent, check=True)


def test_stepped_side_by_side_the_torques_come_one_sample_late(exported: Exported) -> None:
    late = replace(case(4), simulation=replace(case(4).simulation, delay_samples=1, duration=1.0))
    expected = simulate(late).columns["x"]
    plant, controller = Instance(exported("plant", 2)), Instance(exported("controller", 2))
    torques, x = plant.get(*TORQUES), []
    for reference in exogenous_signals(late)[:, :3]:
        sensed = plant.get(*SENSED)
        controller.put([*SENSED, *WANTED], [*sensed, *reference])
        plant.put(TORQUES, torques)
        controller.step()
        plant.step()
        torques = controller.get(*TORQUES)
        x.append(sensed[0])
    assert np.abs(np.array(x) - expected).max() < 1e-9
