"""Register map of a served plant for datagrams, Modbus and OPC UA, as CSV or Markdown; a C client of it.

The client runs an exported controller.
"""

import csv
import io
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

from dualwinch.toolbox import ConfigurationError, Leaf, blocks, errors, package, texts, whole_files
from dualwinch.toolboxes.server.plant import PORT, SIGNALS, ServedPlant, signal_name

FIRST_INPUT = 1000
"""Modbus register of the first input; outputs begin at 0. Each value takes two: a 32-bit float, high word first."""

NAMESPACE = "urn:dualwinch:serve"
"""Namespace of OPC UA nodes."""

HEADER = 16
"""Length of a datagram's header in bytes."""


@dataclass(frozen=True)
class Register:
    """A value that clients read or, if it is an input, write, with its first Modbus register.

    The offset is that in a datagram from the server, in bytes; None: not in datagrams.
    """

    leaf: Leaf
    writable: bool
    modbus: int
    offset: int | None = None

    @property
    def name(self) -> str:
        """Name of the value, and of its node."""
        return self.leaf.key


def registers(plant: ServedPlant) -> list[Register]:
    """All registers of a plant, outputs first."""
    outputs = [
        Register(leaf, False, 2 * place, HEADER + 8 * place if place < plant.signals else None)  # noqa: FBT003
        for place, leaf in enumerate(plant.outputs.values())
    ]
    inputs = [
        Register(leaf, True, FIRST_INPUT + 2 * place)  # noqa: FBT003
        for place, leaf in enumerate(plant.inputs.values())
    ]
    return outputs + inputs


MAP_COLUMNS = ("name", "access", "unit", "meaning", "range", "modbus", "opc_ua", "datagram_offset")


def register_rows(plant: ServedPlant) -> list[tuple[str, ...]]:
    """Rows of the map: the `MAP_COLUMNS` of each register."""
    return [
        (
            register.name,
            "read, write" if register.writable else "read",
            register.leaf.quantity.unit,
            register.leaf.quantity.meaning,
            register.leaf.allowed,
            str(register.modbus),
            f"s={register.name}",
            "" if register.offset is None else str(register.offset),
        )
        for register in registers(plant)
    ]


def map_as_csv(plant: ServedPlant) -> str:
    """The map as a CSV file."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows([MAP_COLUMNS, *register_rows(plant)])
    return text.getvalue()


def map_as_page(plant: ServedPlant) -> str:
    """The map as a table in Markdown."""
    lines = [
        MAP_COLUMNS,
        ["---"] * len(MAP_COLUMNS),
        *([texts.markdown(cell) for cell in row] for row in register_rows(plant)),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"


FORMATS = {".csv": map_as_csv, ".md": map_as_page}
"""Suffix → function that formats the map."""


def write_map(plant: ServedPlant, path: str | PathLike[str]) -> None:
    """Write the map to a file, whose suffix selects the format: ``.csv`` or ``.md``.

    Raises:
        ConfigurationError: another suffix.
        OSError: the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in FORMATS:
        raise ConfigurationError(f"{path.name}: the name of a register map must end with {' or '.join(FORMATS)}")
    whole_files.write_whole(path, FORMATS[path.suffix](plant))


COMMAND_MAGIC, MEASUREMENT_MAGIC = b"DWC1", b"DWM1"
"""First bytes of datagrams from and to clients, as in paced_run.c."""


def udp_client(block: blocks.Block, name: str, provenance: package.Provenance) -> str:
    """A C99 program that runs a controller of `codegen.export.package.c_package` against ``dualwinch serve``.

    Raises:
        CodegenError: the controller has an input that a served plant does not send, such as a previewed reference.
    """
    signals = [signal_name(column) for column in SIGNALS]
    for variable in block.inputs:
        if variable.name not in signals:
            raise errors.CodegenError(
                f"the input {variable.name} is not sent by `dualwinch serve`; it sends {', '.join(signals)}"
            )
    return (
        package.templates("double", Path(__file__).parent / "templates")
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
