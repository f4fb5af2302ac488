"""Quantities: what numbers are, the groups and parts they stand in, and how these are taken apart and checked."""
