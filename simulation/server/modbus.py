"""Modbus TCP: registers of a served plant as 32-bit floats, two registers each, high word first."""

import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dualwinch.model.errors import ConfigurationError
from dualwinch.simulation.server.plant import ServedPlant
from dualwinch.simulation.server.protocols import Protocol
from dualwinch.simulation.server.registers import Register, registers

if TYPE_CHECKING:
    from pymodbus.constants import ExcCodes
    from pymodbus.server import ModbusTcpServer

READ_FUNCTIONS, WRITE_FUNCTION = (3, 4), 16
"""Read holding and input registers, the same here; write multiple registers, as no float is half written."""


def words_of(value: float) -> tuple[int, int]:
    """A number as two registers."""
    return struct.unpack(">HH", struct.pack(">f", value))


def number_of(words: Sequence[int]) -> float:
    """The number in two registers."""
    return struct.unpack(">f", struct.pack(">HH", *words))[0]


class Modbus(Protocol):
    """Modbus TCP, every unit the same. A request that is refused changes nothing, and is answered by an exception.

    Its codes: 1 for functions there are not, and for writing where it is not allowed; 2 for registers there are not,
    and for half a number; 3 for a number that is out of its range.
    """

    name = "Modbus"
    library = "pymodbus"
    _server: "ModbusTcpServer"

    @property
    def address(self) -> str:
        """What clients connect to."""
        return f"{self.host}:{self.port} (Modbus TCP)"

    async def open(self, plant: ServedPlant) -> None:
        """Begin to serve."""
        from pymodbus.server import ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice

        self._plant, known = plant, registers(plant)
        self._at = {register.modbus: register for register in known}
        blocks = [
            SimData(register.modbus, values=[0, 0], datatype=DataType.REGISTERS, readonly=not register.writable)
            for register in known
        ]
        device = SimDevice(0, simdata=blocks, action=self._act)
        self._server = ModbusTcpServer(device, address=(self.host, self.port))
        try:
            await self._server.serve_forever(background=True)
        except RuntimeError as error:  # it says no more
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
        """Answer a request: fill in what is read, take over what is written."""
        from pymodbus.constants import ExcCodes

        if given is None:
            if function not in READ_FUNCTIONS:
                return ExcCodes.ILLEGAL_FUNCTION
            for number, value in self._values(address, count):
                current[number - start : number - start + 2] = words_of(value)
            return None
        if function != WRITE_FUNCTION or not self._plant.settings.may_write:
            return ExcCodes.ILLEGAL_FUNCTION
        places = range(address, address + count, 2)
        if count % 2 or any(place not in self._at for place in places):
            return ExcCodes.ILLEGAL_ADDRESS
        pairs = [[int(word) for word in given[place - address : place - address + 2]] for place in places]
        try:
            self._plant.write(
                {self._at[place].name: number_of(pair) for place, pair in zip(places, pairs, strict=True)}
            )
        except ConfigurationError:
            return ExcCodes.ILLEGAL_VALUE
        return None

    def _values(self, address: int, count: int) -> list[tuple[int, float]]:
        """First register and value of every number that some registers belong to."""
        wanted = [self._at[place] for place in range(address - 1, address + count) if place in self._at]
        outputs, inputs = self._plant.read(), self._plant.written

        def value(register: Register) -> float:
            return inputs[register.name] if register.writable else outputs[register.name]

        return [(register.modbus, value(register)) for register in wanted]
