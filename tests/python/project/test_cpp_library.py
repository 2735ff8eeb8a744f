"""The installed C++ library and its CMake package, in a program and a task outside the checkout."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cpp_programs import BUILD, COMPILERS, ROOT, WARNINGS, configure, exported, install, linux_only, run

import flockstep

HEADERS = sorted((ROOT / "engine" / "include" / "flockstep").rglob("*.hpp"))


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An installed flockstep, moved after its installation."""
    return install(tmp_path_factory.mktemp("library"), "library")


@pytest.fixture(scope="module")
def library(prefix: Path) -> Path:
    (path,) = prefix.rglob("libflockstep.so")
    return path


@pytest.fixture(scope="module", params=COMPILERS)
def examples(prefix: Path, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The C++ examples, copied out of the checkout and built against the moved prefix."""
    folder = tmp_path_factory.mktemp("examples")
    for name in ("CMakeLists.txt", "minimal.cpp", "fly_to_goal.cpp"):
        shutil.copy(ROOT / "examples" / name, folder)
    configure(folder, request.param, f"-DCMAKE_PREFIX_PATH={prefix}")
    return folder / "build"


def test_the_minimal_example_is_short() -> None:
    assert len((ROOT / "examples" / "minimal.cpp").read_text().splitlines()) <= 40


def test_a_program_prints_the_ranges_that_python_gets(examples: Path) -> None:
    printed = run(examples / "minimal")
    rows = [[float(number) for number in line.split(":")[1].split()] for line in printed.splitlines()]
    lidar = flockstep.LidarConfig(beams=8, hfov_deg=360, max_range_m=10)
    office = flockstep.World.office(7)
    batch = flockstep.Batch(office, 4, lidar=lidar, task=flockstep.NavigationConfig(action="displacement"))
    batch.reset(np.arange(4, dtype=np.uint64))
    batch.step(np.float32([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]]))
    expected = batch.lidar().ranges.reshape(4, 8)
    assert np.isfinite(expected).any()
    np.testing.assert_allclose(rows, expected, atol=0.0051)  # two decimals


def check_task(library: Path) -> None:
    envs = flockstep.DroneVectorEnv(2, worlds="playground/train-1", task=flockstep.NativeTask(library))
    envs.reset(seed=0)
    _, reward, *_ = envs.step(np.ones((2, 3), np.float32))
    assert envs.batch.spec.reward_terms == ["closer", "arrived", "crashed"]
    assert (reward != 0).all()


def test_a_task_outside_the_tree_flies(examples: Path) -> None:
    check_task(examples / "fly_to_goal.so")


def test_a_task_is_built_with_the_python_package_only(tmp_path: Path) -> None:
    folder = run(sys.executable, "-m", "flockstep", "--cmake-dir", env=os.environ | {"COLUMNS": "20"})
    assert folder == f"{flockstep.cmake_dir()}\n"
    for name in ("CMakeLists.txt", "fly_to_goal.cpp"):
        shutil.copy(ROOT / "examples" / name, tmp_path)
    configure(tmp_path, "g++", f"-Dflockstep_DIR={folder.strip()}")
    check_task(tmp_path / "build" / "fly_to_goal.so")
    assert not (tmp_path / "build" / "minimal").exists()


LOOKS_FOR_THE_LIBRARY = """
cmake_minimum_required(VERSION 3.25)
project(reader LANGUAGES CXX)
find_package(flockstep 0.1 REQUIRED COMPONENTS library)
message(STATUS "scenes: ${flockstep_SCENES_DIR}")
"""


def test_the_package_has_the_folder_of_the_scenes(prefix: Path, tmp_path: Path) -> None:
    (tmp_path / "CMakeLists.txt").write_text(LOOKS_FOR_THE_LIBRARY)
    printed = run("cmake", "-S", tmp_path, "-B", tmp_path / "build", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={prefix}")
    (scenes,) = re.findall(r"scenes: (.*)", printed)
    assert Path(scenes).is_relative_to(prefix)
    assert flockstep.World.load(next(Path(scenes).rglob("train-1.json"))).name


def test_the_python_package_says_that_it_has_no_library(tmp_path: Path) -> None:
    (tmp_path / "CMakeLists.txt").write_text(LOOKS_FOR_THE_LIBRARY)
    command = ["cmake", "-S", tmp_path, "-B", tmp_path / "build", "-G", "Ninja"]
    command += [f"-Dflockstep_DIR={flockstep.cmake_dir()}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "the Python package has headers only" in " ".join(done.stderr.split())


def defined(*objects: Path) -> set[str]:
    """Return the functions with external linkage that the object files define."""
    lines = run("nm", "-C", "--defined-only", *objects).splitlines()
    return {line.split(" ", 2)[2] for line in lines if re.match(r"[0-9a-f]+ T ", line)}


@linux_only
def test_the_library_exports_what_the_headers_declare_and_nothing_else(library: Path) -> None:
    names = exported(library)
    own = re.compile(r"(?:(?:typeinfo|typeinfo name|vtable) for )?flockstep::")
    assert [name for name in names if not own.match(name)] == []
    text = "\n".join(header.read_text() for header in HEADERS)
    classes = set(re.findall(r"^(?:class|struct)(?: FLOCKSTEP_API)? (\w+) [^;\n]*\{", text, re.MULTILINE))
    functions = set(re.findall(r"^FLOCKSTEP_API (?:[\w:<>,*& ]+?[ >*&])(\w+)\(", text, re.MULTILINE))
    assert {"plan", "raycast", "office", "make_batch"} <= functions
    public = re.compile(rf"flockstep::(?:(?:{'|'.join(classes)})::~?\w+|(?:{'|'.join(functions)}))(?:\[abi:cxx11\])?\(")
    parts = ("engine", "setup", "generators")
    objects = [file for part in parts for file in (BUILD / f"CMakeFiles/flockstep_{part}.dir").rglob("*.o")]
    declared = {name for name in defined(*objects) if public.match(name)}
    assert len(declared) > 150
    assert declared - set(names) == set()


@linux_only
def test_the_python_module_exports_its_entry_only() -> None:
    assert exported(Path(flockstep._core.__file__)) == ["PyInit__core"]


@linux_only
@pytest.mark.parametrize("order", ["torch, library, flockstep", "library, flockstep, torch"])
def test_shares_a_process_with_torch(library: Path, order: str) -> None:
    """Torch contains its own copies of libraries such as Eigen. Here all symbols are globally visible."""
    load = {
        "torch": "import torch",
        "library": f"ctypes.CDLL({str(library)!r}, mode=ctypes.RTLD_GLOBAL)",
        "flockstep": "import flockstep",
    }
    steps = [
        "import ctypes, os, sys",
        "sys.setdlopenflags(os.RTLD_NOW | os.RTLD_GLOBAL)",
        *(load[word] for word in order.split(", ")),
        "a = torch.arange(16.0).reshape(4, 4) + torch.eye(4)",
        "assert torch.allclose(a @ torch.linalg.inv(a), torch.eye(4), atol=1e-3)",
        "batch = flockstep.Batch(flockstep.scenes.load('train'), 2, lidar=flockstep.LidarConfig())",
        "batch.sense()",
        "print(batch.lidar().ranges.tobytes().hex())",
    ]
    together = run(sys.executable, "-c", "\n".join(steps))
    apart = run(sys.executable, "-c", "\n".join(["import flockstep", *steps[-3:]]))
    assert together == apart


WITHOUT_GL = """#include <cstdio>
#include "render/gl/renderer.hpp"
int main() try {
  flockstep::render::GlRenderer renderer;
} catch (const flockstep::render::GlUnavailable& error) {
  std::puts(error.what());
}
"""


def test_a_build_without_the_backend_gl_needs_no_opengl_and_says_so(tmp_path: Path) -> None:
    """With FLOCKSTEP_GL=OFF, one file replaces the folder render/gl."""
    (tmp_path / "main.cpp").write_text(WITHOUT_GL, encoding="utf-8")
    includes = [f"-I{ROOT / 'engine' / part}" for part in ("include", "src")]
    eigen = run("pkg-config", "--cflags", "eigen3").split()
    source = ROOT / "engine" / "src" / "render" / "without_gl.cpp"
    program = tmp_path / "program"
    embree = f"-DFLOCKSTEP_EMBREE_MAJOR={flockstep._core.embree_version.split('.')[0]}"
    run("c++", "-std=c++20", *WARNINGS, embree, *includes, *eigen, source, tmp_path / "main.cpp", "-o", program)
    assert run(program) == "this build of flockstep has no backend gl\n"
