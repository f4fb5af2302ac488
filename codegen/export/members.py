"""The variables of a block as members of C structures."""

import re
from collections.abc import Mapping

from dualwinch.codegen.block import Variable
from dualwinch.codegen.source.statements import Element, of_array


def member(variable: Variable) -> str:
    """Name of a variable as a member of a C structure."""
    return re.sub(r"\W", "_", variable.name)


def of_structures(vectors: Mapping[str, tuple[str, tuple[Variable, ...]]]) -> Element:
    """Where elements stand that are members of structures.

    Args:
        vectors: name of an argument or result → what its members stand behind (e.g. ``state->``), and the variables;
            of others they are arrays.
    """
    members = {name: [before + member(variable) for variable in held] for name, (before, held) in vectors.items()}

    def element(name: str, index: int) -> str:
        return members[name][index] if name in members else of_array(name, index)

    return element
