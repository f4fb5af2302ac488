"""Figures of linear models and of analyses."""
