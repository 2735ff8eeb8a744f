"""One env of several drones as a PettingZoo ParallelEnv, against PettingZoo's own tests and the vector env."""

import builtins
import pickle
import sys
import warnings
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from messages import refused
from pettingzoo.test import parallel_api_test, parallel_seed_test, render_test
from pettingzoo.utils import parallel_to_aec
from simple_tasks import Still

import flockstep
from flockstep.viewer.page import is_built

M = 3
ENVS: dict[str, dict[str, Any]] = {
    "navigation": {"max_episode_steps": 60, "random_start": True, "worlds": "playground/train-1"},
    "hover": {"task": flockstep.HoverConfig(), "max_episode_steps": 60},
    "pixels": {"task": "flockstep/CameraPixels-v0", "max_episode_steps": 20},
}


def make(kind: str = "navigation", **keywords: Any) -> Any:
    return flockstep.parallel_env(num_drones=M, **{**ENVS[kind], **keywords})


def sampled(env: Any) -> dict[str, Any]:
    return {agent: env.action_space(agent).sample() for agent in env.agents}


@pytest.mark.parametrize("kind", ENVS)
def test_pettingzoos_tests_pass(kind: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # its test warns of what it only suspects
        parallel_api_test(make(kind), num_cycles=200)
        parallel_seed_test(lambda: make(kind), num_cycles=60)


@pytest.mark.skipif(not is_built(), reason="no page: this build had no Node.js")
def test_pettingzoos_render_test_passes() -> None:
    render_test(lambda render_mode: parallel_to_aec(make(render_mode=render_mode)))


def test_seed_s_is_env_s_of_the_batch() -> None:
    envs = flockstep.DroneVectorEnv(
        4, drones_per_env=M, episodes="last", autoreset_mode="disabled", **ENVS["navigation"]
    )
    expected, _ = envs.reset(seed=0)
    actions = np.repeat(np.random.default_rng(0).integers(6, size=(4, 4 * M)), 15, axis=0)  # long ways, to the walls
    singles = [make() for _ in range(4)]
    for seed, env in enumerate(singles):
        observations, infos = env.reset(seed=seed)
        assert env.agents == ["drone_0", "drone_1", "drone_2"]
        assert infos == {agent: {} for agent in env.agents}
        for row, agent in enumerate(env.agents):
            np.testing.assert_array_equal(observations[agent], expected[seed * M + row])
    rests = 0
    for action in actions:
        observation, reward, terminated, truncated, infos = envs.step(action)
        for seed, env in enumerate(singles):
            agents = list(env.agents)
            if not agents:
                continue
            rows = {agent: seed * M + int(agent[-1]) for agent in agents}
            results = env.step({agent: action[row] for agent, row in rows.items()})
            assert all(result.keys() == rows.keys() for result in results)
            for agent, row in rows.items():
                np.testing.assert_array_equal(results[0][agent], observation[row])
                for got, wanted in zip(results[1:4], (reward, terminated, truncated), strict=True):
                    assert got[agent] == wanted[row] and type(got[agent]) in (float, bool)
                ended = terminated[row] or truncated[row]
                assert (agent in env.agents) != ended
                assert bool(results[4][agent]) == ended
                if ended:
                    assert results[4][agent]["episode_return"] == infos["episode_return"][row]
                    assert results[4][agent]["episode_end"] == infos["episode_end"][row]
            rests += len(agents) < M
    assert rests > 20 and not any(env.agents for env in singles)
    assert singles[0].step({}) == ({}, {}, {}, {}, {})
    with refused(ValueError, "actions", "reset", "drone_1"):
        singles[0].step({"drone_1": 0})
    singles[1].reset()
    assert singles[1].batch.episode.tolist() == [1] and len(singles[1].agents) == M


def test_wrong_actions_change_nothing() -> None:
    env = make(max_episode_steps=0)
    with pytest.raises(ResetNeeded):
        env.step({})
    env.reset(seed=1)
    actions = {"drone_0": 5, "drone_1": 0, "drone_2": 0}  # the first one flies to the ground
    step = 0
    while "drone_0" in env.agents:
        env.step({**actions, "drone_1": step % 2, "drone_2": step % 2})
        step += 1
    before = env.envs.snapshot()
    good = {"drone_1": 0, "drone_2": 1}
    for wrong, *said in (
        ({"drone_1": 0}, "actions", "none for 'drone_2'"),
        ({}, "actions", "none for 'drone_1'"),
        ({**good, "drone_0": 0}, "actions", "'drone_0', whose episode has ended"),
        ({**good, "drone_7": 0}, "actions", "'drone_7', which is not an agent"),
        *(({**good, "drone_1": bad}, "actions['drone_1']", "Discrete(6)", bad) for bad in (6, 0.5, [1, 2])),
    ):
        with refused(ValueError, *said):
            env.step(wrong)
    with refused(TypeError, "actions", "list"):
        env.step([0, 1])
    assert env.envs.snapshot() == before and env.agents == ["drone_1", "drone_2"]
    env.step(good)
    hover = make("hover")
    hover.reset(seed=0)
    for value, said in ((np.full(4, np.nan), "finite numbers"), (np.zeros(3), "Box"), ("up", "Box")):
        with refused(ValueError, "actions['drone_1']", said):
            hover.step({**sampled(hover), "drone_1": value})


def test_state_and_picture() -> None:
    env = make(render_mode="rgb_array", render_size=(80, 60))
    with pytest.raises(ResetNeeded):
        env.state()
    observations, _ = env.reset(seed=2)
    np.testing.assert_array_equal(env.state(), np.concatenate(list(observations.values())))
    assert env.state() in env.state_space and env.state_space.shape == (M * 38,)
    assert env.render().shape == (60, 80, 3)
    last = dict(observations)
    while env.agents:
        last |= env.step(sampled(env))[0]
        np.testing.assert_array_equal(env.state(), np.concatenate([last[agent] for agent in env.possible_agents]))
    assert env.render().shape == (60, 80, 3)
    with refused(UserWarning, "render() returns None"):
        assert make().render() is None
    pixels = make("pixels")
    pixels.reset(seed=0)
    assert pixels.state() in pixels.state_space
    env.close()
    env.close()


def test_copies_continue() -> None:
    env = make()
    env.reset(seed=4)
    for _ in range(20):
        env.step(sampled(env))
    copy = pickle.loads(pickle.dumps(env))
    assert copy.agents == env.agents
    while env.agents:
        actions = sampled(env)
        np.testing.assert_equal(env.step(actions), copy.step(actions))


def test_your_own_task() -> None:
    class Walk(Still):
        worlds = "playground/train-1"
        info_names = ("way",)

        def step(self, batch: flockstep.Batch) -> Any:
            self.info["way"] = self.steps.astype(float)
            return batch.position[:, 0], self.steps == 2 + np.arange(batch.num_drones)

    env = flockstep.parallel_env(Walk, num_drones=2)
    env.reset(seed=0)
    lengths = {}
    while env.agents:
        *_, infos = env.step(sampled(env))
        lengths |= {agent: info["way"] for agent, info in infos.items() if info}
    assert lengths == {"drone_0": 2, "drone_1": 3}


def test_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in (("num_envs", 2), ("episodes", "each"), ("copy", False)):
        with refused(TypeError, "parallel_env", name):
            make(**{name: value})
    with refused(ValueError, "num_drones", 0):
        flockstep.parallel_env(num_drones=0)
    with refused(ValueError, "render_mode", "window"):
        make(render_mode="window")
    with refused(TypeError, "unexpected keyword argument 'drones'"):
        make(drones=2)
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("pettingzoo"):
            raise ImportError("No module named 'pettingzoo'", name="pettingzoo")
        return real(name, *args, **kwargs)

    monkeypatch.delitem(sys.modules, "flockstep.multi_agent")
    monkeypatch.setattr(builtins, "__import__", without)
    with refused(ImportError, "pip install 'flockstep[pettingzoo]'"):
        _ = flockstep.parallel_env


def test_wrappers_have_random_numbers() -> None:
    """As SuperSuit's frame_skip_v0 needs them."""
    env = make()
    drawn = []
    for seed in (3, 3, 4):
        env.reset(seed=seed)
        drawn.append(int(env.unwrapped.np_random.integers(0, 1 << 30)))
    assert drawn[0] == drawn[1] != drawn[2]
