"""Headers of `flockstep.export`: errors against `predict`, and their size and instructions on Cortex-M processors.

Debian's gcc-arm-none-eabi, libnewlib-arm-none-eabi and qemu-system-arm are needed. QEMU runs an instruction per
nanosecond of its clock (-icount shift=0), which the program reads: instructions are counted, not cycles.
"""

from __future__ import annotations

import ctypes
import re
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import flockstep
from flockstep.learning.actor import actor_of
from timing import Measured

HERE = Path(__file__).resolve().parent
POLICIES = ("hover", "hover_varied", "track", "race", "lidar", "dodge")
BOARDS = {
    "cortex-m4": ("mps2-an386", ["-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"]),
    "cortex-m7": ("mps2-an500", ["-mcpu=cortex-m7", "-mfpu=fpv5-d16"]),
}
OBSERVATIONS = 20_000
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Werror"]
CASES = 4  # of the self test


def run(folder: Path, *command: str) -> str:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True, timeout=300).stdout


def difference(folder: Path, name: str, model: Any) -> float:
    """Return the largest difference between actions by the header, compiled for this machine, and by `predict`."""
    actor = actor_of(model)
    drawn = np.random.default_rng(1).uniform(-2.0, 2.0, (OBSERVATIONS, actor.observation_size))
    low, high = model.observation_space.low, model.observation_space.high
    if actor.features == "goal":
        drawn[:, 3:] = np.abs(drawn[:, 3:])  # ranges
    rows = np.clip(drawn, low, high).astype(np.float32)
    run(folder, "gcc", *WARNINGS, "-O2", "-shared", "-fPIC", "act.c", "-o", f"{name}.so", "-lm")
    act = ctypes.CDLL(str(folder / f"{name}.so")).act
    act.argtypes = [np.ctypeslib.ndpointer(np.float32, flags="C")] * 2
    found = np.empty((OBSERVATIONS, actor.action_size), np.float32)
    for row, action in zip(rows, found, strict=True):
        act(row, action)
    return float(np.abs(found - actor.predict(rows)).max())


def on_board(folder: Path, name: str, board: str, optimization: str) -> tuple[dict[str, float], float]:
    """Return bytes and instructions of an action on a board, and the self test's result there."""
    machine, flags = BOARDS[board]
    compiler = ["arm-none-eabi-gcc", *WARNINGS, *flags, "-mthumb", "-mfloat-abi=hard", optimization]
    compiler += ["-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections"]
    run(folder, *compiler, "-fstack-usage", "-c", "act.c", "-o", "act.o")
    stack = [int(size) for size in re.findall(r":\w+\s(\d+)\sstatic", (folder / "act.su").read_text())]
    run(folder, *compiler, "--specs=nosys.specs", "-nostartfiles", "-Wl,-e,act", "act.o", "-o", "act.elf", "-lm")
    text, data, zeros = map(int, run(folder, "arm-none-eabi-size", "act.elf").splitlines()[1].split()[:3])
    names = [f"-DPOLICY={name}", f'-DHEADER="{name}.h"', f"-DCASES={CASES}", "-I.", "-T", str(HERE / "board.ld")]
    loose = [flag for flag in compiler if flag != "-Wpedantic"]  # the vectors hold an address of data
    run(folder, *loose, "--specs=rdimon.specs", *names, str(HERE / "main.c"), "-o", "main.elf", "-lm")
    qemu = ["qemu-system-arm", "-M", machine, "-nographic", "-icount", "shift=0"]
    printed = run(folder, *qemu, "-semihosting-config", "enable=on,target=native", "-kernel", "main.elf")
    worst, instructions, million = map(float, printed.split())
    if not 0.999e6 < million < 1.001e6:
        raise RuntimeError(f"{machine}: expected to count a million instructions, got {million}")
    return {"flash_bytes": text + data, "ram_bytes": data + zeros + sum(stack), "instructions": instructions}, worst


def measure() -> Iterator[Measured]:
    """Compile policies and run them."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        for name in POLICIES:
            model = flockstep.policies.load(name)
            flockstep.export(model, folder / f"{name}.h")
            (folder / "act.c").write_text(
                f'#include "{name}.h"\n'
                "void act(const float *observation, float *action);\n"
                f"void act(const float *observation, float *action) {{ {name}_act(observation, action); }}\n"
            )
            yield f"export/{name}/parameters", sum(x.weight.size + x.bias.size for x in actor_of(model).layers), "1", 1
            yield f"export/{name}/x86/difference", difference(folder, name, model), "1", OBSERVATIONS
            for board in BOARDS:
                for optimization in ("-Os", "-O2"):
                    numbers, worst = on_board(folder, name, board, optimization)
                    for what, value in numbers.items():
                        unit = "B" if what.endswith("bytes") else "1"
                        yield f"export/{name}/{board}/{optimization[1:]}/{what}", value, unit, 1
                    yield f"export/{name}/{board}/{optimization[1:]}/difference", worst, "1", CASES
