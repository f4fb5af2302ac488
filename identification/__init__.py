"""Estimate a machine's parameters from logs by maximum likelihood of the innovations of an extended Kalman filter.

This is the prediction-error method, with the innovations as the errors; and the design of the runs whose logs determine
the parameters best. Files in the order in which data go through them: `log`, `resample`, `predictor`, `filter`,
`unknowns`, `likelihood`, `estimate`, `diagnostics`, `smoother`, `result`, `identify`, with `options` for all of them;
`vortices` and `model_choice` compare models; `experiment_design` designs experiments.
"""
