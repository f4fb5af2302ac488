"""Environments of Gymnasium: steppers for reinforcement learning. Needs the extra ``gymnasium``.

Its import gives them their names in Gymnasium; ``gymnasium.make("dualwinch.environments:dualwinch/Case4-v0")`` imports
it by itself.
"""

from dualwinch.environments.registration import register

register()
