"""An external task in C++: built against the headers, registered, made by Gymnasium."""

import os
import re
import shlex
import subprocess
import sys
import sysconfig

import gymnasium
import numpy as np
import pytest
from conftest import ROOT
from messages import refused

import flockstep
from flockstep.testing import check_vector_env

SOURCE = ROOT / "tests" / "tasks" / "reach_height.cpp"


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """The task as a shared library, built as documented."""
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
        np.testing.assert_equal(one.step(actions)[:4], other.step(actions)[:4])


def test_other_files_than_libraries_are_refused(tmp_path):
    for given in (tmp_path, str(tmp_path)):
        with refused(ValueError, "path", tmp_path):
            flockstep.NativeTask(given)
    for error in (FileNotFoundError, ValueError):
        with refused(error, "no such shared library", "none.so"):
            flockstep.NativeTask("none.so")
    text = tmp_path / "text.so"
    text.write_text("no library, though as long as the header of one is: " + 64 * ".")
    with refused(ValueError, "path", "ELF"):
        flockstep.NativeTask(text)
    with refused(ValueError, "path", "FLOCKSTEP_EXPORT_TASK", "flockstep_task_version"):
        flockstep.NativeTask(flockstep._core.__file__)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no FIFOs")
def test_a_fifo_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "fifo.so")
    with refused(ValueError, "path", "not a regular file"):
        flockstep.NativeTask(tmp_path / "fifo.so")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="libraries are ELF files on Linux alone")
def test_a_part_of_a_library_is_refused(library, tmp_path):
    """Loading it would crash the process on reading a page beyond the end of the file."""
    whole, part = library.read_bytes(), tmp_path / "part.so"
    lengths = {0, 1, 16, 63, 64, 100, 4095, 4096, len(whole) // 2, len(whole) - 1}
    for length in sorted(lengths | {len(whole) * tenth // 10 for tenth in range(10)}):
        part.write_bytes(whole[:length])
        with refused(ValueError, "path", "truncated" if length >= 64 else "not an ELF file"):
            flockstep.NativeTask(part)
    part.write_bytes(whole)
    assert flockstep.NativeTask(part).path == str(part)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="libraries are ELF files on Linux alone")
def test_offsets_beyond_the_file_are_refused(library, tmp_path):
    part = tmp_path / "part.so"
    for at, size in ((32, 8), (40, 8), (56, 2), (60, 2)):  # in the header, offsets and counts of segments and sections
        damaged = bytearray(library.read_bytes())
        damaged[at : at + size] = b"\xff" * size
        part.write_bytes(damaged)
        with refused(ValueError, "path", "truncated"):
            flockstep.NativeTask(part)


def build(source, text):
    source.write_text(text)
    library = source.with_suffix(".so")
    compiler = shlex.split(os.environ.get("CXX", "c++"))
    subprocess.run([*compiler, "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    return library


EXPORT = 'extern "C" __attribute__((visibility("default"))) '


def test_a_library_for_another_version_is_refused_and_not_loaded(tmp_path):
    loaded = tmp_path / "loaded"
    text = f"""#include <cstdio>
    struct Loaded {{ Loaded() {{ std::fclose(std::fopen("{loaded}", "w")); }} }} loaded;
    {EXPORT} const char flockstep_task_version[] = "flockstep 0.0.9, Eigen aligned to 16 bytes";
    {EXPORT} void* flockstep_make_task() {{ return nullptr; }}"""
    with refused(ValueError, "path", "task format", "flockstep 0.0.9"):
        flockstep.NativeTask(build(tmp_path / "old.cpp", text))
    assert not loaded.exists(), "code of the library has run"


def test_a_library_that_makes_no_task_is_refused(tmp_path, library):
    version = re.search(rb"task format \d+, Eigen alignment \d+", library.read_bytes()).group().decode()
    text = f"""{EXPORT} const char flockstep_task_version[] = "{version}";
    {EXPORT} void* flockstep_make_task() {{ return nullptr; }}"""
    made = build(tmp_path / "none.cpp", text)
    with refused(ValueError, "returned no task"):
        flockstep.DroneVectorEnv(1, worlds=HALL, task=flockstep.NativeTask(made))
