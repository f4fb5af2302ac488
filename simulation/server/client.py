"""An exported controller as a client of a served plant: a C program around it."""

from dualwinch.codegen.block import Block
from dualwinch.codegen.errors import CodegenError
from dualwinch.codegen.export.package import Provenance, templates
from dualwinch.simulation.server.plant import PORT, SIGNALS, signal_name

COMMAND_MAGIC, MEASUREMENT_MAGIC = b"DWC1", b"DWM1"
"""First bytes of the datagrams from clients, and of those to them; as in codegen/drivers/realtime.c."""


def udp_client(block: Block, name: str, provenance: Provenance) -> str:
    """C99 program that runs a controller of `codegen.export.package.c_package` against ``dualwinch serve``.

    Args:
        block: the controller.
        name: of the package.
        provenance: goes into a comment.

    Raises:
        CodegenError: the controller has an input that a served plant does not send, such as a reference ahead of time.
    """
    signals = [signal_name(column) for column in SIGNALS]
    for variable in block.inputs:
        if variable.name not in signals:
            raise CodegenError(
                f"the input {variable.name} is not sent by `dualwinch serve`; it sends {', '.join(signals)}"
            )
    return (
        templates("double")
        .get_template("udp.c.j2")
        .render(
            block=block,
            name=name,
            signals=signals,
            port=PORT,
            provenance=provenance,
            command_magic=hex(int.from_bytes(COMMAND_MAGIC, "little")),
            measurement_magic=hex(int.from_bytes(MEASUREMENT_MAGIC, "little")),
        )
    )
