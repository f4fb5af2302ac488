"""Gymnasium environments for reinforcement learning. Needs the extra ``gymnasium``.

Importing this package registers them:
``gymnasium.make("dualwinch.toolboxes.stepper.environments:dualwinch/Case4-v0")`` imports it.
"""

from dualwinch.toolboxes.stepper.environments.registration import register

register()
