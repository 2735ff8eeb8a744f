"""A checker for Gymnasium vector environments, which Gymnasium itself does not have.

>>> check_vector_env(lambda n: gymnasium.make_vec("flockstep/LidarNavigation-v0", n, max_episode_steps=20))
"""

from flockstep.testing.checker import CHECKS, check_vector_env

__all__ = ["CHECKS", "check_vector_env"]
