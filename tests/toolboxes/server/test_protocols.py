import asyncio
import csv
import io
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from dualwinch.model.errors import ConfigurationError, MissingExtraError
from dualwinch.toolboxes.server.plant import COMMANDERS, CommandedError, ServedPlant, ServerSettings
from dualwinch.toolboxes.server.protocols import Modbus, OpcUa, Protocol, number_of, served, words_of
from dualwinch.toolboxes.server.registers import map_as_csv, map_as_page, registers, write_map
from tests.toolboxes.server.clients import HOLDING, TORQUES, finished, serving, short


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as any_free:
        return any_free.getsockname()[1]


@pytest.fixture(scope="module")
def plant() -> Iterator[ServedPlant]:
    """A plant that no run of is under way."""
    made = ServedPlant(short(0.1), ServerSettings(may_write=True))
    yield made
    made.release()


def test_the_map_names_every_input_and_output_once(plant: ServedPlant) -> None:
    rows = list(csv.DictReader(io.StringIO(map_as_csv(plant))))
    assert [row["name"] for row in rows] == [*plant.outputs, *plant.inputs]
    assert len({row["name"] for row in rows}) == len({row["modbus"] for row in rows}) == len(rows)
    by_name = {row["name"]: row for row in rows}
    assert by_name["F2"] == {
        "name": "F2",
        "access": "read",
        "unit": "N",
        "meaning": "measured tension of rope 2",
        "range": "",
        "modbus": "8",
        "opc_ua": "s=F2",
        "datagram_offset": "48",
    }
    assert by_name["force"]["range"] == ">= -100000 and <= 100000"
    assert map_as_page(plant).count("\n") == len(rows) + 2
    with pytest.raises(ConfigurationError, match=r"map.txt: the name of a register map must end with .csv or .md"):
        write_map(plant, "map.txt")


def words(*numbers: float) -> list[int]:
    return [word for number in numbers for word in words_of(number)]


def at(plant: ServedPlant, name: str) -> int:
    return next(register.modbus for register in registers(plant) if register.name == name)


def test_modbus_reads_and_writes_while_a_controller_runs() -> None:
    from pymodbus.client import ModbusTcpClient

    port = free_port()
    with serving(short(0.1)) as (plant, client, run), served(plant, [Modbus("127.0.0.1", port)]):
        modbus = ModbusTcpClient("127.0.0.1", port=port)
        assert modbus.connect()
        client.begin()
        client.run(50)
        client.sample()
        read = modbus.read_input_registers(0, count=2 * len(plant.outputs)).registers
        values = [number_of(read[place : place + 2]) for place in range(0, len(read), 2)]
        assert values == pytest.approx(list(plant.read().values()), rel=1e-6)
        assert modbus.read_holding_registers(at(plant, "F2"), count=2).registers == words(plant.read()["F2"])
        assert not modbus.write_registers(at(plant, "force"), words(500.0, 0.25)).isError()
        assert modbus.read_holding_registers(at(plant, "force"), count=4).registers == words(500.0, 0.25)
        assert (plant.written["force"], plant.written["current"]) == (500.0, 0.25)
        client.say(TORQUES, 50, HOLDING)
        client.run(100)
        modbus.close()
        assert finished(run).outcome == "completed"


def test_modbus_refuses_what_is_wrong_and_nothing_changes(plant: ServedPlant) -> None:
    from pymodbus.client import ModbusTcpClient

    port = free_port()
    with served(plant, [Modbus("127.0.0.1", port)]):
        modbus = ModbusTcpClient("127.0.0.1", port=port)
        assert modbus.connect()
        before, force = plant.written, at(plant, "force")
        answers = [
            (3, modbus.write_registers(force, words(1e9))),
            (3, modbus.write_registers(force, words(np.nan))),
            (3, modbus.write_registers(force, words(1.0, 1e9))),
            (2, modbus.write_registers(force + 1, [0, 0])),
            (2, modbus.write_registers(force, [0])),
            (2, modbus.write_registers(at(plant, "F1"), words(1.0))),
            (1, modbus.write_register(force, 1)),
            (1, modbus.mask_write_register(address=force, and_mask=0, or_mask=1)),
            (2, modbus.read_input_registers(500, count=2)),
            (1, modbus.read_coils(0)),
        ]
        assert [answer.exception_code for _, answer in answers] == [code for code, _ in answers]
        for garbage in (b"\0" * 300, b"\xff" * 5000, np.random.default_rng(1).bytes(20000), b"GET / HTTP/1.1\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", port)) as other:
                other.sendall(garbage)
        assert number_of(modbus.read_input_registers(at(plant, "F1"), count=2).registers) == pytest.approx(1000, abs=1)
        modbus.close()
    assert plant.written == before


