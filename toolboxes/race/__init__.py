"""A benchmark of laws: all tuned with the same number of rollouts, and scored on one test set."""
