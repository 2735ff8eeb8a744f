"""A recorded flight: NumPy arrays by name, and everything needed to show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from flockstep._core import DroneModel, EpisodeEnd, World
from flockstep.drone_mesh import DroneMesh
from flockstep.errors import did_you_mean
from flockstep.recordings.moment import Array

if TYPE_CHECKING:
    from flockstep.recordings.writer import RecordingWriter
    from flockstep.vector_env import DroneVectorEnv

_SUFFIXES = (".html", ".mcap")


@dataclass(frozen=True)
class EpisodeEnding:
    """How one episode ended."""

    moment: int
    """Index of the moment in the recording."""
    row: int
    """Row of the rewards: a drone, or an env if rewards belong to envs."""
    reason: EpisodeEnd
    success: bool
    episode_return: float
    episode_length: int


@dataclass
class Contents:
    """The parts of a recording. Sources fill it, and `Recording` shows it."""

    arrays: dict[str, Array]
    images: dict[str, list[bytes]]
    settings: dict[str, Any]  # `Moments.settings`
    worlds: dict[int, World]  # by `world_index`
    bodies: list[World]  # looks of moving objects, to which ``bodies.look`` counts
    drone: DroneModel
    look: DroneMesh | None
    recipe: str
    times_s: Array  # (T,) s, from 0
    title: str
    repeats_ends: bool  # True if flags of an ended episode repeat until a reset
    units: dict[str, str] = field(default_factory=dict)
    ended_before: Array | None = None  # (R,) flags that the first moment may repeat. None: all episodes begin there


class Recording:
    """A recorded flight.

    ``recording["position"]`` is the array (T, N, 3) of T moments; the names are those of the arrays of a batch, such as
    ``"contact.point"``, and ``"actions"``. Arrays of a LiDAR have names such as ``"lidar.NAME.ranges"`` (T, N, beams),
    and of a second IMU ``"imu.NAME.gyroscope"``. Files that were written step by step, as by `record`, also have what
    cameras see beside colours, such as ``"camera.NAME.depth"``. The first moment is before the first step, and has NaN
    as actions. If the task counts gates, ``"gate.next"`` (T, N) is the index of each drone's next gate and
    ``"gate.passed"`` (T, N) the number that it has passed in its episode.

    Parameters
    ----------
    path
        A file ``.mcap`` that `record` or `save` wrote. If it was cut short, the recording has all moments up to its
        end. Reading needs the extra ``mcap``.

    Attributes
    ----------
    times_s
        (T,) float64: seconds since the first moment.
    images
        By the name of each camera a list of JPEG files. ``recording["camera.NAME.image"]`` (T, N) has the index of each
        drone's latest image, -1 without one.
    recipe
        JSON text of the `Recipe`.
    title
        Shown by the viewer.
    worlds
        The worlds by their ``world_index``.
    drone
        The `DroneModel`.
    drone_mesh
        The `DroneMesh` that shows drones, or None.

    Raises
    ------
    ValueError
        The file is not a recording, or its contents do not fit together.
    ModuleNotFoundError
        The package mcap is not installed.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        if Path(path).suffix.lower() != ".mcap":
            raise ValueError(f"path: expected a name that ends with .mcap, got {fspath(path)!r}")
        from flockstep.recordings import mcap_files  # needs the package mcap

        self._fill(mcap_files.read(path))

    @classmethod
    def _of(cls, contents: Contents) -> Recording:
        recording = cls.__new__(cls)
        recording._fill(contents)
        return recording

    def _fill(self, contents: Contents) -> None:
        position = contents.arrays.get("position")
        if position is None or position.ndim != 3 or not len(position):
            raise ValueError("recording: expected at least one moment with positions, got none")
        self._contents = contents
        self.images: Mapping[str, list[bytes]] = contents.images
        self.recipe, self.title = contents.recipe, contents.title
        self.worlds: Mapping[int, World] = contents.worlds
        self.drone, self.drone_mesh = contents.drone, contents.look
        self.times_s = contents.times_s

    def __getitem__(self, name: str) -> Array:
        """Return an array (T, ...) by its name."""
        arrays = self._contents.arrays
        if name not in arrays:
            raise KeyError(f"recording: expected one of {', '.join(arrays)}, got {name!r}{did_you_mean(name, arrays)}")
        return arrays[name]

    def __contains__(self, name: object) -> bool:
        return name in self._contents.arrays

    def __len__(self) -> int:
        return len(self.times_s)

    @property
    def names(self) -> list[str]:
        """Names of the arrays."""
        return list(self._contents.arrays)

    @property
    def num_envs(self) -> int:
        """Number of recorded envs, E."""
        return int(self._contents.settings["num_envs"])

    @property
    def drones_per_env(self) -> int:
        """Number of drones in each env, M. There are N = E M drones."""
        return int(self._contents.settings["per_env"])

    @property
    def reward_terms(self) -> list[str]:
        """Names of the columns of ``recording["reward_terms"]``."""
        return list(self._contents.settings["reward_terms"])

    @property
    def paths(self) -> list[Array]:
        """Planned paths (P, 3) m that the viewer draws, one for each env in turn."""
        return [np.asarray(path) for path in self._contents.settings["paths"]]

    @property
    def drone_episodes(self) -> Array:
        """(T, N) int64: number of the episode that each drone flies, which changes where one begins."""
        episode = np.repeat(self["episode"], self.drones_per_env, axis=1)
        return episode + self["own_episodes"] if "own_episodes" in self else episode

    @property
    def ends(self) -> list[EpisodeEnding]:
        """The episodes that ended, in the order of time."""
        if "episode_end" not in self:
            return []
        flags = self["terminated"].astype(bool) | self["truncated"].astype(bool)
        before, ended = self._contents.ended_before, flags.copy()
        if self._contents.repeats_ends:
            ended[1:] &= ~flags[:-1]
        ended[0] &= False if before is None else ~before
        values = (self[name] for name in ("episode_end", "success", "episode_return", "episode_length"))
        reason, success, total, length = values
        known = {int(end) for end in EpisodeEnd}
        return [
            EpisodeEnding(
                int(moment),
                int(row),
                EpisodeEnd(int(reason[moment, row]) if int(reason[moment, row]) in known else 0),
                bool(success[moment, row]),
                float(total[moment, row]),
                int(length[moment, row]),
            )
            for moment, row in np.argwhere(ended)
        ]

    @staticmethod
    def writer(
        path: str | PathLike[str], envs: DroneVectorEnv, *, paths: Sequence[npt.ArrayLike] = ()
    ) -> RecordingWriter:
        """Return a writer of a file, ``.html`` or ``.mcap``, that records envs step by step.

        ``paths`` are planned paths for the viewer, arrays (P, 3) m such as those of `flockstep.plan`, one for each env
        in turn.

        >>> with flockstep.Recording.writer("flight.html", envs) as writer:
        ...     envs.reset(seed=0)
        ...     writer.add()
        ...     for _ in range(100):
        ...         actions = envs.action_space.sample()
        ...         envs.step(actions)
        ...         writer.add(actions)
        """
        from flockstep.recordings.writer import RecordingWriter  # imports this module

        return RecordingWriter(path, envs, paths)

    def save(self, path: str | PathLike[str], *, ghost: Recording | None = None) -> None:
        """Write a page ``.html`` for any browser, or a file ``.mcap``, which `Recording` reads.

        The page holds the flight, its worlds and its drones. It needs no server and no other file.

        Parameters
        ----------
        path
            The file.
        ghost
            A second recording for the page, such as another policy's with the same seed: as a ghost in the first one's
            world, or side by side.
        """
        require_saveable(path)
        if Path(path).suffix.lower() == ".html":
            from flockstep.viewer import page

            page.write(path, [self] if ghost is None else [self, ghost])
        elif ghost is not None:
            raise ValueError("ghost: expected None for a file .mcap, got a Recording")
        else:
            from flockstep.recordings import mcap_files  # needs the package mcap

            mcap_files.write(path, self._contents)

    def __repr__(self) -> str:
        shape = f"{self.num_envs} x {self.drones_per_env} drones"
        return f"<Recording {self.title!r}, {len(self)} moments of {shape}, {self.times_s[-1]:.1f} s>"