def test_modbus_lets_nobody_write_without_leave() -> None:
    from pymodbus.client import ModbusTcpClient

    port, plant = free_port(), ServedPlant(short(0.1))
    with served(plant, [Modbus("127.0.0.1", port)]):
        modbus = ModbusTcpClient("127.0.0.1", port=port)
        assert modbus.connect()
        assert modbus.write_registers(at(plant, "start"), words(1.0)).exception_code == 1
        modbus.close()
    plant.release()


def test_torques_by_modbus_count_unless_a_controller_sends_them_by_datagram() -> None:
    with serving(short(0.06)) as (plant, client, run):
        client.begin()
        client.run(10)
        client.sample()
        assert plant.read()["commander"] == COMMANDERS.index("UDP")
        with pytest.raises(CommandedError, match=r"commanded by a client \(UDP\)"):
            plant.write({"tau_1_cmd": 30.0, "tau_2_cmd": 31.0})
        client.say(TORQUES, 10, HOLDING)
        client.run(100)
        assert set(finished(run)["tau_1"]) == {HOLDING[0]}
    settings = ServerSettings(may_write=True, rate=20.0, watchdog=0.2)
    with serving(short(0.1), settings) as (plant, _, run):
        plant.write({"tau_1_cmd": 30.0, "tau_2_cmd": 31.0, "start": 1.0})
        assert set(finished(run)["tau_1"]) == {30.0}


def test_the_second_client_that_commands_torques_is_told_and_the_first_is_named(plant: ServedPlant) -> None:
    from pymodbus.client import ModbusTcpClient

    port, torques, place = free_port(), words(22.0, 22.0), at(plant, "tau_1_cmd")
    with served(plant, [Modbus("127.0.0.1", port)]):
        first, second = (ModbusTcpClient("127.0.0.1", port=port) for _ in range(2))
        assert first.connect()
        assert second.connect()
        assert not first.write_registers(place, torques).isError()
        assert second.write_registers(place, torques).exception_code == 6
        assert plant.commander[1] == "Modbus"
        assert plant.read()["commander"] == COMMANDERS.index("Modbus")
        assert not second.write_registers(at(plant, "force"), words(10.0)).isError()
        with pytest.raises(CommandedError):
            plant.write({"tau_1_cmd": 22.0})
        first.close()
        second.close()


def test_an_address_in_use_is_refused(plant: ServedPlant) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(ConfigurationError, match=f"cannot listen at 127.0.0.1:{port}"):  # noqa: SIM117
            with served(plant, [Modbus("127.0.0.1", port)]):
                pass


def test_a_library_that_is_missing_is_named() -> None:
    class Missing(Modbus):
        library = "no_such_library"

    with pytest.raises(MissingExtraError, match=r"no_such_library is not installed; .* 'dualwinch\[serve\]'"):
        Missing("127.0.0.1", 5020)


@pytest.mark.parametrize("kind", [Modbus, OpcUa])
def test_a_port_that_there_is_not_is_refused(kind: type[Protocol]) -> None:
    with pytest.raises(ConfigurationError, match="port = 70000: must be 1 to 65535"):
        kind("127.0.0.1", 70000)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_opc_ua_reads_and_writes_and_refuses_what_is_wrong(plant: ServedPlant) -> None:
    from asyncua import ua
    from asyncua.client.client import Client

    protocol = OpcUa("127.0.0.1", free_port())

    async def use() -> None:
        async with Client(protocol.address) as client:
            space = await client.get_namespace_index("urn:dualwinch:serve")
            nodes = {name: client.get_node(f"ns={space};s={name}") for name in [*plant.outputs, *plant.inputs]}
            assert await nodes["F1"].read_value() == pytest.approx(1000, abs=1)
            assert (await nodes["F1"].read_description()).Text == "measured tension of rope 1 [N]"
            await nodes["force"].write_value(250.0)
            assert await nodes["force"].read_value() == plant.written["force"] == 250.0
            refused = [(nodes["force"], odd) for odd in (1e9, np.nan, "x")] + [(nodes["F1"], 1.0)]
            for node, value in refused:
                with pytest.raises(ua.UaStatusCodeError):
                    await node.write_value(value)
        admin = Client(protocol.address)
        admin.set_user("admin")
        async with admin:
            with pytest.raises(ua.UaStatusCodeError):
                await admin.get_node(f"ns={space};s=F1").write_value(1.0)

    with served(plant, [protocol]):
        with socket.create_connection(("127.0.0.1", protocol.port)) as other:
            other.sendall(np.random.default_rng(1).bytes(20000))
        with ThreadPoolExecutor(1) as pool:  # a browser's test may have left a loop running in this thread
            pool.submit(asyncio.run, use()).result(120)
    assert plant.written["force"] == 250.0
