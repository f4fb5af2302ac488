"""The variables of a block as members of C structures."""

import re
from collections.abc import Mapping

from dualwinch.codegen.block import Variable
from dualwinch.codegen.source.statements import Element, of_array


def member(variable: Variable) -> str:
    """Name of a variable as a member of a C structure."""
    return re.sub(r"\W", "_", variable.name)


def of_structures(
    vectors: Mapping[str, tuple[str, tuple[Variable, ...]]], arrays: Mapping[str, str] | None = None
) -> Element:
    """Where elements stand that are members of structures.

    Args:
        vectors: name of an argument or result → what its members stand behind (e.g. ``state->``), and the variables;
            of others they are elements of arrays.
        arrays: name of an argument or result → the array, where it has another name.
    """
    named = arrays or {}
    members = {name: [before + member(variable) for variable in held] for name, (before, held) in vectors.items()}

    def element(name: str, index: int) -> str:
        return members[name][index] if name in members else of_array(named.get(name, name), index)

    return element
