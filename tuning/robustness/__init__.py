"""Robustness margins: the size up to which gains satisfy their constraints as an imperfection of a machine grows."""
