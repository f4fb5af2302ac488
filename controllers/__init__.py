"""Control laws, one a file: pure symbolic updates ``(state, measurement, reference, gains) -> (state, output)``."""
