"""The plant with ropes and sensors in real time, one sample per period, under torques from other processes."""

import json
import math
import os
import socket
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeAlias

import annotated_types as at
import numpy as np
from numpy.typing import NDArray

from dualwinch.toolbox import (
    ConfigurationError,
    Experiment,
    Leaf,
    Quantity,
    Result,
    Signal,
    compiled,
    description,
    exogenous_signals,
    external_commands,
    lanes,
    leaves,
    loops,
    motions,
    physics,
    preparation,
    quantities,
    references,
    run_columns,
    runs,
    sensing,
    tree,
    with_leaves,
)
from dualwinch.toolboxes.server.paced_run import PacedRun, Pacing

Floats: TypeAlias = NDArray[np.float64]

SIGNALS = ("t", *run_columns.READINGS, "x_ref", "v_ref", "a_ref", "tau_1", "tau_2")
"""Columns sent to clients: sensor readings, the reference, and the torques applied until now."""

PORT = 47800
"""Default port for datagrams."""

TORQUE_COMMANDS = ("tau_1_cmd", "tau_2_cmd")
"""Inputs that are torque commands."""

REFERENCE = ("reference.x", "reference.v", "reference.a")


Writer: TypeAlias = tuple[str, str]
"""A client and its protocol, one of `COMMANDERS`."""

COMMANDERS = ("", "UDP", "Modbus", "OPC UA", "Python")
"""Protocols by which torques may be commanded, in the order of their numbers; the first: by none."""

NOBODY, THIS_PROCESS = ("", ""), ("this process", "Python")


class CommandedError(ConfigurationError):
    """Torques of a client while another one commands."""


@dataclass(frozen=True)
class Lease:
    """The right of a client to command torques, until a time of `time.monotonic`."""

    writer: Writer
    ends: float


@dataclass(frozen=True)
class Inputs:
    """Values that clients may write. Torques apply while no controller sends them by datagram."""

    tau_1_cmd: Annotated[float, Quantity("N m", "motor torque command of winch 1")] = 0.0
    tau_2_cmd: Annotated[float, Quantity("N m", "motor torque command of winch 2")] = 0.0
    target: Annotated[float, at.Ge(0), Quantity("m", "target of the reference, which first brakes to rest")] = 0.0
    force: Annotated[
        float, at.Ge(-1e5), at.Le(1e5), Quantity("N", "disturbance force on the vehicle along the track")
    ] = 0.0
    current: Annotated[float, at.Ge(-5), at.Le(5), Quantity("m/s", "further ambient current along the track")] = 0.0
    outage: Annotated[float, at.Ge(0), at.Le(1), Quantity("1", "1 while the position sensor is silent")] = 0.0
    slack_1: Annotated[
        float, at.Ge(0), at.Le(1), Quantity("1", "1 while motor 1 gives no torque, so that rope 1 slackens")
    ] = 0.0
    slack_2: Annotated[
        float, at.Ge(0), at.Le(1), Quantity("1", "1 while motor 2 gives no torque, so that rope 2 slackens")
    ] = 0.0
    start: Annotated[float, at.Ge(0), at.Le(1), Quantity("1", "1 starts the run")] = 0.0
    stop: Annotated[float, at.Ge(0), at.Le(1), Quantity("1", "1 ends the run and keeps its result")] = 0.0


@dataclass(frozen=True)
class Status:
    """Values that clients may read in addition to the signals."""

    running: Annotated[float, Quantity("1", "1 during a run")]
    safe: Annotated[float, Quantity("1", "1 while the safe torques are applied, for lack of commands")]
    controller: Annotated[float, Quantity("1", "1 while a client sends datagrams")]
    silences: Annotated[float, Quantity("1", "number of times the safe torques took effect")]
    missed: Annotated[float, Quantity("1", "samples that began more than a period late")]
    commander: Annotated[
        float, Quantity("1", "who commands: 0 nobody, 1 datagrams, 2 Modbus, 3 OPC UA, 4 the server's own process")
    ]
    held: Annotated[float, Quantity("1", "1 while the reference is held, after a silence, until target is written")]


