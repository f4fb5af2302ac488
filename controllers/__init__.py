"""Control laws, one per file: pure symbolic updates ``(state, measurement, reference, gains) -> (state, output)``."""
