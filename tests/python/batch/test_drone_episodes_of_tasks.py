"""Episodes of several drones in an env: tasks in Python, errors, and learning, also in closed form."""

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from messages import refused
from test_drone_episodes import E, M, N, Walk, actions_of, envs

import flockstep
from flockstep.sb3 import make_vec


def test_a_task_declares_its_episodes() -> None:
    class Each(Walk):
        episodes = "each"

    env = envs(task=Each, autoreset_mode="same_step")
    assert env.recipe.episode.episodes == "each"
    starts = set()
    env.reset(seed=0)
    for action in actions_of(env, 100):
        _, _, terminated, truncated, infos = env.step(action)
        ended = terminated | truncated
        if ended.any():
            np.testing.assert_array_equal(env.batch.steps == 0, ended)
            way = infos["final_info"]["way"][ended]
            assert ((way > 1) == terminated[ended]).all()
            starts |= {tuple(row) for row in env.task.start[ended]}
    assert len(starts) > 2 * N
    assert flockstep.DroneVectorEnv(2, drones_per_env=2, task=Each, episodes="team").recipe.episode.episodes == "team"


def test_draws_of_a_drone() -> None:
    env = envs(episodes="each")
    env.reset(seed=9)
    batch = env.batch
    drones = batch.random(4, 6, row_kind="drone")
    assert drones.shape == (N, 6) and len(np.unique(drones)) == drones.size
    np.testing.assert_array_equal(drones[::M], batch.random(4, 6))
    np.testing.assert_array_equal(batch.random(4, 6, [5, 1], "drone"), drones[[5, 1]])
    env.reset(options={"reset_mask": np.arange(N) == 5})
    changed = (batch.random(4, 6, row_kind="drone") != drones).all(axis=1)
    assert np.flatnonzero(changed).tolist() == [5]
    np.testing.assert_array_equal(batch.random(4, 6), drones[::M])


class Together(Walk):
    row_kind = "env"


class Repeats(Walk):
    def reset(self, batch: flockstep.Batch, mask: Any) -> None:
        batch.random(0, 3)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda _: envs(episodes="all"), ["episodes", "all"]),
        (lambda _: envs(task=Together, episodes="each"), ["episodes", "team", "each"]),
        (lambda _: envs(task=Together, episodes="last"), ["episodes", "team", "last"]),
        (lambda _: envs(task=Repeats, episodes="each").reset(seed=0), ["row_kind", "drone", "each"]),
        (lambda env: env.reset(options={"reset_mask": np.arange(N) == 1}), ["options['reset_mask']", M, "env 0"]),
        (lambda env: env.batch.reset(mask=np.ones(N, bool)), ["mask", (E,)]),
        (lambda env: env.batch.random(0, 1, row_kind="row"), ["row_kind", "row"]),
    ],
)
def test_errors(call: Any, said: list[Any]) -> None:
    env = envs()
    env.reset(seed=0)
    with refused(ValueError, *said):
        call(env)
    assert flockstep.DroneVectorEnv(2, task=Together, episodes="last").num_envs == 2
    envs(task=Repeats, episodes="last").reset(seed=0)


# ------------------------------------------------------------------------------------------------ trainers


@pytest.mark.parametrize("normalizes", [False, True])
@pytest.mark.parametrize("episodes", ["each", "last"])
def test_ppo_learns_the_same_within_the_engine_and_outside(mode: str, episodes: str, normalizes: bool) -> None:
    class Outside(flockstep.DroneVectorEnv):
        def step(self, actions: Any) -> Any:
            return super().step(actions)

    models = []
    for kind in (flockstep.DroneVectorEnv, Outside):
        env = kind(
            16, drones_per_env=M, episodes=episodes, autoreset_mode=mode, random_start=True, max_episode_steps=30
        )
        settings: dict[str, Any] = {"normalize_observations": normalizes, "normalize_rewards": normalizes}
        model = flockstep.PPO("MlpPolicy", env, n_steps=70, batch_size=64, n_epochs=1, seed=0, **settings)
        models.append(model.learn(2 * 70 * env.num_envs))
    first, second = models
    np.testing.assert_array_equal(first.learner.parameters, second.learner.parameters)
    np.testing.assert_equal(first.learner.observation_moments, second.learner.observation_moments)
    ends = [[(end["r"], end["l"]) for end in model.ep_info_buffer] for model in models]
    assert ends[0] == ends[1] and len(set(ends[0])) > 20


class Counted(flockstep.Task):
    """Drone m of an env flies 3 m + 3 steps with reward 1."""

    observation_space = gymnasium.spaces.Box(-1, 1, (2,), np.float32)
    worlds = "playground/train-1"

    def act(self, batch: flockstep.Batch, actions: Any) -> Any:
        return batch.position

    def step(self, batch: flockstep.Batch) -> Any:
        return np.ones(batch.num_drones), self.steps >= 3 * (np.arange(batch.num_drones) % M + 1)

    def observe(self, batch: flockstep.Batch) -> Any:
        return np.column_stack([self.steps / 10, np.ones(batch.num_drones)]).astype(np.float32)


def steps_flown(mode: str, episodes: str) -> Iterator[tuple[Any, int]]:
    """Yield the number of each of 36 steps in the episode of a member of an env, and how many of them it flies."""
    waits = 1 if mode == "next_step" else 0
    for length in 3 * np.arange(1, M + 1):
        yield np.arange(36) % (length + waits if episodes == "each" else 3 * M + waits), length


