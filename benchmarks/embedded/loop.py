"""What single precision does to a run: the controller alone in it, or plant and controller both."""

import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.embedded.host import Host, build
from dualwinch.codegen.block import Block
from dualwinch.codegen.compiler import find_compiler
from dualwinch.codegen.export.package import Provenance, c_package
from dualwinch.codegen.source.operations import Precision
from dualwinch.model.quantities.tree import with_leaves
from dualwinch.simulation.blocks import block
from dualwinch.simulation.exogenous.signals import exogenous_signals
from dualwinch.simulation.experiment import Experiment
from dualwinch.simulation.paper import CASES, case
from dualwinch.simulation.simulate import simulate


def _instance(folder: str, made: Block, precision: Precision) -> Host:
    name = f"{made.name}_{precision}"
    package = c_package(made, name, Provenance("dualwinch", "", ""), precision)
    return Host(build(Path(folder), package, name, find_compiler().command), name, made, precision)


def float_controller(experiment: Experiment) -> NDArray[np.float64]:
    """Position and tensions (samples, 3) with the controller in single and the plant in double precision."""
    references = exogenous_signals(experiment)[:, :3]
    made, pilot = block("plant", experiment), block("controller", experiment)
    names = [variable.name for variable in made.outputs]
    sensed = [len(made.states) + names.index(given.name) for given in pilot.inputs if given.name in names]
    shown = [len(made.states) + names.index(name) for name in ("x", "F1", "F2")]
    rows = np.empty((len(references), len(shown)))
    with tempfile.TemporaryDirectory() as folder:
        plant, controller = _instance(folder, made, "double"), _instance(folder, pilot, "float")
        for row, reference in zip(rows, references, strict=True):
            row[:] = plant.state[shown]
            controller.input[:] = [*plant.state[sensed], *reference]
            controller.step()
            plant.input[:2] = controller.output[:2]
            plant.step()
    return rows


def float_loop(experiment: Experiment) -> NDArray[np.float64]:
    """Position and tensions (samples, 3) with everything in single precision."""
    made = block("closed-loop", experiment)
    names = [variable.name for variable in made.outputs]
    inputs = np.tile([variable.start for variable in made.inputs], (experiment.samples, 1))
    inputs[:, :3] = exogenous_signals(experiment)[:, :3]
    with tempfile.TemporaryDirectory() as folder:
        outputs = _instance(folder, made, "float").run(inputs)
    return outputs[:, [names.index(name) for name in ("x", "F1", "F2")]].astype(float)


def loop_table() -> list[str]:
    """Largest differences from `simulate` over each case of the paper, in Markdown."""
    runs = ("controller in float", "with the Kalman filter", "plant in float too")
    lines = [
        f"| Case | {' | '.join(f'{run}: m | N' for run in runs)} |",
        "|---|" + "--:|" * 2 * len(runs),
    ]
    for number in CASES:
        experiment = case(number)
        filtered = with_leaves(experiment, {"controller.estimator": "kalman"})
        cells = []
        for run, of in ((float_controller, experiment), (float_controller, filtered), (float_loop, experiment)):
            columns = simulate(of).columns
            exact = np.column_stack([columns[name] for name in ("x", "F1", "F2")])
            off = np.abs(run(of) - exact).max(axis=0)
            cells += [f"{off[0]:.1g}", f"{off[1:].max():.2g}"]
        lines.append(f"| {number} | {' | '.join(cells)} |")
    return lines
