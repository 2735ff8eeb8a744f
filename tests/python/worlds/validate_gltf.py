"""Validate worlds saved as glTF with the Khronos validator: `./dev validate-gltf`, which installs it by npm.

It checks every bundled scene and the requested number of random worlds. Exits with 1 on any error or warning.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path

from test_mesh_files import random_world

import flockstep
from flockstep import scenes

VALIDATE = """
const { readFileSync } = require("fs");
const { validateBytes } = require("gltf-validator");
(async () => {
  for (const path of process.argv.slice(1)) {
    const { issues } = await validateBytes(new Uint8Array(readFileSync(path)), { uri: path, maxIssues: 0 });
    console.log(JSON.stringify({ path, ...issues }));
  }
})();
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--random", type=int, default=20, help="random worlds; a quarter as many playgrounds and forests"
    )
    parser.add_argument("--validator", type=Path, required=True, help="folder of npm packages that has gltf-validator")
    args = parser.parse_args()
    worlds = {name.replace("/", "-"): flockstep.World.load(name) for name in scenes.names()}
    for seed in range(args.random):
        worlds[f"random-{seed}"] = random_world(seed)
    for seed in range(args.random // 4):
        worlds[f"playground-{seed}"] = flockstep.World.playground(seed, pillars=5 * seed)
        worlds[f"forest-{seed}"] = flockstep.World.forest(seed, trees=20, size_m=(30, 30))
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, name + suffix) for name in worlds for suffix in (".glb", ".gltf")]
        for path in paths:
            worlds[path.stem].save(path)
        command = ["node", "-e", VALIDATE, *map(str, paths)]
        environment = os.environ | {"NODE_PATH": str(args.validator.resolve())}
        out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env=environment).stdout
    reports = [json.loads(line) for line in out.splitlines()]
    assert len(reports) == len(paths)
    bad = [report for report in reports if report["numErrors"] or report["numWarnings"]]
    for report in bad:
        print(json.dumps(report, indent=1)[:2000])
    codes = sorted({message["code"] for report in reports for message in report["messages"]})
    print(f"{len(reports)} files, {len(bad)} of them with errors or warnings; remarks: {', '.join(codes) or 'none'}")
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
