"""Primitives of figures: house style, layout of a page, points of lines. The figures stand with their results."""
