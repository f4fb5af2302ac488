"""Protocols of a served plant in addition to datagrams, OPC UA and Modbus TCP: servers in one thread's event loop."""

import asyncio
import contextlib
import logging
import struct
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from dualwinch.toolbox import ConfigurationError, errors, tables
from dualwinch.toolboxes.server.plant import CommandedError, ServedPlant
from dualwinch.toolboxes.server.registers import NAMESPACE, Register, registers

if TYPE_CHECKING:
    from asyncua import ua
    from asyncua.server.server import Server
    from asyncua.ua.attribute_ids import AttributeIds
    from pymodbus.constants import ExcCodes
    from pymodbus.server import ModbusTcpServer


class Protocol(ABC):
    """A server of one protocol, whose clients read and write a plant's registers.

    Attributes:
        host, port: address at which it listens.
    """

    name: str
    """Name of the protocol."""

    library: str
    """The library it needs, included in the extra ``serve``."""

    def __init__(self, host: str, port: int) -> None:
        """Set the address to listen at.

        Raises:
            ConfigurationError: an invalid port.
            MissingExtraError: its library is not installed.
        """
        if not 1 <= port <= 65535:
            raise ConfigurationError(f"{self.name} port = {port}: must be 1 to 65535")
        try:
            __import__(self.library)
        except ImportError:
            raise errors.MissingExtraError(self.library, "serve") from None
        logging.getLogger(self.library).setLevel(logging.CRITICAL)  # errors of clients are reported to the clients
        self.host, self.port = host, port

    @property
    @abstractmethod
    def address(self) -> str:
        """Address to which clients connect."""

    @abstractmethod
    async def open(self, plant: ServedPlant) -> None:
        """Start serving.

        Raises:
            OSError, RuntimeError: it cannot listen at its address.
        """

    @abstractmethod
    async def close(self) -> None:
        """End."""


@contextmanager
def served(plant: ServedPlant, protocols: Sequence[Protocol]) -> Iterator[None]:
    """Serve a plant over some protocols, in a separate thread.

    Raises:
        ConfigurationError: a protocol cannot listen at its address.
    """
    if not protocols:
        yield
        return
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, name="protocols", daemon=True)
    thread.start()
    with ExitStack() as stack:
        stack.callback(_end, loop, thread)
        for protocol in protocols:
            try:
                asyncio.run_coroutine_threadsafe(protocol.open(plant), loop).result()
            except (OSError, RuntimeError, UnicodeError) as error:
                raise ConfigurationError(f"cannot listen at {protocol.address}: {error}") from error
            stack.callback(lambda protocol=protocol: asyncio.run_coroutine_threadsafe(protocol.close(), loop).result())
        yield


def _end(loop: asyncio.AbstractEventLoop, thread: threading.Thread) -> None:
    async def finish() -> None:
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    asyncio.run_coroutine_threadsafe(finish(), loop).result()
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


READ_FUNCTIONS, WRITE_FUNCTION = (3, 4), 16
"""Function codes: read holding or input registers (identical here); write multiple registers, for whole floats."""


def words_of(value: float) -> tuple[int, int]:
    """A number as two registers."""
    return struct.unpack(">HH", struct.pack(">f", value))


def number_of(words: Sequence[int]) -> float:
    """The number in two registers."""
    return struct.unpack(">f", struct.pack(">HH", *words))[0]


CLIENT: ContextVar[str] = ContextVar("client", default="a client")
"""Address of the client whose request is being answered."""


def _server_that_knows_its_clients() -> "type[ModbusTcpServer]":
    """The library's server, whose requests are answered with the address of the client in `CLIENT`."""
    from pymodbus.server import ModbusTcpServer
    from pymodbus.server.requesthandler import ServerRequestHandler

    class ModbusRequests(ServerRequestHandler):
        async def handle_request(self) -> None:
            peer = self.transport.get_extra_info("peername") if self.transport else None
            CLIENT.set(f"{peer[0]}:{peer[1]}" if peer else "a client")
            await super().handle_request()

    class Server(ModbusTcpServer):
        def callback_new_connection(self) -> ModbusRequests:
            return ModbusRequests(self, self.trace_packet, self.trace_pdu, self.trace_connect)

    return Server


