"""``linearise --loop closed`` and ``--loop broken``: the sampled closed loop, its poles, margins and figures."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich import box
from rich.table import Table

from dualwinch.commands.linearise_tables import print_point
from dualwinch.commands.terminal import styled, terminal
from dualwinch.controllers.laws.fando_nftsm import FandoNftsm
from dualwinch.controllers.laws.nftsm import Nftsm
from dualwinch.model.errors import ConfigurationError
from dualwinch.model.linear.modes import modes
from dualwinch.model.linear.operating_point import operating_point
from dualwinch.model.linear.system import LinearSystem, save_sweep
from dualwinch.simulation.analysis.describing_function import AmplitudePoint, amplitude_sweep
from dualwinch.simulation.analysis.linear_loop import linear_broken_loop, linear_closed_loop
from dualwinch.simulation.analysis.margins import Margins, margins
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.loop.closed_loop import CUTS
from dualwinch.simulation.settings import override

FIGURES = {"closed": ("poles",), "broken": ("bode", "amplitude")}
"""What is linearised → its figures, the default first."""

PRINTED_AMPLITUDES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Amplitudes of the speed error in m/s that are printed."""


def linearise_loop(
    experiment: Experiment,
    values: dict[str, list[float]],
    swept: str | None,
    *,
    loop: str,
    cut: str | None,
    dt: float | None,
    out: Path | None,
    plot: Path | None,
    figure: str | None,
) -> None:
    """Linearise, print, write; `values` holds x, v and preload of every point, `swept` says which of them varies."""
    _check(loop, cut, dt, swept, figure)
    joint, console = cut or "u", terminal(stderr=True)
    points = np.broadcast_arrays(*(np.array(values[name]) for name in ("x", "v", "preload")))
    systems = []
    for x, v, preload in zip(*(column.tolist() for column in points), strict=True):
        asked = _with_preload(experiment, preload)
        systems.append(linear_closed_loop(asked, x, v) if loop == "closed" else linear_broken_loop(asked, x, v, joint))
    found = [margins(system) for system in systems] if loop == "broken" else []
    x, v, preload = (float(column[0]) for column in points)
    if loop == "closed":
        _print_closed(systems, experiment, swept, values)
    else:
        _print_margins(systems, found, swept, values)
        if swept is None and isinstance(experiment.controller.law, FandoNftsm | Nftsm) and systems[0].B.any():
            asked = _with_preload(experiment, preload)
            _print_amplitudes(amplitude_sweep(asked, x, v, joint, PRINTED_AMPLITUDES))
    if out:
        systems[0].save(out) if swept is None else save_sweep(systems, out)
        console.print(f"wrote {out}")
    if plot:
        from dualwinch.simulation.plots import save as save_figure
        from dualwinch.simulation.plots.linear import amplitude_margins, closed_loop_poles, loop_bode

        if loop == "closed":
            picture = closed_loop_poles(systems, swept)
        elif figure == "amplitude":
            picture = amplitude_margins(amplitude_sweep(_with_preload(experiment, preload), x, v, joint))
        else:
            picture = loop_bode(systems, found, swept)
        save_figure(picture, plot)
        console.print(f"wrote {plot}")


def _check(loop: str, cut: str | None, dt: float | None, swept: str | None, figure: str | None) -> None:
    if dt is not None:
        raise ConfigurationError(f"--dt and --loop {loop}: the loop has the controller's, simulation.sample_time")
    if cut and loop != "broken":
        raise ConfigurationError("--cut: needs --loop broken")
    if figure and figure not in FIGURES[loop]:
        raise ConfigurationError(f"--figure {figure} and --loop {loop}: must be {' or '.join(FIGURES[loop])}")
    if figure == "amplitude" and swept:
        raise ConfigurationError("--figure amplitude: shows one operating point; give no --sweep")


def _with_preload(experiment: Experiment, preload: float) -> Experiment:
    return override(experiment, {"controller.coordination.preload": float(preload)})


def _print_closed(
    systems: Sequence[LinearSystem], experiment: Experiment, swept: str | None, values: dict[str, list[float]]
) -> None:
    console = terminal()
    if swept is None:
        limits, (system,) = experiment.controller.limits, systems
        point = operating_point(
            values["x"][0],
            values["v"][0],
            values["preload"][0],
            experiment.plant,
            tension_min=limits.tension_min,
            tension_max=limits.command_max,
        )
        print_point(system, point, experiment.plant)
        radius = np.abs(system.poles()).max()
        console.print(f"\nspectral radius over a sample {radius:.9g}: {'stable' if radius < 1 else 'UNSTABLE'}")
        return
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for heading in (swept, "spectral radius", "slowest decay (s)", "least damping", "at (Hz)"):
        table.add_column(heading, justify="right", no_wrap=True)
    for value, system in zip(values[swept], systems, strict=True):
        found = modes(system, experiment.plant)
        slowest = max(found, key=lambda mode: abs(mode.eigenvalue))
        softest = min(found, key=lambda mode: mode.damping)
        table.add_row(
            f"{value:g}",
            f"{abs(slowest.eigenvalue):.7g}",
            f"{slowest.time_constant:.4g}",
            f"{softest.damping:.3g}",
            f"{softest.natural_frequency / (2 * math.pi):.4g}",
        )
    console.print(table)


def _print_margins(
    systems: Sequence[LinearSystem], found: Sequence[Margins], swept: str | None, values: dict[str, list[float]]
) -> None:
    console = terminal()
    cut = systems[0].inputs[0].removesuffix("_in")
    ratio = f" ({systems[0].outputs[0]}/{systems[0].inputs[0]})"
    console.print(styled("bold", f"margins of the loop cut at {cut}", ratio))
    if not any(system.B.any() for system in systems):
        console.print(f"nothing comes back: {CUTS[cut]} rests on its limit or answers to nothing here")
    table = _margin_table([swept] if swept else [])
    for k, margin in enumerate(found):
        table.add_row(*([f"{values[swept][k]:g}"] if swept else []), *_margin_words(margin))
    console.print(table)


def _print_amplitudes(points: Sequence[AmplitudePoint]) -> None:
    console = terminal()
    console.print(styled("bold", "by amplitude of the speed error", " (describing functions)"))
    table = _margin_table(["e2 m/s"])
    for point in points:
        table.add_row(f"{point.amplitude:g}", *_margin_words(point.margins))
    console.print(table)


def _margin_table(first: list[str]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for heading in (*first, "gain", "at Hz", "least", "phase °", "at Hz", "delay ms", "disk", ""):
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def _margin_words(found: Margins) -> list[str]:
    numbers = (
        found.gain,
        found.gain_frequency / (2 * math.pi),
        found.least_gain,
        found.phase,
        found.phase_frequency / (2 * math.pi),
        1e3 * found.delay,
        found.disk,
    )
    words = ["–" if math.isnan(number) else f"{number:.4g}".replace("inf", "∞") for number in numbers]
    return [*words, "" if found.stable else "UNSTABLE"]