@dataclass(frozen=True)
class ServerSettings:
    """Settings of a served plant."""

    rate: Annotated[
        quantities.Positive, at.Le(1000), Quantity("1", "speed of the plant's clock relative to real time")
    ] = 1.0
    lockstep: Annotated[
        bool, Quantity("", "each sample waits for the client's answer, so that runs can be repeated bit for bit")
    ] = False
    may_write: Annotated[bool, Quantity("", "whether clients may command, start and disturb; else they only read")] = (
        False
    )
    watchdog: Annotated[
        quantities.Positive, at.Le(10), Quantity("s", "time without a command after which the safe torques are applied")
    ] = 0.05
    safe: Annotated[
        tuple[float, ...],
        at.Ge(-1e6),
        at.Le(1e6),
        Quantity("N m", "safe torques (default: those that hold both ropes at half the preload)"),
    ] = quantities.NONE
    brake: Annotated[
        bool,
        Quantity(
            "",
            "whether safe torques also brake the vehicle, by its measured speed: the tight rope reaches tension_max at "
            "the cruising speed, the other stays above tension_min; otherwise the vehicle coasts",
        ),
    ] = False
    largest: Annotated[
        float | None,
        at.Gt(0),
        at.Le(1e6),
        Quantity("N m", "magnitude beyond which a torque is refused (default: twice what holds tension_max)"),
    ] = None
    release: Annotated[
        quantities.Positive,
        at.Le(3600),
        Quantity(
            "s", "real time after which another client is admitted: without a datagram, or without a torque command"
        ),
    ] = 1.0
    priority: Annotated[
        int,
        at.Ge(0),
        at.Le(99),
        Quantity("1", "real-time priority of the thread that keeps time (SCHED_FIFO); 0: normal scheduling"),
    ] = 0
    ahead: Annotated[
        quantities.Positive,
        at.Le(1),
        Quantity("s", "real time between a new target and the motion towards it, for planning"),
    ] = 0.05

    def __post_init__(self) -> None:
        """Raise `ConfigurationError` for a value of the wrong type or out of its range."""
        object.__setattr__(self, "safe", quantities.numbers_of(self.safe))
        tree.check_values(self)
        if len(self.safe) not in {0, 2}:
            raise ConfigurationError(f"safe = {tree.shown(self.safe)}: must be two torques in N m")


LATENESS_US = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000, 50000)
"""Upper ends of the bins of the lateness histogram in µs."""


