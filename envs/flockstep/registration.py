"""The ids under which Gymnasium knows the environments of this package."""

import gymnasium


def register() -> None:
    """Register the environments with Gymnasium; done by ``import flockstep``.

    No ``max_episode_steps`` here: the engine counts the steps itself, so that the time limit is one keyword for
    `gymnasium.make_vec` and no `TimeLimit` wrapper is needed around a single environment.
    """
    for task, observation in (("LidarNavigation", "goal"), ("CameraNavigation", "blob"), ("CameraPixels", "pixels")):
        if f"flockstep/{task}-v0" not in gymnasium.registry:
            gymnasium.register(
                id=f"flockstep/{task}-v0",
                entry_point="flockstep.env:DroneEnv",
                vector_entry_point="flockstep.vector_env:DroneVectorEnv",
                kwargs={"observation": observation},
            )
