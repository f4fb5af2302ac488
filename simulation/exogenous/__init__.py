"""Exogenous signals of a run: reference, disturbances and noises of the sensors."""
