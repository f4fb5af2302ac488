"""Quantities of numbers, the groups and parts that hold them, and how these are flattened and checked."""
