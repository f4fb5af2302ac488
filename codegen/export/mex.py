"""Blocks as MEX sources for MATLAB and GNU Octave, with a script of the closed loop."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from dualwinch.codegen.block import Block, Variable
from dualwinch.codegen.export.package import Provenance, c_package, templates


def mex_files(
    plant: Block,
    controller: Block,
    name_of: Callable[[Block], str],
    reference: Mapping[str, ArrayLike],
    provenance: Provenance,
) -> dict[str, str]:
    """File name → content: for each block its C package and ``NAME_mex.c``; ``build.m``, ``closed_loop.m``.

    Args:
        plant: outputs named as the controller's inputs, except for the reference.
        controller: outputs named as the plant's inputs, except for disturbances.
        name_of: block → C identifier.
        reference: (samples,) for each input of the controller that is no output of the plant, by name.
        provenance: written into every file.

    Raises:
        CodegenError: as in `c_package`.
    """
    environment = templates("double")
    files: dict[str, str] = {}
    for block in (plant, controller):
        name = name_of(block)
        package = c_package(block, name, provenance)
        files |= {file: package[file] for file in (f"{name}.h", f"{name}.c")}
        facts = {"block": block, "name": name, "provenance": provenance}
        files[f"{name}_mex.c"] = environment.get_template("mex.c.j2").render(facts)
    outputs, commands = _positions(plant.outputs), _positions(controller.outputs)
    inputs, drives = _positions(controller.inputs), _positions(plant.inputs)
    names = [name for name in inputs if name not in outputs]
    facts = {
        "plant": plant,
        "controller": controller,
        "plant_name": name_of(plant),
        "controller_name": name_of(controller),
        "measured": [(inputs[name], outputs[name]) for name in inputs if name in outputs],
        "wanted": [inputs[name] for name in names],
        "driven": [(drives[name], commands[name]) for name in drives if name in commands],
        "provenance": provenance,
    }
    for file in ("build.m", "closed_loop.m", "README.md"):
        files[file] = environment.get_template(f"mex_{file}.j2").render(facts)
    columns = np.column_stack([reference[name] for name in names])
    files["reference.csv"] = "".join(",".join(map(repr, row)) + "\n" for row in columns.tolist())
    return files


def _positions(variables: tuple[Variable, ...]) -> dict[str, int]:
    """Name → position, counted from one."""
    return {variable.name: position for position, variable in enumerate(variables, start=1)}
