"""Coordinations, one a file: from the position law's force to the torques of both winches."""
