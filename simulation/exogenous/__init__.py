"""What comes from outside: reference, sea and sensors, drawn ahead of a run."""
