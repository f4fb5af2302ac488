"""The sampled closed loop: plant and controller as one symbolic step, its rows, figures of merit and blocks."""
