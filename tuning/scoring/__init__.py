"""What a candidate is worth: scenarios, evaluation, statistics, ranking and the final choice."""
