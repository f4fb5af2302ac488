"""Identification: a machine's parameters from its logs, and the runs that determine them best.

Estimates are those of maximum likelihood of the innovations of an extended Kalman filter (prediction-error method).
Files in the order in which data go through them: `log`, `resample`, `predictor`, `filter`, `noise`, `unknowns`,
`likelihood`, `estimate`, `diagnostics`, `smoother`, `result`, `identify`; `excitation` designs experiments.
"""
