"""Many rollouts in one call, in vector lanes and on all cores, and their derivatives."""
