"""Case 4 written by hand in plain Python: what Numba compiles and what SciPy's solvers call.

The same scalar algorithm as ``hand_loop.c``, with every number taken at run time. What Case 4 leaves switched
off (sensor errors, current, winch friction, speed filter, derivative gains, delay) is not in here.
"""
