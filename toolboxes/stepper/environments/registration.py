"""Registration of the environments with Gymnasium."""

from dualwinch.toolbox import errors

ENVIRONMENT_NAMES = {f"dualwinch/Case{number}-v0": f"case-{number}" for number in (1, 2, 3, 4)} | {
    "dualwinch/Sea-v0": "sea"
}
"""Name in Gymnasium → experiment or ensemble."""


def register() -> None:
    """Register the environments that are not yet registered.

    Raises:
        MissingExtraError: Gymnasium is not installed.
    """
    try:
        from gymnasium.envs import registration
    except ImportError:
        raise errors.MissingExtraError("gymnasium", "gymnasium") from None
    for name in ENVIRONMENT_NAMES.keys() - registration.registry.keys():
        registration.register(
            id=name,
            entry_point="dualwinch.toolboxes.stepper.environments.environment:Environment",
            vector_entry_point="dualwinch.toolboxes.stepper.environments.environment:VectorEnvironment",
            kwargs={"experiment": ENVIRONMENT_NAMES[name]},
        )