@pytest.mark.parametrize("episodes", ["each", "last"])
def test_ppo_learns_from_flown_steps_only(mode: str, episodes: str) -> None:
    """The steps that count, by the steps since the env's reset, in closed form."""
    env = envs(2, task=Counted, episodes=episodes, autoreset_mode=mode)
    model = flockstep.PPO("MlpPolicy", env, n_steps=36, batch_size=36, n_epochs=1, gamma=1.0, gae_lambda=1.0, seed=0)
    counted = []

    class Spy:
        def __init__(self, learner: Any) -> None:
            self.learner = learner

        def __getattr__(self, name: str) -> Any:
            return getattr(self.learner, name)

        def record(self, t: int, *arguments: Any) -> None:
            counted.append(~arguments[4])
            self.learner.record(t, *arguments)

    model.learner = Spy(model.learner)
    model.learn(36 * env.num_envs)
    flown = np.stack(counted)
    for member, (step, length) in enumerate(steps_flown(mode, episodes)):
        expected = step < length
        np.testing.assert_array_equal(flown[:, member], expected)
        np.testing.assert_array_equal(flown[:, M + member], expected)
    assert {info["r"] for info in model.ep_info_buffer} == {3, 6, 9}
    assert {info["l"] for info in model.ep_info_buffer} == {3, 6, 9}


def expected_moments(observations: Any) -> tuple[Any, Any, float]:
    """Return mean, variance and weight of all numbers, beside variance 1 around 0 with the weight 1e-4."""
    weight = len(observations) + 1e-4
    mean = observations.sum(axis=0) / weight
    return mean, (((observations - mean) ** 2).sum(axis=0) + 1e-4 * (1 + mean**2)) / weight, weight


@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize("episodes", ["each", "last"])
def test_ppo_normalises_by_the_observations_that_were_flown_from(mode: str, episodes: str, wrapped: bool) -> None:
    """In closed form. Wrapped: by Gymnasium, or as a VecEnv of Stable-Baselines3, which has same-step autoreset."""
    env: Any = envs(2, task=Counted, episodes=episodes, autoreset_mode=mode)
    if wrapped:
        env = make_vec(env) if mode == "same_step" else gymnasium.wrappers.vector.RecordEpisodeStatistics(env)
    model = flockstep.PPO("MlpPolicy", env, n_steps=36, batch_size=36, n_epochs=1, seed=0, normalize_observations=True)
    model.learn(36 * 2 * M)
    observations = []
    for step, length in steps_flown(mode, episodes):
        observations += 2 * [[number / 10, 1] for number in step[step < length]]
    for got, expected in zip(
        model.learner.observation_moments, expected_moments(np.float32(observations).astype(float)), strict=True
    ):
        np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("episodes", ["each", "last"])
def test_the_engine_normalises_by_the_observations_that_were_flown_from(
    mode: str, episodes: str, closet: flockstep.World
) -> None:
    """The observations of a task in C++, kept by another env with the same actions."""
    keywords: dict[str, Any] = {"episodes": episodes, "autoreset_mode": mode, "worlds": closet}
    env, other = (envs(4, **keywords) for _ in range(2))
    model = flockstep.PPO("MlpPolicy", env, n_steps=60, batch_size=60, n_epochs=1, seed=0, normalize_observations=True)
    model.learn(60 * env.num_envs)
    observation, _ = other.reset(seed=0)  # the learner's seed
    flown = []
    for actions in model.learner.actions.astype(int):
        before = observation
        observation, _, terminated, truncated, _ = other.step(actions)
        flown.append(before[other.batch.flying])
        if mode == "disabled" and (terminated | truncated).any():
            observation, _ = other.reset(options={"reset_mask": terminated | truncated})
    waits = 60 * env.num_envs - sum(map(len, flown))
    assert waits > 10 if episodes == "last" or mode == "next_step" else waits == 0
    expected = expected_moments(np.concatenate(flown).astype(float))
    for got, number in zip(model.learner.observation_moments, expected, strict=True):
        np.testing.assert_allclose(got, number, rtol=1e-9, atol=1e-12)


def test_stable_baselines3_gets_each_end_once() -> None:
    for episodes in ("each", "last"):
        vec = make_vec(Counted, num_envs=2, drones_per_env=M, episodes=episodes)
        first = np.array(vec.reset())
        absent = np.zeros(2, np.float32)
        for t in range(36):
            observation, reward, done, infos = vec.step(np.zeros((2 * M, 3), np.float32))
            for row in range(2 * M):
                length = 3 * (row % M + 1)
                flown = t % (length if episodes == "each" else 3 * M)
                assert reward[row] == (flown < length)
                assert done[row] == (flown == length - 1)
                if done[row]:
                    assert infos[row]["episode"]["r"] == infos[row]["episode"]["l"] == length
                    np.testing.assert_allclose(infos[row]["terminal_observation"], [length / 10, 1])
                else:
                    assert infos[row] == ({"finished": True} if flown >= length else {})
                rests_next = episodes == "last" and length - 1 <= flown < 3 * M - 1
                begins = (flown + 1) % (length if episodes == "each" else 3 * M) == 0
                expected = absent if rests_next else first[row] if begins else np.array([(flown + 1) / 10, 1])
                np.testing.assert_allclose(observation[row], expected, atol=1e-6)
