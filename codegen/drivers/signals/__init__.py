"""Signals that a run receives from outside: given, or drawn sample by sample to the same bits everywhere."""
