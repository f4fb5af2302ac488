"""Estimators, one a file: from sensor values to what the position law takes for the motion."""
