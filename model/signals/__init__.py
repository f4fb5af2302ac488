"""Given signals: numbers over the time, from files or arrays, in named units."""
