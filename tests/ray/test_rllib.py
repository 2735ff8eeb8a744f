"""`flockstep.rllib` and `training.sweep` on a cluster of two nodes of this machine; `./dev test ray` runs them."""

import csv
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import ray
import torch
from conftest import CPUS, wait_until
from messages import refused
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis import ValueFunctionAPI
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.core.rl_module.torch import TorchRLModule
from ray.rllib.env.single_agent_env_runner import SingleAgentEnvRunner

import flockstep
from engines import TRAINED
from flockstep import rllib

ROOT = Path(__file__).resolve().parents[2]
ID = "flockstep/LidarNavigation-v0"
SEED, ENVS, LIMIT = 70, 8, 12

# RLlib registers its environment again for every runner.
pytestmark = [pytest.mark.filterwarnings("ignore:.*Overriding environment:UserWarning")]

ray.cloudpickle.register_pickle_by_value(sys.modules[__name__])  # workers cannot import this file


class Straight(TorchRLModule, ValueFunctionAPI):
    """Flies straight to the goal, by comparisons only: the same actions in batches of any size."""

    def setup(self):
        self.unused = torch.nn.Parameter(torch.zeros(1))

    def _forward(self, batch, **_):
        direction = batch[Columns.OBS][:, :3]
        scores = torch.stack([direction, -direction], dim=2).flatten(1)  # of the actions +x -x +y -y +z -z
        return {Columns.ACTION_DIST_INPUTS: scores}

    def compute_values(self, batch, embeddings=None):
        return self.unused * torch.ones(len(batch[Columns.OBS]))


