"""The programs in examples/trainers/ learn something and use the env correctly."""

import importlib
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
import torch
from conftest import ROOT
from gymnasium import spaces
from messages import refused

import flockstep
from engines import TRAINED
from lidar_task import ID, SETTINGS, GoalFeatures, Options
from processes import drones_of_each, free_port, threads_of_each

FOLDER = ROOT / "examples" / "trainers"

pytestmark = [  # TorchRL warns about its own classes when imported
    pytest.mark.filterwarnings("ignore:Creating .*WeightUpdater which inherits:DeprecationWarning")
]


def test_every_program_is_short():
    programs = sorted(FOLDER.glob("*.py"))
    assert len(programs) == 9
    assert {path.name: lines for path in programs if (lines := len(path.read_text().splitlines())) > 100} == {}


@pytest.mark.parametrize(
    ("name", "package", "options"),
    [
        ("sb3_ppo", "stable-baselines3", {}),
        ("cleanrl_ppo", "torch", {}),
        ("torchrl_ppo", "torchrl", {}),
        ("torchrl_ppo", "torchrl", {"env": "gymenv"}),
        ("skrl_ppo", "skrl", {}),
    ],
    ids=lambda value: value.get("env", "") if isinstance(value, dict) else value,
)
def test_it_learns(name, package, options, monkeypatch, capsys):
    program = importlib.import_module(name)
    if options:
        monkeypatch.setattr(program, "FRAMES", 16 * 8)  # single envs are slow
    make = getattr(program, "TorchRLOptions", Options)
    before = program.main(make(updates=0, **options)).state_dict()
    after = program.main(make(updates=2, **options)).state_dict()
    assert before.keys() == after.keys()
    assert len(before) >= 12
    for key, value in after.items():
        assert value.isfinite().all(), key
        assert not torch.equal(value, before[key]), key
    (version, _, _, untrained, _), (_, mode, _, trained, rate) = TRAINED.findall(capsys.readouterr().out)
    assert version.split()[0] == package
    assert mode == ("none" if options else program.AUTORESET)
    assert untrained == "0"
    assert int(trained.replace(",", "")) > 200
    assert int(rate.replace(",", "")) > 10


@pytest.mark.parametrize("machines", [1, 2])
def test_processes_learn_together(machines, tmp_path):
    """Both end with the same networks, although each learned from other drones."""
    code = (
        "import ddp_ppo, pathlib\n"
        "nets = ddp_ppo.main(ddp_ppo.Options(updates=2))\n"
        "weights = b''.join(each.detach().numpy().tobytes() for each in nets.parameters())\n"
        f"pathlib.Path({str(tmp_path)!r}, str(ddp_ppo.RANK)).write_bytes(weights)\n"
        "ddp_ppo.end_process()\n"
    )
    where = ["--standalone", "--nproc-per-node", "2"]
    if machines == 2:  # two launchers that meet, as on two machines
        meeting = ["--rdzv-backend", "c10d", "--rdzv-endpoint", f"127.0.0.1:{free_port()}"]
        where = ["--nnodes", "2", "--nproc-per-node", "1", *meeting]
    command = [sys.executable, "-m", "torch.distributed.run", *where, "--no-python", sys.executable, "-c", code]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    launchers = [subprocess.Popen(command, cwd=FOLDER, **pipes) for _ in range(machines)]
    try:
        printed = [launcher.communicate(timeout=120) for launcher in launchers]
    finally:
        for launcher in launchers:
            launcher.terminate()  # if another one failed
    assert [launcher.returncode for launcher in launchers] == [0] * machines, printed
    networks = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert networks.keys() == {"0", "1"}
    assert networks["0"] == networks["1"] != b""
    ((version, mode, _, _, rate),) = TRAINED.findall("".join(out for out, _ in printed))
    assert (version.split()[0], mode) == ("torch", "next_step")
    assert int(rate.replace(",", "")) > 10


@pytest.mark.parametrize("collector", ["processes", "distributed"])
def test_workers_collect_for_one_learner(collector):
    command = [sys.executable, "torchrl_collectors.py", "--workers", "2", "--collector", collector, "--updates", "1"]
    done = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    ((version, mode, _, steps, rate),) = TRAINED.findall(done.stdout)
    assert (version.split()[0], mode, steps) == ("torchrl", "disabled", "16,384")
    assert int(rate.replace(",", "")) > 10


@pytest.mark.parametrize(("processes", "threads"), [(1, 4), (2, 2), (3, 1), (8, 1)])
def test_processes_share_the_processors(processes, threads, monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(4), raising=False)
    assert threads_of_each(processes) == threads
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 4)
    assert threads_of_each(processes) == threads


@pytest.mark.parametrize("processes", [-1, 0, 3, 512])
def test_a_number_of_processes_that_does_not_divide_the_drones_is_refused(processes):
    with refused(SystemExit, "processes", 256, processes):
        drones_of_each(processes)


