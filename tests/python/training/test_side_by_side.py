"""SideBySide: the rows of several environments, as each of them would return them."""

import numpy as np
from messages import refused

import flockstep
from flockstep.sb3 import DroneVecEnv
from flockstep.sb3.side_by_side import SideBySide


def swaps(envs: int, drones: int, **config: float) -> DroneVecEnv:
    task = flockstep.SwapConfig(**config)
    return DroneVecEnv(flockstep.DroneVectorEnv(envs, task=task, drones_per_env=drones, autoreset_mode="same_step"))


def test_rows_are_those_of_the_environments():
    together, apart = SideBySide([swaps(3, 2), swaps(2, 4)]), [swaps(3, 2), swaps(2, 4)]
    assert together.num_envs == 14
    together.seed(5)
    apart[0].seed(5)
    apart[1].seed(11)
    np.testing.assert_array_equal(together.reset(), np.concatenate([env.reset() for env in apart]))
    rng = np.random.default_rng(0)
    ended = 0
    for _ in range(80):
        actions = rng.uniform((0.5, -0.1), (1.0, 0.1), (14, 2)).astype(np.float32)  # towards the middle
        *arrays, infos = together.step(actions)
        first, second = apart[0].step(actions[:6]), apart[1].step(actions[6:])
        for array, one, other in zip(arrays, first[:3], second[:3], strict=True):
            np.testing.assert_array_equal(array, np.concatenate([one, other]))
        assert [set(info) for info in infos] == [set(info) for info in (*first[3], *second[3])]
        ended += int(arrays[2].sum())
    assert ended > 0
    together.close()


def test_other_spaces_are_refused():
    with refused(ValueError, "envs"):
        SideBySide([swaps(2, 2), swaps(2, 2, neighbors=3)])
