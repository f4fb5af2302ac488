"""A client of a served plant, written from the layout of its datagrams, and plants that are served to it."""

import socket
import struct
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from time import sleep
from typing import Any

import dualwinch as dw
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.results.result import Result
from dualwinch.toolboxes.server.plant import ServedPlant, ServerSettings

TORQUES, STARTS, HELLO = 1, 2, 4
RUNNING, SAFE, MAY_WRITE, ENDED = 1, 2, 4, 8
HOLDING = (22.0, 22.5)

COMMAND, HEAD = struct.Struct("<4sIQdd"), struct.Struct("<4sIQ")


@dataclass(frozen=True)
class Measurement:
    """A datagram of readings."""

    flags: int
    sequence: int
    signals: tuple[float, ...]


class Client:
    """A socket that exchanges datagrams with a served plant."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(120.0)
        self._last = -1

    def say(
        self, flags: int, sequence: int = 0, torques: tuple[float, float] = (0.0, 0.0), magic: bytes = b"DWC1"
    ) -> None:
        """Send a command."""
        self.socket.send(COMMAND.pack(magic, flags, sequence, *torques))

    def read(self) -> Measurement:
        """The next readings."""
        content = self.socket.recv(65536)
        magic, flags, sequence = HEAD.unpack_from(content)
        assert magic == b"DWM1"
        count = (len(content) - HEAD.size) // 8
        return Measurement(flags, sequence, struct.unpack_from(f"<{count}d", content, HEAD.size))

    def is_refused(self) -> bool:
        """Say hello; whether the system turns it away, as there is another client."""
        try:
            self.say(HELLO)
            sleep(0.01)
            self.say(HELLO)
        except ConnectionRefusedError:
            return True
        return False

    def begin(self, torques: tuple[float, float] = HOLDING) -> None:
        """Connect, and start a run under some torques."""
        self.say(HELLO)
        assert not self.read().flags & RUNNING
        self.say(TORQUES | STARTS, 0, torques)

    def sample(self) -> Measurement:
        """The readings of a sample of the run that has not been answered yet."""
        while True:
            read = self.read()
            if read.flags & ENDED or (read.flags & RUNNING and read.sequence > self._last):
                self._last = read.sequence
                return read

    def run(self, samples: int, torques: tuple[float, float] = HOLDING) -> Measurement:
        """Answer some samples with torques, or until the end; the last readings."""
        read = self.sample()
        for _ in range(samples - 1):
            if read.flags & ENDED:
                break
            self.say(TORQUES, read.sequence, torques)
            read = self.sample()
        if not read.flags & ENDED:
            self.say(TORQUES, read.sequence, torques)
        return read


def short(duration: float, **values: object) -> Experiment:
    """Case 4 for some time."""
    return dw.override(dw.case(4), {"simulation.duration": duration, **values})


@contextmanager
def serving(
    experiment: Experiment, settings: ServerSettings | None = None, *, runs: int = 1
) -> Iterator[tuple[Any, ...]]:
    """A plant that serves runs, in step with a client that may write unless settings say otherwise.

    Yields:
        The plant, a client, and the future of each run.
    """
    plant = ServedPlant(experiment, settings or ServerSettings(lockstep=True, may_write=True))
    client = Client(plant.port)
    with ThreadPoolExecutor(1) as pool:
        futures = [pool.submit(plant.serve) for _ in range(runs)]
        try:
            yield plant, client, *futures
        finally:
            plant.close()
            for future in futures:
                future.result(120)
            client.socket.close()
            plant.release()


def finished(run: "Future[Result | None]") -> Result:
    """What a run gave."""
    result = run.result(120)
    assert result is not None
    return result