class ServedPlant:
    """A plant served to other processes, one run after the other.

    In every sample, received datagrams are read, the readings are sent, and the plant advances under the last valid
    command, so that a command acts one sample after the readings that it responds to. All of this is compiled code that
    does not hold Python's lock (`paced_run`).

    Attributes:
        experiment: the experiment, whose controller is replaced by external commands. Results refer to it, so that
            files can be read anywhere.
        settings: settings of the server.
        port: port of the datagrams.
        safe: torques in N m for lack of commands.
        closed: whether no further run is served.
        inputs: name → metadata of values that clients may write.
        outputs: name → metadata of values that they may read.
    """

    def __init__(
        self, experiment: Experiment, settings: ServerSettings | None = None, *, host: str = "127.0.0.1", port: int = 0
    ) -> None:
        """Compile the plant, or load it from the cache, and open the port.

        Args:
            experiment: plant, sensors, disturbances, reference and duration of a run.
            settings: settings of the server.
            host: address to listen at; default: only this machine.
            port: for datagrams (UDP); 0: any free port.

        Raises:
            ConfigurationError: inconsistent values, or an address that cannot be used.
            DualwinchError: no compiler or no POSIX system.
        """
        self.settings = settings or ServerSettings()
        self.experiment = replace(experiment, simulation=replace(experiment.simulation, readings=True))
        self._scenarios = lanes.ScenarioSource(_served(self.experiment), "torques")
        self._loop, self._samples = self._scenarios.loop, experiment.samples
        try:
            preparation.check_memory(self._samples, 1, len(self._loop.columns) + 2 * len(self._loop.exogenous))
        except ConfigurationError as error:
            raise ConfigurationError(
                f"simulation.duration = {experiment.duration:g} s: its rows would take more than half of the memory"
            ) from error
        self._code = compiled.compile_stepping(self._scenarios.commanded(SIGNALS), exact=True)
        self._signals = next(
            exogenous_signals.exogenous_pieces(self._scenarios.experiment, self._samples + 1, self._samples + 1)
        )
        if not sensing.silence_of(experiment.sensors):
            self._signals[:, self._column(loops.SILENT)] = 0.0
        limits, largest = experiment.controller.limits, self.settings.largest
        full, half = (
            physics.holding_torques(pull, experiment.plant) for pull in (2 * limits.tension_max, limits.preload)
        )
        self._largest = (largest, largest) if largest else (float(2 * full.tau_1), float(2 * full.tau_2))
        tau_1, tau_2 = self.settings.safe or (half.tau_1, half.tau_2)
        self.safe = float(tau_1), float(tau_2)
        if not all(abs(torque) <= limit for torque, limit in zip(self.safe, self._largest, strict=True)):
            allowed = " and ".join(f"±{limit:g}" for limit in self._largest)
            raise ConfigurationError(f"safe = {self.safe[0]:g}, {self.safe[1]:g}: must be within {allowed} N m")
        cruise = references.cruise_speed(experiment.reference)
        low, high = (
            physics.holding_torques(2 * pull, experiment.plant) for pull in (limits.tension_min, limits.tension_max)
        )
        self._least, self._most = ((float(ends.tau_1), float(ends.tau_2)) for ends in (low, high))
        slopes = [(high - hold) / cruise for high, hold in zip(self._most, self.safe, strict=True)]
        self._brake = (-slopes[0], slopes[1]) if self.settings.brake else (0.0, 0.0)
        self.inputs, self.outputs = self._described()
        self._socket = _bound(host, port)
        self.port: int = self._socket.getsockname()[1]
        self.closed, self._lock, self._begun = False, threading.RLock(), 0
        self._lease: Lease | None = None
        self._reset()
        self._finished = self._run, self._runs, self.events

    def _column(self, name: str) -> int:
        return self._loop.exogenous.index(name)

    def _described(self) -> tuple[dict[str, Leaf], dict[str, Leaf]]:
        """Inputs and outputs by name."""
        inputs = description.describe(Inputs)
        length = self.experiment.plant.track.length
        inputs["target"] = replace(inputs["target"], constraints=(at.Ge(0), at.Le(length)))
        for name, limit in zip(TORQUE_COMMANDS, self._largest, strict=True):
            inputs[name] = replace(inputs[name], constraints=(at.Ge(-limit), at.Le(limit)))
        quantities_read = {name: self._loop.quantities[name] for name in SIGNALS}
        outputs = {
            signal_name(name): Leaf(signal_name(name), quantity, float) for name, quantity in quantities_read.items()
        }
        return inputs, outputs | description.describe(Status)

    def _reset(self) -> None:
        """Prepare a new run."""
        (lane,), _ = self._scenarios.started(self._scenarios.drawn([0], 0), 1)
        self._runs = compiled.SteppedRuns(self._code, 1, self._samples, shared=True)
        self._runs.start(np.zeros(1, np.int64), lane.state[np.newaxis], lane.parameters[np.newaxis])
        settings, period = self.settings, self.experiment.simulation.sample_time
        x, v, a = map(self._column, REFERENCE)
        pacing = Pacing(
            period=round(1e9 * period / settings.rate),
            lockstep=settings.lockstep,
            may_write=settings.may_write,
            watchdog=round(settings.watchdog / period),
            release=round(1e9 * settings.release),
            safe=self.safe,
            brake=self._brake,
            lower=self._least,
            upper=self._most,
            position=SIGNALS.index("x_read"),
            speed=SIGNALS.index("v_read"),
            reference=(x, v, a),
            largest=self._largest,
            edges=tuple(1000 * edge for edge in LATENESS_US),
        )
        self._run = PacedRun(self._code, self._runs, self._signals.copy(), pacing, self._socket.fileno())
        self._runs.read(0, self._run.table.ctypes.data)
        self._runs.look()
        self._written, self._lease = leaves(Inputs()), None
        self.events: list[dict[str, float | str]] = []

    # ---- a run ----

    def serve(self) -> Result | None:
        """Wait for the start of a run, and run it until it ends or is stopped.

        Returns:
            The result, as from `simulate`; a stopped run has the outcome ``running``. None: the plant was closed before
            a run began.

        Raises:
            ConfigurationError: the system does not grant real-time priority.
        """
        with _real_time_priority(self.settings.priority):
            self._run.serve()
        with self._lock:
            samples = int(self._runs.done[0])
            (state,), outcome = self._runs.states(np.zeros(1, np.int64)), compiled.Outcome(self._runs.outcomes[0])
            rows = self._run.rows[:samples]
            result = runs.result_of(self._loop, self.experiment, None, rows, state, outcome, samples)
            self._finished = self._run, self._runs, self.events
            self._begun += 1
            if not self.closed:
                self._reset()
        return result if samples else None

    @property
    def notes(self) -> dict[str, str]:
        """Notes on the last run for `results.file_formats.save`: values written by clients, and timing."""
        *_, events = self._finished
        return {"events": json.dumps(events), "timing": json.dumps(self.timing)}

    @property
    def timing(self) -> dict[str, Any]:
        """Timing of the last run: counts, histogram of lateness and mean delay of commands."""
        run, *_ = self._finished
        commanded, ages = int(run.ages.sum()), float(run.ages @ np.arange(len(run.ages)))
        ends = [f"<= {edge:g} us" for edge in LATENESS_US] + [f"> {LATENESS_US[-1]:g} us"]
        return {
            **run.counts,
            "latest_us": run.shared.latest / 1e3,
            "lateness": dict(zip(ends, run.lateness.tolist(), strict=True)),
            "delay_s": ages / commanded * self.experiment.simulation.sample_time if commanded else None,
            "commanded": commanded,
        }

    @property
    def counts(self) -> Mapping[str, int]:
        """Event counts of the present run by name."""
        return self._run.counts

    @property
    def time(self) -> float:
        """Time in s of the present run."""
        return int(self._runs.done[0]) * self.experiment.simulation.sample_time

    def rows(self, start: int, stride: int) -> tuple[int, dict[str, Floats]]:
        """Every `stride`-th row from sample `start` on, of the present run so far, else of the last one.

        Returns:
            Number of the run, and its rows: name → column.
        """
        with self._lock:
            under_way = int(self._runs.done[0]) > 0
            run, runs, _ = (self._run, self._runs, None) if under_way else self._finished
            rows = run.rows[start : int(runs.done[0]) : stride]
            number = self._begun + under_way
        return number, dict(zip(self._loop.columns, rows.T.copy(), strict=True))

    def close(self) -> None:
        """End the present run, and serve no other."""
        self.closed = True
        self._run.shared.quit = 1

    def release(self) -> None:
        """Close the port; no run may be served meanwhile."""
        self._socket.close()

    # ---- values that clients read and write ----

    @property
    def signals(self) -> int:
        """Number of outputs in datagrams; these come first."""
        return len(SIGNALS)

    def read(self) -> dict[str, float]:
        """Present values of all outputs, by name."""
        shared = self._run.shared
        values = {
            signal_name(name): float(value) for name, value in zip(SIGNALS, self._runs.observation[:, 0], strict=True)
        }
        _, protocol = self.commander
        status = Status(
            running=shared.running,
            safe=shared.is_safe,
            controller=shared.connected,
            silences=shared.silences,
            missed=shared.missed,
            commander=COMMANDERS.index(protocol),
            held=shared.held,
        )
        return values | {name: float(value) for name, value in leaves(status).items()}

    @property
    def written(self) -> dict[str, float]:
        """Values of all inputs as last written in this run, by name."""
        return dict(self._written)

    @property
    def commander(self) -> Writer:
        """The client whose torques are in force, or were the last within the settings' `release`, and its protocol."""
        if self._run.shared.by_datagram:
            return "a client", "UDP"
        lease = self._lease
        return lease.writer if lease and time.monotonic() < lease.ends else NOBODY

    def write(self, values: Mapping[str, float], writer: Writer = THIS_PROCESS) -> None:
        """Set inputs, all of them or none.

        Torques are commanded by one client at a time: the first keeps the command until it has written none for the
        settings' `release`. Everything else may be written by any.

        Args:
            values: input → value.
            writer: name and protocol of the client.

        Raises:
            CommandedError: torques, while another client commands.
            ConfigurationError: writing is not allowed, an unknown input, or a value out of its range.
        """
        if not self.settings.may_write:
            raise ConfigurationError("writing is not allowed; serve with may_write (--allow-write)")
        for name, value in values.items():
            leaf = self.inputs.get(name)
            if leaf is None:
                raise ConfigurationError(f"{name}: must be one of {', '.join(self.inputs)}")
            if not leaf.admits(float(value)):
                raise ConfigurationError(f"{name} = {value:g}: must be {leaf.wanted}")
        with self._lock:
            if not values.keys().isdisjoint(TORQUE_COMMANDS):
                if (commander := self.commander) not in {NOBODY, writer}:
                    raise CommandedError(
                        f"{', '.join(values)}: commanded by {commander[0]} ({commander[1]}) at present"
                    )
                self._lease = Lease(writer, time.monotonic() + self.settings.release)
            self._set({name: float(value) for name, value in values.items()})

    def _set(self, values: Mapping[str, float]) -> None:
        shared, added = self._run.shared, self._run.added
        self._written |= values
        for name, value in values.items():
            if name not in TORQUE_COMMANDS:  # there may be many torques, and the rows contain them
                self.events.append({"t": self.time, "input": name, "value": value})
            if name in {"slack_1", "slack_2"}:
                shared.share[name == "slack_2"] = 1.0 - value
            elif name == "outage":
                added[self._column(loops.SILENT)] = value
            elif name in {loops.FORCE, "current"}:
                added[self._column(name)] = value
        if not values.keys().isdisjoint(TORQUE_COMMANDS):
            shared.other[:] = [self._written[name] for name in TORQUE_COMMANDS]
            shared.other_count += 1
        if "target" in values:
            self._go_to(values["target"])
        if values.get("start", 0.0) > 0:
            shared.start = 1
        if values.get("stop", 0.0) > 0 and shared.running:
            shared.quit = 1

    def _go_to(self, target: float) -> None:
        """Let the reference brake to rest and then move to a position."""
        simulation, reference = self.experiment.simulation, self.experiment.reference
        ahead = (
            2
            if self.settings.lockstep
            else max(2, round(self.settings.ahead * self.settings.rate / simulation.sample_time))
        )
        table, columns = self._run.table, [self._column(name) for name in REFERENCE]
        samples_done = int(self._runs.done[0])
        start = min(samples_done + ahead, len(table) - 1)
        if self._run.shared.held:
            table[samples_done : start + 1, columns] = self._run.shared.held_at, 0.0, 0.0
        x, v, _ = table[start, columns]
        t: Floats = np.arange(len(table) - start, dtype=np.float64) * simulation.sample_time
        table[start:, columns] = approach(t, x, v, target, reference).T
        self._run.shared.held = 0


