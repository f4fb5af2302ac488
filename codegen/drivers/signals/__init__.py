"""Exogenous signals of a run: given, or drawn sample by sample with the same bits on every machine."""
