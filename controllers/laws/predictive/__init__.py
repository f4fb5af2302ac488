"""Model predictive control: prediction, terminal cost, and solution of the quadratic program."""
