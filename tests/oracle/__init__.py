"""A second, independent implementation of the system in plain Python, NumPy and SciPy.

It shares no line with the product and integrates the plant with stiff implicit methods. The tests compare both.
"""
