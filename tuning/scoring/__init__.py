"""Scoring of candidates: scenarios, evaluation, statistics, ranking and final selection."""
