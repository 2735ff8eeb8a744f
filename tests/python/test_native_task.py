"""A task in C++ from outside the package: built against the headers, registered, made by Gymnasium."""

import os
import shlex
import subprocess
import sysconfig
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import flockstep
from flockstep.testing import check_vector_env

SOURCE = Path(__file__).resolve().parents[1] / "tasks" / "reach_height.cpp"


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The task as a shared library, built as the documents say."""
    path = tmp_path_factory.mktemp("task") / f"reach_height{sysconfig.get_config_var('SHLIB_SUFFIX') or '.so'}"
    compiler = shlex.split(os.environ.get("CXX", "c++"))
    eigen = subprocess.run(["pkg-config", "--cflags", "eigen3"], check=True, capture_output=True, text=True).stdout
    headers = [f"-I{flockstep.include_dir()}", *shlex.split(eigen)]
    command = [*compiler, "-std=c++20", "-O1", "-shared", "-fPIC", *headers, str(SOURCE), "-o", str(path)]
    subprocess.run(command, check=True)
    return path


@pytest.fixture(scope="module")
def env_id(library):
    flockstep.register_task("tests/ReachHeight-v0", library)
    return "tests/ReachHeight-v0"


def test_is_short():
    assert len(SOURCE.read_text().splitlines()) <= 70


HALL = "playground/train-1"  # high enough


def test_what_it_declares_is_its_space(env_id):
    envs = gymnasium.make_vec(env_id, num_envs=3, worlds=HALL)
    assert envs.single_action_space == gymnasium.spaces.Box(-1, 1, (3,), np.float32)
    assert envs.single_observation_space.shape == (2,)
    assert envs.unwrapped.batch.spec.reward_terms == ["closer", "arrived"]


@pytest.mark.parametrize("mode", ["next_step", "same_step", "disabled"])
def test_passes_the_checker(env_id, mode):
    arguments = {"worlds": HALL, "autoreset_mode": mode, "max_episode_steps": 20}
    check_vector_env(lambda n: gymnasium.make_vec(env_id, num_envs=n, **arguments))


def test_climbing_gets_there(env_id):
    envs = gymnasium.make_vec(env_id, num_envs=2, worlds=HALL)
    envs.reset(seed=0)
    for _ in range(100):
        _, reward, terminated, _, infos = envs.step(np.tile(np.float32([0, 0, 1]), (2, 1)))
        np.testing.assert_allclose(envs.unwrapped.batch.reward_terms.sum(axis=1), reward, rtol=1e-6)
        if terminated.any():
            break
    assert terminated.all()
    assert infos["success"].all()


def test_a_snapshot_has_its_state(env_id):
    one, other = (gymnasium.make_vec(env_id, num_envs=4, worlds=HALL).unwrapped for _ in range(2))
    one.reset(seed=0)
    other.reset(seed=9)
    rng = np.random.default_rng(0)
    for _ in range(7):
        one.step(rng.uniform(-1, 1, (4, 3)).astype(np.float32))
    other.restore(one.snapshot())
    for _ in range(20):
        actions = rng.uniform(-1, 1, (4, 3)).astype(np.float32)
        for a, b in zip(one.step(actions)[:4], other.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(a, b)


def test_what_is_no_task_is_refused(tmp_path):
    with pytest.raises(ValueError, match="path: expected a shared library"):
        flockstep.NativeTask(str(tmp_path / "none.so"))
    with pytest.raises(ValueError, match="flockstep_make_task"):
        flockstep.NativeTask(flockstep._core.__file__)


def test_a_library_that_makes_no_task_is_refused(tmp_path):
    source = tmp_path / "none.cpp"
    source.write_text(
        'extern "C" __attribute__((visibility("default"))) void* flockstep_make_task() { return nullptr; }\n'
    )
    library = source.with_suffix(".so")
    compiler = shlex.split(os.environ.get("CXX", "c++"))
    subprocess.run([*compiler, "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    with pytest.raises(ValueError, match="returned no task"):
        flockstep.DroneVectorEnv(1, worlds=HALL, task=flockstep.NativeTask(str(library)))
