"""A race: laws that all are tuned with the same number of rollouts, and scored in one test set."""