def configured(runners, envs=ENVS, **settings):
    settings = {"random_world": True, "random_start": True, "max_episode_steps": LIMIT, **settings}
    config = rllib.configure(PPOConfig(), ID, num_envs=envs // max(runners, 1), seed=SEED, **settings)
    config.training(train_batch_size_per_learner=256, minibatch_size=128, num_epochs=1)
    return config.env_runners(num_env_runners=runners)


def key_of(observation, action, reward):
    return b"".join(np.ascontiguousarray(part).tobytes() for part in (observation, action, reward))


def expected_episodes(steps):
    """Fly the same envs without Ray; return the episodes of each env, in order."""
    envs = flockstep.DroneVectorEnv(ENVS, random_world=True, random_start=True, max_episode_steps=LIMIT)
    module = Straight(observation_space=envs.single_observation_space, action_space=envs.single_action_space)
    episodes = [[] for _ in range(ENVS)]
    observation, _ = envs.reset(seed=SEED)
    rows = [([observation[i]], [], []) for i in range(ENVS)]
    begins = np.zeros(ENVS, bool)
    for _ in range(steps):
        batch = {Columns.OBS: torch.from_numpy(observation)}
        action = module._forward(batch)[Columns.ACTION_DIST_INPUTS].argmax(1).numpy()
        observation, reward, terminated, truncated, _ = envs.step(action)
        ended = terminated | truncated
        for i, (seen, done, earned) in enumerate(rows):
            seen.append(observation[i])
            if begins[i]:
                del seen[:-1], done[:], earned[:]
                continue
            done.append(action[i])
            earned.append(np.float32(reward[i]))
            if ended[i]:
                episodes[i].append(key_of(np.stack(seen), np.stack(done), np.stack(earned)))
        begins = ended
    return episodes


def sampled_episodes(runner):
    samples = runner.sample(num_timesteps=4 * LIMIT * runner.num_envs, explore=False)
    return [
        key_of(
            np.asarray(each.get_observations(), np.float32),
            np.asarray(each.get_actions(), np.int64),
            np.asarray(each.get_rewards(), np.float32),
        )
        for each in samples
        if each.is_done
    ]


@pytest.mark.parametrize("runners", [1, 2, 4])
def test_runners_fly_the_episodes_of_one_vector_env(address, runners):
    config = configured(runners).rl_module(rl_module_spec=RLModuleSpec(module_class=Straight))
    algorithm = config.build_algo()
    group = algorithm.env_runner_group
    flown = group.foreach_env_runner(sampled_episodes, local_env_runner=False)
    threads = group.foreach_env_runner(lambda each: each.env.unwrapped.batch.num_threads, local_env_runner=False)
    algorithm.stop()
    expected = expected_episodes(8 * LIMIT)
    assert len(flown) == runners
    together = [each for part in flown for each in part]
    assert len(set(together)) == len(together), "none was flown twice"
    assert set(together) <= {each for episodes in expected for each in episodes}
    assert {each for episodes in expected for each in episodes[:2]} <= set(together)
    assert threads == [1] * runners


def test_training_goes_on_when_a_runner_is_killed(address):
    algorithm = configured(2, envs=32).env_runners(num_cpus_per_env_runner=CPUS).build_algo()
    group = algorithm.env_runner_group

    def of_each(call):
        return group.foreach_env_runner(call, local_env_runner=False)

    first = algorithm.train()
    before, weights = of_each(lambda _: os.getpid()), weights_of(algorithm)
    threads = of_each(lambda each: each.env.unwrapped.batch.num_threads)
    nodes = of_each(lambda _: ray.get_runtime_context().get_node_id())
    assert threads == [CPUS] * 2, "those that Ray grants"
    assert len(set(nodes)) == 2, "one on either node"
    os.kill(before[1], signal.SIGKILL)
    steps = []
    until = time.monotonic() + 90
    while not (steps and group.num_healthy_remote_workers() == 2) and time.monotonic() < until:
        steps.append(algorithm.train()["env_runners"]["num_env_steps_sampled_lifetime"])
    steps.append(algorithm.train()["env_runners"]["num_env_steps_sampled_lifetime"])
    after = of_each(lambda _: os.getpid())
    firsts = of_each(lambda each: each.env.env.first_seed)
    changed = weights_of(algorithm)
    algorithm.stop()
    assert first["env_runners"]["num_env_steps_sampled_lifetime"] < steps[0]
    assert steps == sorted(steps)
    assert len(after) == 2 and after[0] == before[0] and after[1] != before[1]
    assert firsts == [SEED, SEED + 16], "a restarted runner keeps its seeds"
    assert all(np.isfinite(each).all() for each in changed)
    assert any((a != b).any() for a, b in zip(weights, changed, strict=True))


def weights_of(algorithm):
    state = algorithm.get_module().get_state()
    return [np.array(state[key]) for key in sorted(state)]


def first_seed(config, worker, kind=rllib.DroneEnvRunner):
    """Return the seed of env 0 after the reset by which a runner begins."""
    runner = kind(config=config, worker_index=worker, num_workers=config.num_env_runners)
    runner.sample(num_timesteps=1, random_actions=True)
    seed = runner.env.unwrapped.np_random_seed
    runner.stop()
    return seed


def test_seeds_are_spaced_by_the_envs_of_a_runner(address):
    config = configured(4)  # two envs each
    assert [first_seed(config, worker) for worker in (1, 2, 3, 4)] == [SEED, SEED + 2, SEED + 4, SEED + 6]
    assert first_seed(configured(0), 0) == SEED, "without runners the main process flies"
    config.debugging(seed=100)
    config.env_runners(num_envs_per_env_runner=3)
    assert [first_seed(config, worker) for worker in (1, 2, 3)] == [100, 103, 106], "those that count are the latest"
    evaluation = config.copy(copy_frozen=False)
    evaluation.in_evaluation = True
    assert [first_seed(evaluation, worker) for worker in (1, 2)] == [(1 << 30) + 100, (1 << 30) + 103]
    config.debugging(seed=None)
    assert first_seed(config, 1) != first_seed(config, 1), "drawn"


def test_another_runner_class_is_refused(address):
    config = configured(2).env_runners(env_runner_cls=SingleAgentEnvRunner)
    with refused(RuntimeError, "env_runner_cls"):
        first_seed(config, 1, SingleAgentEnvRunner)


def test_other_envs_are_refused(address):
    config = configured(2)
    config.env_config = {}  # environment() would add to the keywords of configure
    config.environment(ID)
    with refused(TypeError, "env", "DroneVectorEnv"):
        first_seed(config, 1)


def test_a_single_env_of_rllib_is_refused():
    with refused(ValueError, "gym_env_vectorize_mode"):
        rllib.DroneEnvs({"env": ID})


@pytest.mark.parametrize(
    ("keywords", "error", "message"),
    [
        ({"num_envs": 0}, ValueError, "num_envs: expected an integer >= 1, got 0"),
        ({"num_envs": "8"}, ValueError, "num_envs: expected an integer >= 1, got '8'"),
        ({"seed": -1}, ValueError, "seed: expected an integer >= 0, got -1"),
        ({"max_episode_stepz": 3}, TypeError, "Did you mean 'max_episode_steps'"),
        ({"max_episode_steps": -1}, ValueError, "max_episode_steps: expected .*, got -1"),
        ({"env": "flockstep/Lidar-v9"}, gymnasium.error.NameNotFound, "Lidar"),
        ({"copy": False}, TypeError, "configure: copy cannot be chosen"),
        ({"autoreset_mode": "same_step", "copy": False}, TypeError, "autoreset_mode and copy cannot"),
        ({"drones_per_env": 2}, ValueError, "env: expected one drone in each env, got 2: see flockstep.parallel_env"),
        ({"env": "flockstep/Swap-v0"}, ValueError, "env: expected one drone in each env, got 8"),
    ],
)
def test_settings_that_are_refused(keywords, error, message):
    with pytest.raises(error, match=message):
        rllib.configure(PPOConfig(), **{"env": ID, "num_envs": 4, **keywords})


class Climb(flockstep.Task):
    worlds = "train"
    observation_space = flockstep.DroneVectorEnv(1).single_observation_space

    def step(self, batch):
        return batch.position[:, 2], batch.contact.hit

    def observe(self, batch):
        return np.zeros((batch.num_drones, 38), np.float32)


def test_a_task_instead_of_an_id():
    envs = rllib.DroneEnvs({"env": Climb, "num_envs": 3, "max_episode_steps": 5})
    assert isinstance(envs.unwrapped.task, Climb)
    assert envs.num_envs == 3
    assert pickle.loads(pickle.dumps(Climb)) is Climb
    task = Climb()
    config = rllib.configure(PPOConfig(), task, num_envs=3)
    assert config.env_config["env"] is task
    assert set(vars(task)) == set(vars(Climb())), "the env that checks the settings has a copy"


def test_another_gymnasium_is_refused(monkeypatch):
    rllib._check_gymnasium()
    monkeypatch.setattr(rllib.gymnasium, "__version__", "1.4.0")
    with pytest.raises(ImportError, match=r"needs gymnasium==[\d.]+, got 1.4.0: pip install 'flockstep\[rllib\]'"):
        rllib._check_gymnasium()


def run_program(*arguments):
    return subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=200, check=False
    )


