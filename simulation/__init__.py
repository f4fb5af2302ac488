"""Plant and controller coupled into one compiled closed loop: scenarios, sensors, rollouts, results, figures."""
