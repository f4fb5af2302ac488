"""Figures of merit: the built-in ones and users' own, summed up sample by sample by the code that simulates."""