def test_the_example_trains_on_the_cluster(address):
    done = run_program("examples/trainers/rllib_ppo.py", "--address", address, "--runners", "2", "--updates", "1")
    assert done.returncode == 0, done.stderr
    ((version, mode, _, steps, rate),) = TRAINED.findall(done.stdout)
    assert version == f"ray {ray.__version__}"
    assert mode == "next_step"
    assert 64 * 256 <= int(steps.replace(",", "")) < 65 * 256
    assert int(rate.replace(",", "")) > 10


def test_more_runners_than_cpus_are_refused(address):
    done = run_program("examples/trainers/rllib_ppo.py", "--address", address, "--runners", "8")
    assert done.returncode == 1
    assert f"--runners: expected at most {2 * CPUS}, the CPUs of the cluster, got 8" in done.stderr


PAGE = (ROOT / "docs" / "how-to" / "train" / "several-machines.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^<!-- test: ray -->\n```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("block", BLOCKS, ids=["configure", "several agents"])
def test_the_blocks_of_the_page_train_on_the_cluster(block, address, tmp_path):
    (tmp_path / "block.py").write_text(block, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "block.py"],
        cwd=tmp_path,
        env=os.environ | {"RAY_ADDRESS": address},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    returns = [float(line) for line in done.stdout.splitlines()]
    assert len(returns) == 3
    assert np.isfinite(returns).all()


def test_a_sweep_that_was_killed_continues(address, tmp_path):
    command = ["-m", "training.sweep", "hover", "--seeds", "2", "--set", "n_epochs=1,2", "--set", "steps=16384"]
    command += ["--flights", "20", "--out", str(tmp_path), "--address", address]
    results = tmp_path / "hover"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    killed = subprocess.Popen([sys.executable, *command, "--cpus", "2"], cwd=ROOT, **quiet)
    finished = lambda: [path for path in results.glob("*/result.json") if path.stat().st_size]  # noqa: E731
    assert wait_until(finished, 120)
    killed.kill()
    killed.wait()
    kept = {path: path.read_text() for path in finished()}
    assert 1 <= len(kept) < 4, "in the middle"
    other = run_program(*command, "--cpus", "1")
    assert other.returncode == 1
    assert "--out: " in other.stderr and "choose another folder" in other.stderr
    done = run_program(*command, "--cpus", "2")
    assert done.returncode == 0, done.stderr
    assert "with 4 of 4 trainings" in done.stdout
    assert {path: path.read_text() for path in kept} == kept, "not trained again"
    rows = list(csv.DictReader((results / "table.csv").read_text().splitlines()))
    assert [(row["n_epochs"], row["steps"], row["seed"]) for row in rows] == [
        (epochs, "16384", seed) for epochs in "12" for seed in ("100", "101")
    ]
    assert all(0 <= float(row["success"]) <= 1 and float(row["seconds"]) > 0 for row in rows)
    assert (results / "plot.png").stat().st_size > 4000
    assert json.loads((results / "sweep.json").read_text())["settings"] == {"n_epochs": [1, 2], "steps": [16384]}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["hoover"], "NAME: expected one of hover, track"),
        (["hover", "--seeds", "0"], "--seeds: expected at least 1, got 0"),
        (["hover", "--set", "learning_rat=1"], "--set: expected one of steps, num_envs, entropy, learning_rate"),
        (["hover", "--set", "n_epochs=x"], "--set: expected n_epochs=VALUE,VALUE with literals"),
        (["hover", "--set", "n_epochs="], "--set: expected n_epochs=VALUE,VALUE, got"),
        (["hover", "--set", "n_epochs=1", "--set", "n_epochs=2"], "--set: expected n_epochs once"),
    ],
)
def test_a_sweep_refuses_other_names_and_settings(arguments, message, monkeypatch):
    from training import sweep

    monkeypatch.setattr(sweep.ray, "init", lambda *_, **__: pytest.fail("Ray is not needed to see this"))
    with pytest.raises(SystemExit) as stopped:
        sweep.main(sweep.tyro.cli(sweep.Args, args=arguments))
    assert message in str(stopped.value)
