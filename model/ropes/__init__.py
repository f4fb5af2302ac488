"""Ropes: what a rope's law is, the Kelvin–Voigt rope of the paper, and the rail that says how long the ropes are."""
