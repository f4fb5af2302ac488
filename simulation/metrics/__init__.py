"""Figures of merit, built-in and user-defined, accumulated sample by sample by the simulating code."""
