"""Motions that a reference can ask for: S-curves, way-points, recorded ones."""
