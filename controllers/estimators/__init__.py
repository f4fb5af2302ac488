"""Estimators, one per file: from sensor values to the estimated motion for the position law."""
