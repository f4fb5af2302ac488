"""Position laws, one per file: from an estimate of the motion and a setpoint to a force."""
