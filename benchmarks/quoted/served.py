"""A served plant and the exported controller in another process: how well time is kept, and what an outage does."""

import multiprocessing
import struct
import subprocess
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.document import markdown
from docs.generated.text import unit
from dualwinch.codegen.compiler import find_compiler
from dualwinch.config.experiment_file import load
from dualwinch.export import export_c
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.settings import override
from dualwinch.simulation.simulate import simulate
from dualwinch.toolboxes.server.plant import ServedPlant, ServerSettings
from dualwinch.toolboxes.server.protocols import Modbus, served
from dualwinch.toolboxes.server.registers import registers as registers_of

SITE = Path(__file__).parents[1] / "independent" / "searched.toml"
MODBUS, SUPERVISED = 15502, 50.0
"""Port, and requests a second."""


@dataclass(frozen=True)
class Served:
    """A run of a served plant, and what else is known of it."""

    result: Result
    timing: dict
    requests: int = 0
    """of the supervisor."""


def run_served(
    experiment: Experiment, settings: ServerSettings, *, supervised: bool = False, outage: float = 0.0
) -> Served:
    """The experiment with its own controller, exported, compiled and in a process of its own.

    Args:
        experiment: both.
        settings: how it is served.
        supervised: whether another process reads everything and writes a value at `SUPERVISED` by Modbus TCP.
        outage: length in s of an outage of the position sensor from 20 s on.
    """
    plant, pool = ServedPlant(experiment, settings), multiprocessing.get_context("spawn").Pool(1)
    with (
        tempfile.TemporaryDirectory() as folder,
        served(plant, [Modbus("127.0.0.1", MODBUS)] if supervised else []),
        pool,
    ):
        export_c(experiment, folder, udp=True)
        command = [*find_compiler().command, "-std=c99", "-O2", "-ffp-contract=off", "udp.c", "dualwinch_controller.c"]
        subprocess.run([*command, "-lm", "-o", "udp"], cwd=folder, check=True)
        words = len(plant.outputs) * 2
        requests = pool.apply_async(supervise, (words, experiment.duration)) if supervised else None
        if requests:
            time.sleep(3)  # until that process has begun
        program = [f"{folder}/udp", "127.0.0.1", str(plant.port)]
        if settings.priority:
            program = ["chrt", "-f", str(settings.priority), *program]
        with subprocess.Popen(program, stdout=subprocess.DEVNULL):
            if outage:
                threading.Thread(target=silence, args=(plant, outage)).start()
            result = plant.serve()
        count = requests.get() if requests else 0
        plant.release()
    if result is None:
        raise RuntimeError("the controller started no run")
    return Served(result, plant.timing, count)


def silence(plant: ServedPlant, outage: float) -> None:
    """An outage of the position sensor from 20 s on."""
    for at, value in ((20.0, 1.0), (20.0 + outage, 0.0)):
        while plant.time < at:
            time.sleep(1e-4)
        plant.write({"outage": value})


def supervise(words: int, duration: float) -> int:
    """Read everything and write the force of 0 N, `SUPERVISED` times a second; how many requests were answered."""
    from pymodbus.client import ModbusTcpClient

    client, answered, began = ModbusTcpClient("127.0.0.1", port=MODBUS), 0, time.monotonic()
    client.connect()
    zero = list(struct.unpack(">HH", struct.pack(">f", 0.0)))
    for number in range(int(duration * SUPERVISED)):
        time.sleep(max(0.0, began + number / SUPERVISED - time.monotonic()))
        answers = client.read_input_registers(0, count=words), client.write_registers(1006, zero)
        answered += not any(answer.isError() for answer in answers)
    client.close()
    return answered


def clock() -> str:
    """Runs by the clock on the wall beside those of `simulate` with the measured delay."""
    runs = {
        "Case 4": (case(4), 0, False),
        "Case 4, real-time priority": (case(4), 50, False),
        "the same, read and written by Modbus TCP meanwhile": (case(4), 50, True),
        "`site`, gains its search begins with, real-time priority": (load(SITE), 50, False),
    }
    lines = []
    for name, (experiment, priority, supervised) in runs.items():
        ran = run_served(experiment, ServerSettings(may_write=True, priority=priority), supervised=supervised)
        own, period = experiment.simulation.delay_samples, experiment.simulation.sample_time
        late = own + round(ran.timing["delay_s"] / period)
        expected = simulate(override(experiment, {"simulation.delay_samples": late})).metrics["mse"]
        mse = ran.result.metrics["mse"]
        lines.append(
            [
                name,
                f"{ran.timing['delay_s'] * 1e3:.3f}",
                f"{mse:.5g}",
                f"{expected:.5g}",
                f"{100 * (mse / expected - 1):+.2g} %",
                f"{ran.timing['missed']} of {ran.timing['ticks']}",
                f"{share_within(ran.timing, 100):.1f} %",
                f"{ran.timing['latest_us'] / 1e3:.1f}",
                str(ran.timing["silences"]),
                str(ran.requests) if supervised else "–",
            ]
        )
    headings = ["plant", "delay of commands, ms", "MSE, m²", "MSE of `simulate` with it, m²", "difference"]
    headings += ["samples more than 1 ms late", "at most 0.1 ms late", "latest, ms", "safe torques", "Modbus answers"]
    return markdown(headings, lines)


def share_within(timing: dict, most: float) -> float:
    """Share in per cent of samples that began at most so many µs late."""
    within = sum(
        count for ends, count in timing["lateness"].items() if ends.startswith("<=") and float(ends.split()[1]) <= most
    )
    return 100 * within / timing["ticks"]


def registers() -> str:
    """What clients read beside the readings of a datagram, and what they write, with the first Modbus register."""
    plant = ServedPlant(case(4))
    plant.release()
    rows = [
        [str(register.modbus), f"`{register.name}`", unit(register.leaf.quantity.unit), register.leaf.quantity.meaning]
        for register in registers_of(plant)
        if register.offset is None
    ]
    return markdown(["Modbus", "name", "unit", "meaning"], rows).replace("|---|--:|--:|--:|", "|--:|---|---|---|")


def outage() -> str:
    """What half a second without the position sensor does, by two controllers."""
    lines = []
    for estimator in ("lowpass", "self-calibrating-kalman"):
        experiment = override(case(4), {"controller.estimator": estimator})
        result = run_served(experiment, ServerSettings(lockstep=True, may_write=True), outage=0.5).result
        after = result["t"] > 19
        largest, least = np.abs(result["e"][after]).max(), min(result[name][after].min() for name in ("F1", "F2"))
        lines.append([f"`{estimator}`", f"{1e3 * largest:.1f}", f"{least:.0f}"])
    return markdown(["estimator", "largest error after 19 s, mm", "least tension after 19 s, N"], lines)
