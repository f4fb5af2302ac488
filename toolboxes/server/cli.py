"""The command ``serve``: the plant in real time, for controllers in other processes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from dualwinch.toolbox import ProgressLine, extensions, options, output

if TYPE_CHECKING:
    from dualwinch.toolbox import Result
    from dualwinch.toolboxes.server.plant import ServedPlant, ServerSettings
    from dualwinch.toolboxes.server.protocols import Protocol

HOST = "127.0.0.1"
"""Default address: this machine alone."""

INTERVAL = 0.2
"""Time in s between two updates of the progress line."""


def server_settings() -> type[ServerSettings]:
    """The class with the defaults of the options, imported for the help alone."""
    from dualwinch.toolboxes.server.plant import ServerSettings

    return ServerSettings


def default_port() -> int:
    """The default port of the datagrams."""
    from dualwinch.toolboxes.server.plant import PORT

    return PORT


def serve(
    *,
    given: options.ExperimentOptions = options.ExperimentOptions(),
    ensemble: options.NominalMachine = None,
    realtime: Annotated[bool, Parameter(negative="--lockstep")] = True,
    rate: Annotated[float | None, options.default_of(server_settings, "rate")] = None,
    host: str = HOST,
    udp: Annotated[options.Whole, options.default_of(default_port)] = None,
    modbus: options.Whole = None,
    opcua: options.Whole = None,
    allow_write: bool = False,
    watchdog: Annotated[float | None, options.default_of(server_settings, "watchdog")] = None,
    safe: str | None = None,
    brake: bool = False,
    priority: options.Whole = None,
    runs: options.Whole = None,
    out: Path | None = None,
    map_: Annotated[Path | None, Parameter(name="--map")] = None,
    lab: bool = False,
    json: options.Json = False,
) -> None:
    """Run the plant with ropes and sensors in real time, for a controller in another process.

    The controller connects by UDP (a sample per datagram), Modbus TCP or OPC UA. A run starts when a client requests
    it and ends after its duration; Ctrl-C or SIGTERM ends it earlier and keeps its data. If no command arrives within
    the watchdog's time, safe torques take effect. The server listens at this machine's own address unless --host names
    another; clients may write only with --allow-write.

    Args:
        realtime: Run in real time; or let each sample wait for the controller's answer.
        rate: Speed of the plant's clock relative to real time.
        host: Address to listen at; other machines reach only a public one.
        udp: Port of the datagrams; 0: any that is free.
        modbus: Port of Modbus TCP, such as 5020 (default: off; `pip install 'dualwinch[serve]'`).
        opcua: Port of OPC UA, such as 4840 (default: off; the same extra).
        allow_write: Let clients start, command and disturb; otherwise they only read.
        watchdog: Time in s without a command after which the safe torques take effect.
        safe: Safe torques in N m, such as 0,0 (default: those that hold half the preload in each rope).
        brake: Let the safe torques also brake the vehicle, by its measured speed, within the limits of the tensions;
            otherwise they hold the ropes, and the vehicle coasts.
        priority: Real-time priority of the sampling thread, 1 to 99 (default: none).
        runs: End after this many runs (default: at Ctrl-C).
        out: File for the data: .csv, .parquet, .npz or .mat; of later runs NAME-2, …, also where earlier sessions left
            files.
        map_: File for the table of registers and nodes: .csv, or .md for a page.
        lab: Show each run in the lab's page while it proceeds.

    Examples:
        dualwinch serve --case 4 --realtime --allow-write --out run.parquet
        dualwinch serve --case 4 --allow-write --modbus 5020 --opcua 4840 --map registers.csv
        dualwinch serve --ensemble site --case 4 --rate 0.5 --allow-write --lab
        dualwinch serve --case 4 --lockstep --allow-write --runs 1 --out run.parquet
    """
    from dualwinch.toolbox import ConfigurationError, file_formats
    from dualwinch.toolboxes.server.plant import PORT, ServedPlant, ServerSettings
    from dualwinch.toolboxes.server.protocols import Modbus, OpcUa
    from dualwinch.toolboxes.server.registers import FORMATS as MAP_FORMATS
    from dualwinch.toolboxes.server.registers import write_map

    if runs is not None and runs < 1:
        raise ConfigurationError(f"--runs = {runs}: must be a whole number >= 1")
    output.check_file(out, *file_formats.FORMATS)
    if not realtime and rate is not None:
        raise ConfigurationError("--rate: needs --realtime; with --lockstep there is no clock")
    output.check_file(map_, *MAP_FORMATS)
    settings = ServerSettings(
        lockstep=not realtime,
        may_write=allow_write,
        **options.stated(rate=rate, watchdog=watchdog, safe=_torques(safe), brake=brake or None, priority=priority),
    )
    protocols = [kind(host, port) for kind, port in ((Modbus, modbus), (OpcUa, opcua)) if port is not None]
    experiment = given.nominal(ensemble)
    with ProgressLine("compiling the plant"):
        plant = ServedPlant(experiment, settings, host=host, port=PORT if udp is None else udp)
    if map_:
        write_map(plant, map_)
        output.wrote(map_)
    try:
        with shown(plant, protocols, host, lab=lab), sigterm_as_interrupt():
            for _ in count() if runs is None else range(runs):
                result = watched(plant)
                if result is None:
                    return
                if out:
                    file = unused(out)
                    with interrupts_later():
                        file_formats.save(result, file, {**plant.notes, **output.version_notes()})
                    output.wrote(file)
                print_run(plant, result, json=json)
                if plant.closed:
                    return
    finally:
        plant.release()


def unused(file: Path) -> Path:
    """The file, or the first of NAME-2, NAME-3, … that does not exist; a run driven from outside cannot be repeated."""
    numbered = (file.with_stem(f"{file.stem}-{number}") for number in count(2))
    return next(each for each in chain([file], numbered) if not each.exists())


def _torques(text: str | None) -> tuple[float, ...] | None:
    """The two torques in N m of ``--safe``, such as ``22,22``."""
    from dualwinch.toolbox import ConfigurationError

    if text is None:
        return None
    try:
        tau_1, tau_2 = map(float, text.split(","))
    except ValueError:
        raise ConfigurationError(f"--safe {text}: must be two torques in N m, such as 22,22") from None
    return tau_1, tau_2


@contextmanager
def shown(plant: ServedPlant, protocols: Sequence[Protocol], host: str, *, lab: bool) -> Iterator[None]:
    """Serve a plant by its protocols and in the lab, and print the addresses."""
    from dualwinch.toolboxes.server.protocols import served

    addresses = [f"{host}:{plant.port} (UDP)"]
    with ExitStack() as stack:
        if protocols:
            with ProgressLine("opening the ports"):
                stack.enter_context(served(plant, protocols))
            addresses += [protocol.address for protocol in protocols]
        if lab:
            live_page = extensions.extension(extensions.FUNCTIONS, "live_page", "--lab")
            addresses.append(f"{stack.enter_context(live_page(plant))} (lab)")
        writing = "clients may write" if plant.settings.may_write else "clients may only read"
        words = f"serving at {', '.join(addresses)}; {writing} (Ctrl-C ends it)"
        output.terminal(stderr=True, soft_wrap=True).print(words, highlight=False)
        yield


def watched(plant: ServedPlant) -> Result | None:
    """Serve one run, with a progress line, and print every silence of the controller.

    Ctrl-C and SIGTERM end the run; its data until then are kept. None: none was started.
    """
    silences, was_safe, duration = 0, False, plant.experiment.duration
    tau_1, tau_2 = plant.safe
    silent = (
        f"no command for {plant.settings.watchdog:g} s; the safe torques {tau_1:.4g} and {tau_2:.4g} N m are in force"
        + (" and brake the vehicle" if plant.settings.brake else "; the vehicle coasts (--brake stops it)")
    )
    with (
        ThreadPoolExecutor(1, thread_name_prefix="plant") as pool,
        ProgressLine(command="serve") as progress,
    ):
        run = pool.submit(plant.serve)
        try:
            progress(0.0, "waiting for a start")
            while not run.done():
                state, counts = plant.read(), plant.counts
                if counts["silences"] > silences:
                    progress.say(f"t = {plant.time:.3f} s: {silent}")
                elif was_safe and not state["safe"] and state["running"]:
                    progress.say(
                        f"t = {plant.time:.3f} s: commands arrive again; "
                        "the reference is held where the vehicle was, until `target` is written"
                    )
                silences, was_safe = counts["silences"], bool(state["safe"])
                if state["running"]:
                    words = f"{plant.time:.1f} of {duration:g} s, {counts['missed']} samples more than a period late"
                    progress(plant.time / duration, "running", words)
                wait([run], timeout=INTERVAL)
        except KeyboardInterrupt:
            plant.close()
        return run.result()


@contextmanager
def sigterm_as_interrupt() -> Iterator[None]:
    """Treat SIGTERM, by which service managers end a process, as Ctrl-C; without effect outside the main thread."""
    import signal
    import threading

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def interrupts_later() -> Iterator[None]:
    """Postpone Ctrl-C and SIGTERM until the end, so that a file is written whatever comes."""
    import signal

    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def print_run(plant: ServedPlant, result: Result, *, json: bool) -> None:
    """Print outcome, figures of merit, commands and timing of a run.

    Remarks on the loop of the experiment's own controller, which was not in it, are left out.
    """
    timing = plant.timing
    if not json:
        output.terminal().print("torques from outside, in place of the experiment's controller:")
    output.print_result(result, json=json, loop=False, timing=timing)
    if json:
        return
    console = output.terminal(soft_wrap=True)
    console.print(output.styled("bold", "commands", f": {timing['accepted']} accepted, {timing['refused']} refused"))
    if timing["delay_s"] is not None:
        words = f"  mean delay {1e3 * timing['delay_s']:.3g} ms; safe torques {timing['silences']} times"
        console.print(words, highlight=False)
    if plant.settings.lockstep:
        return
    lateness = ", ".join(f"{number} {ends}" for ends, number in timing["lateness"].items() if number)
    counted = f"{timing['missed']} of {timing['ticks']} samples more than a period late"
    words = f": {counted}, the latest {timing['latest_us']:.0f} us"
    console.print(output.styled("bold", "time", words))
    console.print(f"  samples by lateness: {lateness}", highlight=False)
