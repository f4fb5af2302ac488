"""C source of a module: the closed loop, what it receives from outside, and the run of a page."""

from importlib.resources import files

from dualwinch.codegen.drivers.signals.signals import FILL_PARTS
from dualwinch.codegen.drivers.unit import hoisted_all, macros_of_lists, unit
from dualwinch.codegen.source.c_source import c_source
from dualwinch.codegen.source.hoist import hoisted
from dualwinch.codegen.source.operations import Style
from dualwinch.lab.wasm.functions import KINDS, drawn_function, figures_function, parameters_function
from dualwinch.lab.wasm.motion import duration_function, motion_function, motion_names
from dualwinch.lab.wasm.settings import SAMPLE_TIME, Settings
from dualwinch.simulation.exogenous.signals import stream_number
from dualwinch.simulation.loop.closed_loop import start_function
from dualwinch.simulation.loop.structure import structure_of

INLINED = Style(compares=True, inlined=True)
"""How operations are written: without calls, which a module would have to hold."""


def module_source(settings: Settings) -> str:
    """C99 translation unit of a structure's module."""
    loop = settings.loop
    figures, given = figures_function(settings), motion_names(settings)
    functions = [
        *hoisted_all(loop.functions),
        *hoisted(motion_function(settings)),
        start_function(structure_of(settings.wide)),
        parameters_function(settings),
        duration_function(settings),
        figures,
    ]
    exogenous = loop.closed.exogenous
    sizes = loop.sizes | {
        "SETTINGS": settings.vector.numel(),
        "SAMPLE_TIME": settings.keys.index(SAMPLE_TIME),
        "QUEUE": loop.queue,
        "KINDS": len(KINDS),
        "GIVEN": len(given),
        "METRICS": figures.numel_out("metrics"),
    }
    streams = (f"UINT64_C({stream_number(name)})" for name in exogenous)
    listed = macros_of_lists(STREAMS=streams, GIVEN_AT=map(exogenous.index, given))
    own = files("dualwinch.lab.wasm")
    delay, run = ((own / name).read_text(encoding="utf-8") for name in ("delay.h", "run.c"))
    # how fast random signals decay must be exact: what an error of 1e-9 does grows with the time that they last
    written = c_source(functions, INLINED), c_source([drawn_function(settings)])
    return unit(sizes, functions, *FILL_PARTS, listed, *written, delay, "rollout.c", run)
