"""The installed C++ client, in programs outside the checkout that connect to a server in this process."""

import contextlib
import os
import pty
import re
import select
import shutil
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from conftest import placed
from cpp_programs import COMPILERS, ROOT, WARNINGS, configure, exported, install, linux_only, run

import flockstep

EXAMPLES = ("fly_square", "map_room", "steer_by_keyboard")
CENTER, HALF = np.array([0.0, 0.0, 2.0]), np.array([5.0, 4.0, 2.0])  # of the room


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A prefix with only the client, moved after its installation."""
    return install(tmp_path_factory.mktemp("client"), "client")


@pytest.fixture(scope="module", params=COMPILERS)
def programs(prefix: Path, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The examples, built by a compiler against the client on a machine without Eigen."""
    folder = tmp_path_factory.mktemp("examples")
    for name in ("CMakeLists.txt", *(f"{example}.cpp" for example in EXAMPLES)):
        shutil.copy(ROOT / "examples" / name, folder)
    configure(folder, request.param, f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON")
    return folder / "build"


@contextlib.contextmanager
def serving(motion: str = "kinematic") -> Iterator[tuple[flockstep.Batch, str]]:
    """Serve one drone in an empty room, with a free slot for another one."""
    builder = flockstep.WorldBuilder()
    builder.room(CENTER - HALF, CENTER + HALF, builder.material("wall"))
    dynamics = flockstep.DynamicsConfig(motion=motion, control="pose" if motion == "kinematic" else "heading_velocity")
    lidar = flockstep.LidarConfig(beams=4, hfov_deg=360)
    batch = placed(builder.build(), [[-1, 0, 2]] * 2, drones_per_env=2, lidar=lidar, dynamics=dynamics)
    batch.remove([1])
    with flockstep.serve(batch, port=0) as server:
        yield batch, server.address


def test_the_examples_are_short() -> None:
    for example in EXAMPLES:
        assert len((ROOT / "examples" / f"{example}.cpp").read_text().splitlines()) <= 115, example


def test_flies_a_square(programs: Path) -> None:
    with serving() as (batch, address):
        lines = run(programs / "fly_square", address).splitlines()
        assert len(lines) == 4
        for line, corner in zip(lines, [(0, 0), (0, 1), (-1, 1), (-1, 0)], strict=True):
            x, y, z, *ranges = (float(number) for number in re.findall(r"-?\d+\.\d+|inf", line))
            assert (x, y, z) == (*corner, 2.0)
            batch.set_pose(np.float32([[x, y, z]] * 2))
            batch.sense()
            np.testing.assert_allclose(ranges, batch.lidar().ranges[0].ravel(), atol=0.0051)  # two decimals


def test_maps_a_room(programs: Path, tmp_path: Path) -> None:
    with serving() as (batch, address):
        path = tmp_path / "room.ply"
        printed = run(programs / "map_room", path, address)
        header, _, body = path.read_text().partition("end_header\n")
        points = np.array([[float(number) for number in line.split()] for line in body.splitlines()])
        assert f"element vertex {len(points)}\n" in header
        assert printed == f"{len(points)} points in {path}\n"
        assert len(points) == 40 * 16 * 90  # every beam hits a wall
        depth = np.abs(np.abs(points - CENTER) - HALF)  # to the walls across each axis
        np.testing.assert_allclose(depth.min(axis=1), 0, atol=1e-3)
        assert (depth < 1e-3).sum(axis=0).min() > 1000  # walls of all directions
        assert batch.active.sum() == 1  # the drone that it spawned is gone


class Steering:
    """The program steer_by_keyboard in a terminal of its own, with a test at the keyboard."""

    def __init__(self, program: Path, address: str) -> None:
        self.keyboard, self.terminal = pty.openpty()
        self.before = termios.tcgetattr(self.terminal)

        def take_the_terminal() -> None:
            os.setsid()
            os.close(os.open(os.ttyname(self.terminal), os.O_RDWR))  # now Ctrl-C is a signal

        self.program = subprocess.Popen(
            [program, address], stdin=self.terminal, stdout=self.terminal, preexec_fn=take_the_terminal
        )

    def __enter__(self) -> "Steering":
        self.wait_for(lambda: termios.tcgetattr(self.terminal) != self.before)
        return self

    def __exit__(self, *exception: object) -> None:
        self.program.kill()
        self.program.wait()
        os.close(self.keyboard)
        os.close(self.terminal)

    def wait_for(self, is_done: Callable[[], bool]) -> None:
        """Read what the program prints until a condition holds."""
        until = time.monotonic() + 30
        while not is_done():
            assert time.monotonic() < until
            while select.select([self.keyboard], [], [], 0.02)[0]:
                os.read(self.keyboard, 4096)

    def check_end(self) -> None:
        """Wait for the end of the program, and check that it has restored the terminal."""
        self.wait_for(lambda: self.program.poll() is not None)
        assert self.program.returncode == 0
        assert termios.tcgetattr(self.terminal) == self.before


@pytest.mark.parametrize(("motion", "end"), [("kinematic", b"q"), ("rotors", b"\x03")])
def test_steers_by_keyboard_and_restores_the_terminal(programs: Path, motion: str, end: bytes) -> None:
    with serving(motion) as (batch, address), Steering(programs / "steer_by_keyboard", address) as steering:
        start = batch.position[0].copy()
        os.write(steering.keyboard, b"w\x1b[A")
        steering.wait_for(lambda: bool((batch.position[0] - start >= [0.2, -0.01, 0.2]).all()))
        if motion == "kinematic":
            np.testing.assert_allclose(batch.position[0] - start, [0.25, 0, 0.25], atol=1e-5)
        os.write(steering.keyboard, b" " + end)
        steering.check_end()


def test_signals_restore_the_terminal(programs: Path) -> None:
    with serving() as (_, address), Steering(programs / "steer_by_keyboard", address) as steering:
        steering.program.send_signal(signal.SIGTERM)
        steering.check_end()


def test_examples_say_what_is_wrong(programs: Path) -> None:
    done = subprocess.run([programs / "fly_square", "127.0.0.1:9"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    expected = "no server at 127.0.0.1:9: start one with `python -m flockstep serve RECIPE`"
    assert done.stderr == f"fly_square: {expected}\n"


LOOKS_FOR = """
cmake_minimum_required(VERSION 3.25)
project(reader LANGUAGES CXX)
find_package(flockstep 0.1 REQUIRED COMPONENTS {components})
if(TARGET flockstep::client)
  message(STATUS "has the client")
endif()
if(TARGET flockstep::flockstep)
  message(STATUS "has the engine")
endif()
"""


def find(tmp_path: Path, prefix: Path, components: str, *options: str) -> str:
    """Look for components in a prefix; return what CMake prints."""
    (tmp_path / "CMakeLists.txt").write_text(LOOKS_FOR.format(components=components))
    command = ["cmake", "-S", tmp_path, "-B", tmp_path / components.replace(" ", "-"), "-G", "Ninja"]
    done = subprocess.run(
        [*command, f"-DCMAKE_PREFIX_PATH={prefix}", *options], capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr


def test_a_prefix_has_what_was_installed(prefix: Path, tmp_path: Path) -> None:
    without_eigen = "-DCMAKE_DISABLE_FIND_PACKAGE_Eigen3=ON"
    assert "has the client" in find(tmp_path, prefix, "client", without_eigen)
    refused = " ".join(find(tmp_path, prefix, "library").split())
    assert "`./dev install-cpp PREFIX` installs the C++ libraries" in refused
    both = install(tmp_path, "library", "client")
    printed = find(tmp_path, both, "library client")
    assert "has the client" in printed
    assert "has the engine" in printed
    printed = find(tmp_path, both, "client", without_eigen)
    assert "has the client" in printed
    assert "has the engine" not in printed


def test_the_header_needs_only_the_standard_library(prefix: Path, tmp_path: Path) -> None:
    (tmp_path / "program.cpp").write_text('#include "flockstep/client.hpp"\n#include "flockstep/client.hpp"\n')
    headers = sorted(path.name for path in (prefix / "include").rglob("*.hpp"))
    assert headers == ["client.hpp", "client_operations.hpp", "client_results.hpp", "export.hpp"]
    for compiler in COMPILERS:
        listed = run(compiler, "-std=c++20", *WARNINGS, "-M", "-I", prefix / "include", tmp_path / "program.cpp")
        other = [name for name in ("boost", "eigen", "protozero", "openssl") if name in listed.lower()]
        assert other == [], compiler
        run(compiler, "-std=c++20", "-fsyntax-only", *WARNINGS, "-I", prefix / "include", tmp_path / "program.cpp")


@linux_only
def test_the_library_needs_only_openssl_and_the_system(prefix: Path) -> None:
    (library,) = prefix.rglob("libflockstep_client.so")
    needed = re.findall(r"NEEDED.*\[(\w+)", run("readelf", "-d", library))
    system = {"libc", "libm", "libgcc_s", "libstdc", "libpthread", "ld"}
    assert set(needed) - system == {"libssl", "libcrypto"}
    names = exported(library)
    own = re.compile(r"(?:(?:typeinfo|typeinfo name|vtable) for )?flockstep::client::")
    assert [name for name in names if not own.match(name)] == []
    text = (prefix / "include" / "flockstep" / "client_operations.hpp").read_text()
    operations = set(re.findall(r"Future<.+> (\w+)\(Later", text))
    assert len(operations) > 40
    plain = [name.replace("[abi:cxx11]", "") for name in names]  # which marks those that return a string
    for operation in operations:
        assert any(f"Operations::{operation}(flockstep::client::Later" in name for name in plain), operation


#: The operations of the thesis, tables 4.1 and 4.2.
SIMULATION = "ping get_drones spawn_drone remove_drone get_camera_capture_mode set_camera_capture_mode get_fps"
DRONE = """ping get_location set_location get_camera_data get_rotation set_rotation set_location_and_rotation
    get_lidar_data get_lidar_config set_lidar_config get_camera_config set_camera_config get_move_line_visible
    set_move_line_visible"""


def test_the_controllers_have_the_operations_of_the_thesis(tmp_path: Path) -> None:
    run(sys.executable, ROOT / "server" / "generate.py", tmp_path)
    text = (tmp_path / "flockstep" / "client_operations.hpp").read_text()
    _, simulation, drone = re.split(r"class FLOCKSTEP_API (?:GameMode|Drone)Operations", text)
    for words, part in ((SIMULATION, simulation), (DRONE, drone)):
        missing = [word for word in words.split() if not re.search(rf"\b{word}\(later", part)]
        assert missing == []
