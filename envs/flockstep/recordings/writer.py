"""Write a recording while a program flies."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy.typing as npt

from flockstep.recordings.capture import Capture
from flockstep.recordings.recording import require_saveable
from flockstep.vector_env import DroneVectorEnv


class RecordingWriter:
    """Writes envs to a file step by step: call `add` after the reset and after each step.

    ``Recording.writer`` makes it. A page ``.html`` is written when the block ends without an error, ``.mcap`` step by
    step, so that a program that is killed leaves a file up to its latest moments.
    """

    def __init__(self, path: str | PathLike[str], envs: DroneVectorEnv, paths: Sequence[npt.ArrayLike] = ()) -> None:
        require_saveable(path)
        self._path = path
        self._capture: Capture | None = None
        self._recorder: Any = None
        if Path(path).suffix.lower() == ".mcap":
            from flockstep.bridges.mcap import McapRecorder  # imports this package

            self._recorder = McapRecorder(path, envs, arrays=True, paths=paths)
        else:
            self._capture = Capture(envs, paths=paths)

    def add(self, actions: npt.ArrayLike | None = None) -> None:
        """Add the present moment, with the actions that led to it."""
        if self._capture is not None:
            self._capture.add(actions)
        else:
            self._recorder.write(actions)

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        if self._recorder is not None:
            self._recorder.close()
        elif kind is None and self._capture is not None:
            self._capture.recording().save(self._path)
