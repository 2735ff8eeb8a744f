"""Serves a batch, so that other processes see and steer its drones; the command ``python -m flockstep serve``."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

from flockstep._core import Batch, CameraConfig, Recipe, Server, ServerConfig

if TYPE_CHECKING:
    from flockstep.vector_env import DroneVectorEnv

TOKEN_VARIABLE = "FLOCKSTEP_TOKEN"


def serve(batch: Batch | DroneVectorEnv, config: ServerConfig | None = None, **fields: Any) -> Server:
    """Serve a batch from threads of this process, until `Server.stop`.

    >>> with flockstep.serve(batch, port=0) as server:
    ...     print(server.address)

    Parameters
    ----------
    batch
        The batch, or an environment, whose batch is served.
    config
        Address, token and limits. Default: port 41451 on loopback.
    **fields
        Fields of `ServerConfig`, which override those of ``config``.

    Raises
    ------
    ValueError
        A field is invalid; a token is missing for an address that other machines reach.
    RuntimeError
        The port is taken, or a file cannot be read.
    """
    given = {name: getattr(config, name) for name in ServerConfig.__match_args__} if config is not None else {}
    served = batch if isinstance(batch, Batch) else batch.batch
    return Server(served, ServerConfig(**given | fields))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command ``serve``."""
    parser.set_defaults(run=main)
    parser.add_argument("recipe", nargs="?", help="JSON file of a recipe; without it, an empty simulation is served")
    parser.add_argument(
        "--world", action="append", help="name of a scene or set of scenes, instead of those of the recipe"
    )
    parser.add_argument("--drone", help="name of a bundled airframe, instead of that of the recipe")
    parser.add_argument(
        "--allow-files", action="store_true", help="allow the recipe to open scene and drone files anywhere"
    )
    about_worlds = "what the worlds may cost, in playgrounds; a city counts as 100. Default: 10000"
    parser.add_argument("--max-worlds", type=int, default=10000, help=about_worlds, metavar="N")
    parser.add_argument(
        "--outputs", nargs="+", help="what the cameras measure, such as rgb and depth, instead of what the recipe says"
    )
    parser.add_argument(
        "--max-bodies", type=int, help="slots for moving objects in each env, which clients spawn", metavar="N"
    )
    for field in ServerConfig._fields:  # type: ignore[attr-defined] # the list from which the class is made
        add_field(parser, field)


def add_field(parser: argparse.ArgumentParser, field: dict[str, str]) -> None:
    """Add a flag for a field of `ServerConfig`."""
    name = field["name"]
    flag = "--" + name.replace("_", "-")
    about = field["about"].replace("``", "").replace("%", "%%")
    default = getattr(ServerConfig(), name)
    if isinstance(default, bool):
        parser.add_argument(flag, action="store_true", help=about)
        return
    if name == "token":
        about += f" Safer: the environment variable {TOKEN_VARIABLE}."
    shown = f" Default: {default}." if default not in ("", None) else ""
    parser.add_argument(flag, type=type(default), default=default, help=about + shown, metavar=name.upper())


class Stop:
    """A request to stop. A handler of signals that interrupts `wait` may set it, where an Event would deadlock."""

    def __init__(self) -> None:
        self._requests: SimpleQueue[None] = SimpleQueue()

    def set(self) -> None:
        """Request to stop."""
        self._requests.put(None)

    def is_set(self) -> bool:
        """Return whether it was requested."""
        return not self._requests.empty()

    def wait(self, seconds: float) -> bool:
        """Wait for a request, at most for some seconds; return whether there is one."""
        with suppress(Empty):
            self._requests.put(self._requests.get(timeout=seconds))  # it stays requested
        return self.is_set()


def main(arguments: argparse.Namespace) -> None:
    """Serve until Ctrl-C or SIGTERM."""
    fields = {name: getattr(arguments, name) for name in ServerConfig.__match_args__}
    fields["token"] = fields["token"] or os.environ.get(TOKEN_VARIABLE, "")
    raise_file_limit()
    try:
        access = {"allow_files": arguments.allow_files, "max_worlds": max(arguments.max_worlds, 0)}
        batch = Batch.from_recipe(recipe_of(arguments), **access)
        server = Server(batch, ServerConfig(**fields))
    except (OSError, RuntimeError, ValueError) as error:
        sys.exit(f"flockstep serve: {error}")
    ended = Stop()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ended.set())
    with server:
        print(f"flockstep serves {batch!r} at {server.address}; Ctrl-C ends it", flush=True)
        while not ended.wait(0.5):  # on Windows only a wait with a limit notices signals
            pass
    print(f"stopped after {server.num_requests} requests")


def recipe_of(arguments: argparse.Namespace) -> Recipe:
    """Return the recipe that the command names."""
    if arguments.recipe is not None:
        recipe = Recipe.from_json(Path(arguments.recipe).read_text())
    else:
        recipe = Recipe.from_json(EMPTY)
    if arguments.world:
        recipe.worlds = arguments.world
    if arguments.drone is not None:
        recipe.drone = arguments.drone
    if arguments.max_bodies is not None:
        recipe.max_bodies = arguments.max_bodies
    if arguments.outputs is not None:
        recipe.cameras = [
            CameraConfig(
                **{name: getattr(camera, name) for name in CameraConfig.__match_args__} | {"outputs": arguments.outputs}
            )
            for camera in recipe.cameras
        ]
    return recipe


# One env without drones, which clients spawn; each has the LiDAR and the camera of the thesis.
EMPTY = """{
  "flockstep_recipe": 1, "task": null, "worlds": ["indoor/office"], "num_envs": 1, "drones_per_env": 0,
  "lidars": [{}], "cameras": [{"capture_mode": "on_demand"}]
}"""


def raise_file_limit() -> None:
    """Allow as many open files as the system does: each client needs one."""
    try:
        import resource
    except ImportError:  # Windows has no such limit
        return
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
