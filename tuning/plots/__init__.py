"""Figures of a study: the search, and what its best is worth."""
