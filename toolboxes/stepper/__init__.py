"""Step experiments sample by sample: plant, ropes and sensors are simulated under external commands."""
