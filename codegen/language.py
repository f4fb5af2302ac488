"""Statements of a CasADi function in C, or in a language of one's own (`Style`)."""

# ruff: noqa: F401

from dualwinch.codegen.drivers.tangents import JacobianProduct, Tangents, jacobian_product
from dualwinch.codegen.source.c_source import LaneLayout, c_source, lane_flags, lane_sizes
from dualwinch.codegen.source.casadi_c import lacking
from dualwinch.codegen.source.expressions import GRAPHS, built_once, instructions
from dualwinch.codegen.source.hoist import hoisted, hoisted_together
from dualwinch.codegen.source.loops import rolled_statements
from dualwinch.codegen.source.operations import PRECISIONS, Precision, Style, literal, name_of
from dualwinch.codegen.source.statements import Element, Strand, statements
