"""The commands `lab` and `show`."""