def plain_paths(paths: Sequence[npt.ArrayLike]) -> list[list[list[float]]]:
    """Return planned paths, arrays (P, 3), as JSON values; raise ValueError for other shapes and numbers."""
    plain: list[list[list[float]]] = []
    for i, path in enumerate(paths):
        try:
            points = np.asarray(path, np.float64)
        except (TypeError, ValueError):
            points = np.zeros(0)
        if points.ndim != 2 or points.shape[1] != 3 or len(points) < 2 or not np.isfinite(points).all():
            found = f"{points.shape}" if points.size else repr(path)
            raise ValueError(f"paths[{i}]: expected an array (P, 3) of finite numbers with P >= 2, got {found[:80]}")
        plain.append(points.tolist())
    return plain


def require_saveable(path: str | PathLike[str], others: Sequence[str] = ()) -> None:
    """Raise an error if a recording cannot be saved at a path, because of its suffix or of what is not installed.

    ``others`` are further suffixes to name.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _SUFFIXES:
        expected = ", ".join((*_SUFFIXES, *others))
        raise ValueError(f"path: expected a name that ends with one of {expected}, got {fspath(path)!r}")
    if suffix == ".html":
        from flockstep.viewer import page

        page.template()
    else:
        from flockstep.recordings import mcap_files

        mcap_files.require()