def approach(t: Floats, x: float, v: float, target: float, reference: references.Reference) -> Floats:
    """A motion that brakes to rest and then moves to a target: position, speed, acceleration, (3, samples).

    Times (samples,) in s count from its beginning, at x in m and v in m/s; the target is in m. The reference gives
    cruising speed, acceleration and jerk limit; braking ignores the jerk limit.
    """
    braking = abs(v) / reference.acceleration
    standstill = x + v * braking / 2
    limits = motions.MoveLimits(references.cruise_speed(reference), reference.acceleration, reference.jerk_limit)
    way = motions.moves((abs(target - standstill),), (), limits)
    motion = motions.way_point_motion(np.maximum(t - braking, 0.0), way, reference.jerk_limit)
    sign, slowing = math.copysign(1.0, target - standstill), -math.copysign(reference.acceleration, v)
    brakes = t < braking
    return np.array(
        [
            np.where(brakes, x + v * t + slowing * t**2 / 2, standstill + sign * motion.x),
            np.where(brakes, v + slowing * t, sign * motion.v),
            np.where(brakes, slowing, sign * motion.a),
        ]
    )


def signal_name(column: str) -> str:
    """Name of a signal in exported controllers: ``x`` for the column ``x_read``."""
    return column.removesuffix(run_columns.READ)


