"""Peers side by side: one rollout of the paper's Case 4 by every way there is, timed in one run."""
