"""The engine's tasks beside their twins in NumPy, which get the same actions."""

import numpy as np

import flockstep

#: A pose sensor with every error.
ESTIMATE = flockstep.PoseSensorConfig(
    position_noise_std_m=0.01,
    orientation_noise_std_deg=2.0,
    velocity_noise_std_mps=0.2,
    position_random_walk=0.02,
    drift_std_m=0.05,
    yaw_random_walk=1.0,
)


def both(num_envs, config, twin, **arguments):
    """An env of the engine's task, and one of the same task in NumPy."""
    return (flockstep.DroneVectorEnv(num_envs, task=task, **{"num_threads": 1, **arguments}) for task in (config, twin))


def fly_beside(engine, twin, actions_of, steps, *, atol, begin=5e-6, rewards=None, observed=None):
    """Fly both and compare them; yield after each step what the engine returned, and which rows ended.

    `actions_of` makes the actions of the engine's last observation. `observed` replaces the comparison of observations,
    and leaves that of rewards to the caller. `begin` is the tolerance at the beginning, before the two drift apart.
    """
    rewards = rewards or {"atol": atol}

    def compare(ours, theirs):
        (observed or (lambda a, b: np.testing.assert_allclose(a, b, atol=atol)))(ours, theirs)

    observation, _ = engine.reset(seed=0)
    np.testing.assert_allclose(observation, twin.reset(seed=0)[0], rtol=begin, atol=begin)
    for _ in range(steps):
        actions = actions_of(observation)
        ours, theirs = engine.step(actions), twin.step(actions)
        observation, ended = ours[0], ours[2] | ours[3]
        compare(observation, theirs[0])
        np.testing.assert_array_equal(ours[2], theirs[2])
        np.testing.assert_array_equal(ours[3], theirs[3])
        assert ours[4].keys() == theirs[4].keys()
        np.testing.assert_array_equal(engine.batch.success, twin.batch.success)
        if observed is None:
            np.testing.assert_allclose(ours[1], theirs[1], **rewards)
            np.testing.assert_allclose(engine.batch.reward_terms, twin.batch.reward_terms, **rewards)
        if ended.any():
            infos, expected = (step[4].get("final_info", step[4]) for step in (ours, theirs))
            for key in ("episode_length", "success", "crashed", "bad_state", "episode_end"):
                np.testing.assert_array_equal(infos[key], expected[key])
            for a, b in zip(infos.get("final_obs", []), expected.get("final_obs", []), strict=True):
                assert (a is None) == (b is None)
                if a is not None:
                    compare(a, b)
        yield ours, ended
        if engine.autoreset_mode.value == "Disabled" and ended.any():
            observation, expected = (envs.reset(options={"reset_mask": ended.copy()})[0] for envs in (engine, twin))
            compare(observation, expected)