class Modbus(Protocol):
    """Modbus TCP, identical for every unit. A refused request changes nothing and is answered by an exception.

    Exception codes: 1 for unknown functions, and for writing where it is not allowed; 2 for unknown registers, and for
    half a number; 3 for a number out of its range; 6 for torques while another client commands.
    """

    name = "Modbus"
    library = "pymodbus"
    _server: "ModbusTcpServer"

    @property
    def address(self) -> str:
        """Address to which clients connect."""
        return f"{self.host}:{self.port} (Modbus TCP)"

    async def open(self, plant: ServedPlant) -> None:
        """Begin to serve."""
        from pymodbus.simulator import DataType, SimData, SimDevice

        self._plant, entries = plant, registers(plant)
        self._at = {register.modbus: register for register in entries}
        blocks = [
            SimData(register.modbus, values=[0, 0], datatype=DataType.REGISTERS, readonly=not register.writable)
            for register in entries
        ]
        device = SimDevice(0, simdata=blocks, action=self._act)
        self._server = _server_that_knows_its_clients()(device, address=(self.host, self.port))
        try:
            await self._server.serve_forever(background=True)
        except RuntimeError as error:  # the library gives no reason
            raise OSError("the port is in use, needs privileges, or the address is not this machine's") from error

    async def close(self) -> None:
        """End."""
        await self._server.shutdown()

    async def _act(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        current: list[int],
        given: list[int] | list[bool] | None,
    ) -> "ExcCodes | None":
        """Answer a request: return values to read, accept values to write."""
        from pymodbus.constants import ExcCodes

        if given is None and function in READ_FUNCTIONS:
            for number, value in self._values(address, count):
                current[number - start : number - start + 2] = words_of(value)
            return None
        if given is None or function != WRITE_FUNCTION or not self._plant.settings.may_write:
            return ExcCodes.ILLEGAL_FUNCTION
        places = range(address, address + count, 2)
        if count % 2 or any(place not in self._at for place in places):
            return ExcCodes.ILLEGAL_ADDRESS
        pairs = [[int(word) for word in given[place - address : place - address + 2]] for place in places]
        try:
            self._plant.write(
                {self._at[place].name: number_of(pair) for place, pair in zip(places, pairs, strict=True)},
                (CLIENT.get(), self.name),
            )
        except CommandedError:
            return ExcCodes.DEVICE_BUSY
        except ConfigurationError:
            return ExcCodes.ILLEGAL_VALUE
        return None

    def _values(self, address: int, count: int) -> list[tuple[int, float]]:
        """First register and value of every number in a range of registers."""
        addressed = [self._at[place] for place in range(address - 1, address + count) if place in self._at]
        values = self._plant.read() | self._plant.written
        return [(register.modbus, values[register.name]) for register in addressed]


def node_at(space: int, name: str) -> "ua.NodeId":
    """The node of a name in a namespace, by its index."""
    from asyncua import ua

    return ua.NodeId.from_string(f"ns={space};s={name}")


class OpcUa(Protocol):
    """OPC UA without encryption; any client that reaches the port may read, and write if writing is allowed.

    A refused write changes nothing and is answered with ``BadOutOfRange``, ``BadUserAccessDenied``,
    ``BadTypeMismatch`` or, for torques while another client commands, ``BadInvalidState``.
    """

    name = "OPC UA"
    library = "asyncua"
    period = 0.05
    """Time in s between two updates of the outputs."""

    _server: "Server"

    @property
    def address(self) -> str:
        """Address to which clients connect."""
        return f"opc.tcp://{self.host}:{self.port}/dualwinch"

    async def open(self, plant: ServedPlant) -> None:
        """Begin to serve."""
        from asyncua import ua
        from asyncua.server.server import Server

        self._plant = plant
        self._server = Server()
        await self._server.init()
        self._server.set_endpoint(self.address)
        self._server.set_server_name("dualwinch")
        self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        self._server.allow_remote_admin(False)  # noqa: FBT003
        space = await self._server.register_namespace(NAMESPACE)
        folder = await self._server.nodes.objects.add_object(node_at(space, "plant"), f"{space}:plant")
        self._nodes: dict[str, ua.NodeId] = {}
        for register in registers(plant):
            await self._add(folder, space, register)
        await self._server.start()
        self._updates = asyncio.create_task(self._update())

    async def _add(self, folder: Any, space: int, register: Register) -> None:
        from asyncua import ua
        from asyncua.ua.attribute_ids import AttributeIds

        quantity, node_id = register.leaf.quantity, node_at(space, register.name)
        node = await folder.add_variable(node_id, f"{space}:{register.name}", 0.0, ua.VariantType.Double)
        meaning = f"{quantity.meaning} [{tables.readable_unit(quantity.unit) or '1'}]"
        text = ua.DataValue(ua.Variant(ua.LocalizedText(meaning), ua.VariantType.LocalizedText))
        await node.write_attribute(AttributeIds.Description, text)
        self._nodes[register.name] = node_id
        if register.writable and self._plant.settings.may_write:
            await node.set_writable()
            self._server.set_attribute_value_setter(
                node_id, lambda data, attribute, value: self._written(register.name, data, attribute, value)
            )

    def _written(self, name: str, data: Any, attribute: "AttributeIds", value: "ua.DataValue") -> None:
        """Accept or refuse a value that a client writes."""
        from asyncua import ua

        if value.Value is None or not isinstance(value.Value.Value, float):
            raise ua.uaerrors.BadTypeMismatch
        try:
            self._plant.write({name: value.Value.Value}, ("a client", self.name))
        except CommandedError:
            raise ua.uaerrors.BadInvalidState from None
        except ConfigurationError:
            raise ua.uaerrors.BadOutOfRange from None
        data.attributes[attribute].value = value

    async def _update(self) -> None:
        from asyncua import ua

        while True:
            for name, value in self._plant.read().items():
                variant = ua.DataValue(ua.Variant(value, ua.VariantType.Double))
                await self._server.write_attribute_value(self._nodes[name], variant)
            await asyncio.sleep(self.period)

    async def close(self) -> None:
        """End."""
        self._updates.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._updates
        await self._server.stop()
