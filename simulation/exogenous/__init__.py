"""Exogenous signals of a run: reference, disturbances and sensor noise."""
