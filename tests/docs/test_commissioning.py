"""The lesson of docs/commissioning.md, with a plant in lockstep in place of one by the clock; and its map."""

import re
import socket
import struct
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from time import sleep

import pytest

import dualwinch as dw
from benchmarks.quoted.served import registers
from dualwinch.codegen.compiler import find_compiler
from dualwinch.export import export_c
from dualwinch.toolboxes.server.plant import ServedPlant, ServerSettings
from dualwinch.toolboxes.server.protocols import served
from dualwinch.toolboxes.server.registers import map_as_page
from tests.toolboxes.server.clients import HEAD, HELLO, Client, finished

PAGE = (Path(__file__).parents[2] / "docs" / "commissioning.md").read_text(encoding="utf-8")


def test_the_registers_are_those_of_a_plant() -> None:
    written = re.search(r"<!-- registers: begin -->\n(.*?)\n<!-- registers: end -->", PAGE, re.DOTALL)
    assert written
    assert written[1] == registers()


def test_a_datagram_has_the_signals_of_the_map() -> None:
    plant = ServedPlant(dw.case(4))
    client = Client(plant.port)
    with ThreadPoolExecutor(1) as pool:
        run = pool.submit(plant.serve)
        client.say(HELLO)
        content = client.socket.recv(1000)
        plant.close()
        run.result(120)
    client.socket.close()
    plant.release()
    offsets = [int(offset) for offset in re.findall(r"\| (\d+) \|$", map_as_page(plant), re.MULTILINE)]
    assert [*offsets, len(content)] == list(range(16, len(content) + 1, 8))


@contextmanager
def relayed(plant: ServedPlant) -> Iterator[int]:
    """A port that passes datagrams on, and lets time go on beyond the lesson's two instants once it has written.

    The lesson reads the clock on the wall, and a plant in lockstep is through all of it in a second or two.
    """
    near, far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    near.bind(("127.0.0.1", 0))
    far.connect(("127.0.0.1", plant.port))
    far.settimeout(120)

    def passes_on() -> None:
        command, program = near.recvfrom(65536)
        while command:
            far.send(command)
            readings = far.recv(65536)
            (t,) = struct.unpack_from("<d", readings, HEAD.size)
            for begins, outage in ((20.0, 1.0), (20.5, 0.0)):
                if begins <= t < begins + 0.002:
                    wait_for(plant, outage)
            near.sendto(readings, program)
            command, program = near.recvfrom(65536)

    with ThreadPoolExecutor(1) as pool:
        passing = pool.submit(passes_on)
        try:
            yield near.getsockname()[1]
        finally:
            near.sendto(b"", near.getsockname())
            passing.result(120)
            near.close()
            far.close()


def wait_for(plant: ServedPlant, outage: float) -> None:
    """Wait a minute at most until a client has written this."""
    for _ in range(60_000):
        if plant.written["outage"] == outage:
            return
        sleep(0.001)


@pytest.mark.slow
def test_the_lesson_drops_a_sensor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from dualwinch.toolboxes.server.protocols import Modbus

    monkeypatch.chdir(tmp_path)
    assert "export c --udp --case 4 --out controller" in PAGE
    export_c(dw.case(4), "controller", udp=True)
    build = re.search(r"^cc (-std=c99 .*)$", PAGE, re.MULTILINE)
    supervisor = re.search(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert build
    assert supervisor
    subprocess.run([*find_compiler().command, *build[1].split()], check=True)
    plant = ServedPlant(dw.case(4), ServerSettings(lockstep=True, may_write=True))
    code = supervisor[1].replace("5020", "15521")
    with served(plant, [Modbus("127.0.0.1", 15521)]), relayed(plant) as port, ThreadPoolExecutor(2) as pool:
        run = pool.submit(plant.serve)
        watching = pool.submit(exec, compile(code, "supervisor.py", "exec"), {})
        program = [tmp_path / "controller" / "udp", "127.0.0.1", str(port)]
        done = subprocess.run(program, check=True, capture_output=True, text=True)
        result = finished(run)
        watching.result(120)
    plant.release()
    assert done.stdout == "50000 samples, 0 with a status other than OK\n"
    silent = result["t"][result["x_read"] != result["x"]]
    assert 20.0 <= silent[0] < 20.01
    assert 20.4 < silent[-1] < 20.6