def _served(experiment: Experiment) -> Experiment:
    """An experiment under external torques, with a force and outages in its code even if they are zero.

    Measurements are not filtered, as nothing would use the estimates.
    """
    sea, sensors = experiment.disturbance, experiment.sensors
    if not sea.force.given:
        sea = replace(sea, force=Signal(times=(0.0, 1.0), values=(0.0, 0.0), unit="N"))
    if not sensing.silence_of(sensors):
        sensors = replace(sensors, outage_length=experiment.simulation.sample_time)
    unfiltered = with_leaves(experiment, {"controller.estimator": "none"})
    return external_commands.under_command(replace(unfiltered, disturbance=sea, sensors=sensors), "torques")


@contextmanager
def _real_time_priority(priority: int) -> Iterator[None]:
    """Real-time scheduling of the calling thread.

    Raises:
        ConfigurationError: the system does not grant it.
    """
    if not priority:
        yield
        return
    try:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError) as error:
        raise ConfigurationError(
            f"priority = {priority}: the system grants no real-time scheduling (Linux: root, or ulimit -r {priority})"
        ) from error
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def _bound(host: str, port: int) -> socket.socket:
    """A datagram socket at an address.

    Raises:
        ConfigurationError: the address cannot be used.
    """
    if not 0 <= port <= 65535:
        raise ConfigurationError(f"UDP port = {port}: must be 0 to 65535 (0: any free port)")
    try:
        family, kind, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        if port == 0:  # bind again by number: Linux releases an automatic port when a client is disconnected
            with socket.socket(family, kind) as any_free:
                any_free.bind(address)
                address = any_free.getsockname()
        endpoint = socket.socket(family, kind)
        try:
            endpoint.bind(address)
        except OSError:
            endpoint.close()
            raise
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ConfigurationError(f"cannot listen at {host}, port {port} (UDP): {reason}") from error
    endpoint.settimeout(0.0)
    return endpoint
