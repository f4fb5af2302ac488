"""The commands `identify` and `excite`."""
