"""Tuning of gains: search space, objectives and constraints over an ensemble, optimisers, studies and their storage."""
