"""Estimate a machine's parameters from logs by maximum likelihood of the innovations of an extended Kalman filter.

This is the prediction-error method, with the innovations as the errors. Files in the order of data flow: `log`,
`resample`, `predictor`, `filter`, `unknowns`, `likelihood`, `estimate`, `diagnostics`, `smoother`, `result`,
`identify`, with `options` for all of them; `models`, `screening`, `alternatives` and `selection` compare models with
the help of `vortices`; `experiment_design` designs runs with the most informative logs.
"""
