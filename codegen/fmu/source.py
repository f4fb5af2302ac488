"""The C source of an FMU: one file that needs nothing but the C library."""

import hashlib
import math
import sys
from importlib.resources import files

from dualwinch.codegen.fmu.model import FmuModel, Signal
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.text import c_comment

ROLES = ("input", "parameter", "output", "state", "derivative")
"""What the vectors in an instance's memory hold, in this order."""

WRAPPERS = {2: ("core.c", "fmi2.c"), 3: ("core.c", "fmi3.c", "fmi3_lacking.c")}
"""What stands around the generated functions, by version of FMI."""


def fmu_source(model: FmuModel) -> tuple[str, str]:
    """The C source of an FMU and its token, which the model description repeats."""
    functions = model.functions
    tangents = [tangent for tangent in (functions.start_tangent, functions.now_tangent) if tangent is not None]
    body = [
        *_sizes(model),
        *_tables(model),
        c_source([functions.derive, functions.start, functions.now, functions.step, *tangents]),
        *((files("dualwinch.codegen.fmu") / name).read_text(encoding="utf-8") for name in WRAPPERS[model.version]),
    ]
    digest = hashlib.sha256("\n".join(body).encode()).hexdigest()
    token = f"{{{'-'.join((digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32]))}}}"
    what = f"{model.block.name}: {model.block.description}; functional mock-up unit, FMI {model.version}.0"
    heading = f"/* {c_comment(what)} */"
    return "\n".join([heading, f'#define TOKEN "{token}"', *body]), token


def _sizes(model: FmuModel) -> list[str]:
    sizes: dict[str, int] = {}
    reference = 0
    for role in ROLES:
        count = len(model.of(role))
        sizes |= {f"{role.upper()}S": count, f"FIRST_{role.upper()}": reference}
        reference += count
    sizes["DERIVED"] = model.functions.derive.numel_out("derived")
    sizes |= {"TIME": reference, "VARIABLES": reference + 1, "HAS_DERIVATIVES": int(bool(model.of("derivative")))}
    sizes["HAS_HELD"] = int(model.functions.on_input[len(model.of("derivative")) :].any())
    return [
        *(f"#define {name} {size}" for name, size in sizes.items()),
        f"#define SAMPLE_TIME {model.block.sample_time!r}",
        f"#define MODEL_IDENTIFIER {model.block.name}",
        f"#define OFFERS_MODEL_EXCHANGE {int(model.flows)}",
        f"#define OFFERS_CO_SIMULATION {int(model.steps)}",
    ]


def _tables(model: FmuModel) -> list[str]:
    """Names, start values and ranges of all variables, and which outputs answer an input at once."""
    listed = model.signals
    nominals = [_number(state.nominal) for state in model.block.continuous]
    uses = model.functions.on_input[len(model.of("derivative")) :]
    return [
        _table("const char *const name", "VARIABLES", [f'"{signal.name}"' for signal in listed]),
        _table("double start_value", "VARIABLES", [_number(signal.variable.start) for signal in listed]),
        _table("double lower", "VARIABLES", [_number(_limits(signal)[0]) for signal in listed]),
        _table("double upper", "VARIABLES", [_number(_limits(signal)[1]) for signal in listed]),
        *([_table("double nominal", "DERIVATIVES", nominals)] if model.flows else []),
        _table("int held", "OUTPUTS", [str(int(row.any())) for row in uses]),
    ]


def _limits(signal: Signal) -> tuple[float, float]:
    """Range within which a variable can be set; a state can be any number."""
    largest = sys.float_info.max
    if signal.role not in {"input", "parameter"}:
        return -largest, largest
    lower = max(signal.variable.lower, -largest)
    if signal.variable.exclusive:
        lower = math.nextafter(lower, largest)
    return lower, min(signal.variable.upper, largest)


def _number(value: float) -> str:
    return repr(float(value)) if math.isfinite(value) else "0.0"


def _table(what: str, size: str, entries: list[str]) -> str:
    constant = what if what.startswith("const") else f"const {what}"
    lines = [", ".join(entries[reference : reference + 6]) for reference in range(0, len(entries), 6)]
    return f"static {constant}[{size}] = {{\n  " + ",\n  ".join(lines) + "};"
