"""A plant that runs by the clock on the wall, for controllers in other processes and on other machines."""
