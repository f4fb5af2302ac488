"""Files made from valid ones by mutation."""

import re

from hypothesis import strategies as st

from tests.attack.words import LITERALS, all_keys

LINES = [
    "[a]",
    "[[a]]",
    "[plant]",
    "plant = 3",
    "x = 1",
    "[",
    "]",
    "= 3",
    "#",
    "\x00",
    '"""',
    "[distributions]",
    "[plant.vehicle]",
]

BYTES = [
    b"\xff",
    b"\x00",
    b"\r",
    b"\xef\xbb\xbf",
    b'"',
    b"=",
    b"[",
    b"{",
    b",",
    b"\n",
    "½".encode(),
    b"e400",
    b"-",
    b"9" * 30,
]


@st.composite
def mutated(draw: st.DrawFn, text: str) -> bytes:
    """A text in TOML or CSV with a few lines and bytes changed."""
    lines = text.splitlines()
    told = [index for index, line in enumerate(lines) if "=" in line and not line.startswith("#")]
    for _ in range(draw(st.integers(1, 3))):
        index = draw(st.integers(0, len(lines) - 1))
        match draw(st.sampled_from(["value", "value", "value", "key", "delete", "twice", "swap", "insert", "cell"])):
            case "value" if told:
                index = draw(st.sampled_from(told))
                value = draw(st.sampled_from(LITERALS))
                lines[index] = re.sub(r"=.*", lambda _, value=value: f"= {value}", lines[index])
            case "key" if told:
                index = draw(st.sampled_from(told))
                key = draw(st.sampled_from(all_keys()))
                lines[index] = re.sub(r"^[^=]*", lambda _, key=key: f"{key.rpartition('.')[2]} ", lines[index])
            case "cell":
                cells = lines[index].split(",")
                cells[draw(st.integers(0, len(cells) - 1))] = draw(st.sampled_from(LITERALS))
                lines[index] = ",".join(cells)
            case "delete":
                lines[index] = ""
            case "twice":
                lines.insert(index, lines[index])
            case "swap":
                other = draw(st.integers(0, len(lines) - 1))
                lines[index], lines[other] = lines[other], lines[index]
            case _:
                lines.insert(index, draw(st.sampled_from(LINES)))
    content = "\n".join(lines).encode() + b"\n"
    if draw(st.integers(0, 3)) == 0:
        position = draw(st.integers(0, len(content)))
        content = content[:position] + draw(st.sampled_from(BYTES)) + content[position:]
    if draw(st.integers(0, 7)) == 0:
        content = content[: draw(st.integers(0, len(content)))]
    return content
