"""Model predictive control: what is predicted, what lies beyond the horizon, and how the least cost is found."""
