"""A plant that runs in real time, for controllers in other processes and on other machines."""
