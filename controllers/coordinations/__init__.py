"""Coordinations, one per file: from the position law's force to the torques of both winches."""
