"""OPC UA: registers of a served plant as variables."""

import asyncio
import contextlib
from typing import TYPE_CHECKING, Any

from dualwinch.model.errors import ConfigurationError
from dualwinch.model.quantities.tables import readable_unit
from dualwinch.simulation.server.plant import ServedPlant
from dualwinch.simulation.server.protocols import Protocol
from dualwinch.simulation.server.registers import NAMESPACE, Register, registers

if TYPE_CHECKING:
    from asyncua import ua
    from asyncua.server.server import Server
    from asyncua.ua.attribute_ids import AttributeIds


def node_at(space: int, name: str) -> "ua.NodeId":
    """The node of a name in a namespace."""
    from asyncua import ua

    return ua.NodeId.from_string(f"ns={space};s={name}")


class OpcUa(Protocol):
    """OPC UA without encryption; any client that reaches the port may read, and write where that is allowed.

    A write that is refused changes nothing, and is answered with ``BadOutOfRange``, ``BadUserAccessDenied`` or
    ``BadTypeMismatch``.
    """

    name = "OPC UA"
    library = "asyncua"
    period = 0.05
    """Time in s between two updates of what is read."""

    _server: "Server"

    @property
    def address(self) -> str:
        """What clients connect to."""
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
        meaning = f"{quantity.meaning} [{readable_unit(quantity.unit) or '1'}]"
        text = ua.DataValue(ua.Variant(ua.LocalizedText(meaning), ua.VariantType.LocalizedText))
        await node.write_attribute(AttributeIds.Description, text)
        self._nodes[register.name] = node_id
        if register.writable and self._plant.settings.may_write:
            await node.set_writable()
            self._server.set_attribute_value_setter(
                node_id, lambda data, attribute, value: self._written(register.name, data, attribute, value)
            )

    def _written(self, name: str, data: Any, attribute: "AttributeIds", value: "ua.DataValue") -> None:
        """Take over what a client writes."""
        from asyncua import ua

        if value.Value is None or not isinstance(value.Value.Value, float):
            raise ua.uaerrors.BadTypeMismatch
        try:
            self._plant.write({name: value.Value.Value})
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
