"""Memory of a world with many triangles, from its file to the first scan and the first frame."""

import json
import subprocess
import sys

import numpy as np
import pytest

import flockstep

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")

ROWS = 708  # rows of vertices, for a million triangles
TRIANGLES = 2 * (ROWS - 1) ** 2

# Prints the bytes that this adds to the process, at the end and at the peak.
LOOK = """
import json, re, sys, numpy as np, flockstep
def memory(what): return 1024 * int(re.search(what + r":\\s+(\\d+)", open("/proc/self/status").read())[1])
before = memory("VmRSS")
world = flockstep.World.load(sys.argv[1])
batch = flockstep.Batch([world], lidar=flockstep.LidarConfig(), cameras=[flockstep.CameraConfig()], num_threads=1)
batch.set_pose(np.float32([[0, 0, 8]]))
batch.sense()
print(json.dumps([memory("VmRSS") - before, memory("VmHWM") - before]))
"""


def test_a_million_triangles(tmp_path):
    builder = flockstep.WorldBuilder()
    along = np.arange(ROWS) / 12
    heights = (3 * np.sin(along)[:, None] + 3 * np.cos(0.8 * along)[None, :]).astype(np.float32)
    builder.heightfield(heights, builder.material("ground"), corner=(-200, -200), cell_m=400 / ROWS)
    path = tmp_path / "ground.glb"
    builder.build().save(path)
    run = subprocess.run([sys.executable, "-c", LOOK, path], check=True, stdout=subprocess.PIPE)
    resident, peak = json.loads(run.stdout)
    assert resident < 150 * TRIANGLES
    assert peak < 200 * TRIANGLES
