"""Whole rollouts in compiled C: generated functions and a driver loop in one translation unit."""
