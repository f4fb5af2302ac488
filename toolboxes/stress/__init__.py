"""Robustness margins: the size of an imperfection of the machine up to which gains satisfy their constraints."""
