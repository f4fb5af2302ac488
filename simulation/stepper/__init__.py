"""Experiments step by step: the plant, its ropes and its sensors move on under commands from outside."""
