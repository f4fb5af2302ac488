"""Whole rollouts in compiled C: a generated step and a driver loop in one translation unit."""
