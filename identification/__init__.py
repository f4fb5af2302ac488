"""From a log to a model: numbers of plant and sensors fitted to what a machine's sensors said."""
