"""The machine as a moving picture: one SVG with what a run did, and a still one with names and signs."""

from dualwinch.simulation.animation.animation import animation, save_animation
from dualwinch.simulation.animation.machine import labelled_machine

__all__ = ["animation", "labelled_machine", "save_animation"]