@pytest.mark.parametrize("processes", [2, 4])
def test_processes_fly_the_episodes_of_one(processes, monkeypatch):
    """The drones of all processes together fly what those of a single process fly, with the same actions."""

    def flown(count, rank):
        for name, value in (("RANK", rank), ("WORLD_SIZE", count), ("LOCAL_WORLD_SIZE", count)):
            monkeypatch.setenv(name, str(value))
        program = importlib.reload(importlib.import_module("ddp_ppo"))
        envs, first = program.make_envs(seed=3)
        drones = np.arange(envs.num_envs) + rank * envs.num_envs
        return [first.numpy().copy(), *(envs.step((drones + t // 5) % 6)[0].copy() for t in range(60))]

    monkeypatch.setenv("RANK", "0")
    monkeypatch.setenv("WORLD_SIZE", "1")
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "1")
    apart = [flown(processes, rank) for rank in range(processes)]
    np.testing.assert_array_equal(np.concatenate(apart, axis=1), flown(1, 0))


@pytest.mark.parametrize("workers", [2, 4])
def test_workers_fly_the_episodes_of_one(workers):
    program = importlib.import_module("torchrl_collectors")

    def flown(count, worker):
        env = program.workers(program.CollectorOptions(workers=count, seed=3))[worker]()
        drones = torch.arange(env.batch_size[0]) + worker * env.batch_size[0]
        seen, data = [], env.reset()
        for t in range(60):
            stepped, data = env.step_and_maybe_reset(data.set("action", (drones + t // 5) % 6))
            seen.append(stepped["next", "observation"].clone())
        return torch.stack(seen)

    apart = [flown(workers, worker) for worker in range(workers)]
    assert torch.equal(torch.cat(apart, dim=1), flown(1, 0))


def test_the_features_are_those_of_the_sb3_adapter():
    space = spaces.Box(-1, 1, (38,), np.float32)
    observation = torch.rand(5, 38)
    assert torch.equal(GoalFeatures()(observation), flockstep.sb3.GoalFeatures(space)(observation))


def test_advantages_are_those_of_each_episode_by_itself():
    """Compare with the definition: sums of temporal differences up to the end of the episode."""
    cleanrl = importlib.import_module("cleanrl_ppo")
    steps, envs = 40, 3
    rng = torch.Generator().manual_seed(0)
    reward = torch.randn(steps, envs, generator=rng, dtype=torch.float64)
    value = torch.randn(steps + 1, envs, generator=rng, dtype=torch.float64)
    terminated = torch.rand(steps, envs, generator=rng) < 0.1
    ended = terminated | (torch.rand(steps, envs, generator=rng) < 0.1)
    found = cleanrl.advantages(reward, value, terminated, ended)
    for i in range(envs):
        for t in range(steps):
            expected = 0.0
            for k in range(t, steps):
                after = 0.0 if terminated[k, i] else value[k + 1, i]
                expected += (0.98 * 0.95) ** (k - t) * (reward[k, i] + 0.98 * after - value[k, i])
                if ended[k, i]:
                    break
            assert found[t, i] == pytest.approx(float(expected))


def test_torchrl_sees_whole_episodes():
    """Envs truncated at different steps: the results of each step, and the start of the next one."""
    torchrl = importlib.import_module("torchrl_ppo")
    drones = torchrl.GymWrapper(short(torchrl.AUTORESET), categorical_action_encoding=True)
    data = drones.rollout(60, break_when_any_done=False, auto_reset=False, tensordict=drones.reset(seed=0))
    bare = short("disabled")
    observation, _ = bare.reset(seed=0)
    for t in range(60):
        row = data[:, t]
        np.testing.assert_array_equal(row["observation"], observation)
        observation, reward, terminated, truncated, _ = bare.step(row["action"].numpy())
        np.testing.assert_array_equal(row["next", "observation"], observation)
        np.testing.assert_array_equal(row["next", "reward"][:, 0], reward)
        np.testing.assert_array_equal(row["next", "terminated"][:, 0], terminated)
        np.testing.assert_array_equal(row["next", "truncated"][:, 0], truncated)
        if (terminated | truncated).any():
            observation, _ = bare.reset(options={"reset_mask": terminated | truncated})
    done = data["next", "done"][..., 0]
    assert (done.any(dim=0) & ~done.all(dim=0)).sum() > 10, "some end while others go on"


def test_torchrl_refuses_next_step_autoreset():
    torchrl = importlib.import_module("torchrl_ppo")
    with refused(RuntimeError, "auto-reset mode"):
        torchrl.GymWrapper(short("next_step"))


def test_skrl_bootstraps_from_the_last_observation(monkeypatch):
    skrl = importlib.import_module("skrl_ppo")
    recorded = []
    monkeypatch.setattr(skrl.PPO, "record_transition", lambda self, **transition: recorded.append(transition))
    agent = object.__new__(skrl.FinalObservationPPO)
    envs, last = short(skrl.AUTORESET), short("disabled")
    envs.reset(seed=0)
    last.reset(seed=0)
    envs.action_space.seed(0)
    ends = other = 0
    for _ in range(60):
        actions = envs.action_space.sample()
        returned, _, terminated, truncated, infos = envs.step(actions)
        agent.record_transition(next_observations=torch.from_numpy(returned), infos=infos)
        expected = last.step(actions)[0]
        np.testing.assert_array_equal(recorded[-1]["next_observations"], expected)
        if (ended := terminated | truncated).any():
            ends += ended.sum()
            other += (returned[ended] != expected[ended]).any(axis=1).sum()
            last.reset(options={"reset_mask": ended})
    assert ends > 10
    assert other > 10, "what the env returned is of the next episode"


def short(autoreset_mode):
    """Return envs whose episodes end often, but not all at once."""
    arguments = SETTINGS | {"max_episode_steps": 12, "stagger_first_episode": True}
    return gymnasium.make_vec(ID, 4, autoreset_mode=autoreset_mode, **arguments)
