"""The tables of the embedded controller: what it costs on each processor, and what single precision does to a run."""

import subprocess
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.embedded.board import BOARDS, COMPILER, DOUBLE_BOARD, EMULATOR, measure
from benchmarks.embedded.loop import loop_table
from dualwinch.codegen.block import Block
from dualwinch.codegen.export.package import Provenance, c_package, frozen, prepared
from dualwinch.codegen.source.operations import Precision
from dualwinch.config.experiment_file import load
from dualwinch.controllers.controller import POSITION_LAWS
from dualwinch.controllers.registry import ESTIMATORS
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import asked_motion
from dualwinch.simulation.paper import case
from dualwinch.simulation.results.result import Result
from dualwinch.simulation.simulate import simulate

NAME = "controller"
ABOUT = Provenance("dualwinch", "Case 4", "today")

WILD = 20_000
"""Random samples after those of the run, to drive every branch of the mathematical functions."""

PRECISE_BOARDS = (BOARDS[0], DOUBLE_BOARD)
"""Single precision, and double precision."""

SEARCHED = Path(__file__).parents[1] / "independent" / "searched.toml"
"""Gains tuned in `site`."""

MEMORY = 14_000_000
"""Bytes on a board for the inputs and outputs of a run."""

HEAVY = "controller of `site`: wheel, give and sag learnt"
"""What their row is called."""

VARIANTS = (("lowpass", False), ("kalman", False), ("kalman", True))
"""Estimator, and whether the parameters are constants, that the position laws are measured with."""


def recorded(result: Result, controller: Block) -> NDArray[np.float32]:
    """The controller's inputs (samples, inputs) in a run."""
    columns = asked_motion(result.experiment) | result.columns
    return np.column_stack([columns[variable.name] for variable in controller.inputs]).astype(np.float32)


def wild(controller: Block, samples: int, seed: int = 0) -> NDArray[np.float32]:
    """Random inputs (samples, inputs) all over and beyond their range, tiny ones and huge ones among them."""
    random = np.random.default_rng(seed)
    size = 10.0 ** random.uniform(-12, 6, (samples, len(controller.inputs)))
    return (size * random.choice([-1, 0, 1], size.shape, p=[0.45, 0.1, 0.45])).astype(np.float32)


def report() -> str:
    """All tables in Markdown.

    Raises:
        RuntimeError: a program fails.
    """
    experiment = case(4)
    controller = block("controller", experiment)
    run = recorded(simulate(experiment), controller)
    inputs = np.concatenate([run, wild(controller, WILD)])
    headings = [
        "processor",
        "parameters",
        "instructions a step: mean",
        "worst",
        "worst, random inputs",
        "code, B",
        "RAM an instance, B",
        "stack, deepest seen, B",
        "preparing, once",
    ]
    lines = [f"| {' | '.join(headings)} |", "|---|---|" + "--:|" * (len(headings) - 2)]
    for freeze in (False, True):
        package = c_package(controller, NAME, ABOUT, "float", freeze=freeze)
        ram = _ram(controller, "float", freeze=freeze)
        for board in BOARDS:
            got = measure(board, package, NAME, inputs, len(controller.outputs), freeze=freeze)
            inside, beyond = np.split(got.instructions, [len(run)])
            cells = [
                board.name,
                "constants" if freeze else "at run time",
                f"{inside.mean():.0f}",
                inside.max(),
                beyond.max(),
                got.code,
                ram,
                got.stack,
                "–" if freeze else got.preparation,
            ]
            lines.append(f"| {' | '.join(map(str, cells))} |")
    compilers = [_version(COMPILER), _version(EMULATOR)]
    return "\n".join([*lines, "", *_laws(), "", *_estimators(), "", *loop_table(), "", f"*{' · '.join(compilers)}*"])


def _ram(controller: Block, precision: Precision, *, freeze: bool) -> int:
    """Bytes of state, input and output, and of what steps need of the parameters."""
    apart = prepared(frozen(controller) if freeze else controller, precision)
    numbers = len(controller.states) + apart.lost + 2 * len(controller.outputs) + len(controller.inputs)
    if not freeze:
        numbers += len(apart.parameters) + apart.derived + 1
    return numbers * (4 if precision == "float" else 8)


def _laws() -> list[str]:
    """Worst instructions a step and stack of every position law over Case 4, on the first board."""
    headings = [f"{name}, constants: worst | stack, B" if freeze else f"{name}: worst" for name, freeze in VARIANTS]
    columns = " | ".join(headings)
    lines = [
        f"| position law, on the {BOARDS[0].name} | {columns} |",
        "|---|" + "--:|" * (columns.count("|") + 1),
    ]
    for kind in POSITION_LAWS:
        cells = []
        for estimator, freeze in VARIANTS:
            experiment = with_leaves(case(4, kind), {"controller.estimator": estimator})
            controller = block("controller", experiment)
            inputs = recorded(simulate(experiment), controller)
            package = c_package(controller, NAME, ABOUT, "float", freeze=freeze)
            got = measure(BOARDS[0], package, NAME, inputs, len(controller.outputs), freeze=freeze)
            cells += [str(got.instructions.max()), *([str(got.stack)] if freeze else [])]
        lines.append(f"| {kind} | {' | '.join(cells)} |")
    return lines


def _estimators() -> list[str]:
    """What estimators cost before the paper's law in Case 4, with parameters at run time; and `site`'s controller."""
    headings = ["instructions a step: worst", "preparing, once", "code, B", "RAM an instance, B", "stack, B"]
    lines = [
        f"| estimator | processor | precision | {' | '.join(headings)} |",
        "|---|---|---|" + "--:|" * len(headings),
    ]
    filters = [kind for kind in ESTIMATORS if kind != "none"]
    experiments = {kind: with_leaves(case(4), {"controller.estimator": kind}) for kind in filters}
    for estimator, experiment in (experiments | {HEAVY: load(SEARCHED)}).items():
        controller = block("controller", experiment)
        fitting = MEMORY // (8 * (len(controller.inputs) + len(controller.outputs)))
        inputs = recorded(simulate(experiment), controller)[:fitting]
        for board in PRECISE_BOARDS:
            package = c_package(controller, NAME, ABOUT, board.precision)
            got = measure(board, package, NAME, inputs, len(controller.outputs), freeze=False)
            ram = _ram(controller, board.precision, freeze=False)
            lines.append(
                f"| {estimator} | {board.name} | {board.precision} | {got.instructions.max()} "
                f"| {got.preparation} | {got.code} | {ram} | {got.stack} |"
            )
    return lines


def _version(command: str) -> str:
    answer = subprocess.run([command, "--version"], capture_output=True, text=True, check=True)
    return answer.stdout.splitlines()[0]
