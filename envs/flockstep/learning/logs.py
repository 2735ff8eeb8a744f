"""The log of a training: a table, and files for TensorBoard."""

from __future__ import annotations

import re
import time
from os import PathLike, fspath
from pathlib import Path
from typing import Any


class Log:
    """Records numbers by name, and writes them together.

    Parameters
    ----------
    verbose
        1: print a table at each `dump`.
    folder
        Folder for TensorBoard, in which each run has a folder NAME_1, NAME_2 and so on. None: none.
    name
        Name of the run.
    is_new
        Begin a run; False: add to the last one.
    """

    def __init__(self, verbose: int, folder: str | PathLike[str] | None, name: str, *, is_new: bool = True) -> None:
        self.name_to_value: dict[str, Any] = {}
        self._excluded: dict[str, tuple[str, ...]] = {}
        self._sums: dict[str, tuple[float, int]] = {}
        self._prints = verbose >= 1
        self._writer = None if folder is None else _writer(Path(fspath(folder)), name, is_new)

    @property
    def dir(self) -> str | None:
        """Folder of the run, or None."""
        return None if self._writer is None else str(self._writer.get_logdir())

    def get_dir(self) -> str | None:
        """Return the folder of the run, or None."""
        return self.dir

    def record(self, key: str, value: Any, exclude: str | tuple[str, ...] | None = None) -> None:
        """Set a number or text of the next `dump`.

        Parameters
        ----------
        key
            Name; the part before a slash is the group in the table.
        value
            A number, or a text, which is only printed.
        exclude
            ``"tensorboard"`` to print it only, ``"stdout"`` to write it only to TensorBoard, or both.

        Raises
        ------
        TypeError
            The value is of another kind.
        """
        if not isinstance(value, str):
            try:
                value = value if isinstance(value, (int, float)) else float(value)
            except (TypeError, ValueError) as error:
                raise TypeError(
                    f"{key}: expected a number or a text, got {type(value).__name__}: for other values, call "
                    "set_logger with a logger of Stable-Baselines3"
                ) from error
        self.name_to_value[key] = value
        self._excluded[key] = () if exclude is None else (exclude,) if isinstance(exclude, str) else tuple(exclude)

    def record_mean(self, key: str, value: float | None, exclude: str | tuple[str, ...] | None = None) -> None:
        """Record the mean of all values since the last `dump`."""
        if value is None:
            return
        total, count = self._sums.get(key, (0.0, 0))
        self._sums[key] = (total + value, count + 1)
        self.record(key, (total + value) / (count + 1), exclude)

    def dump(self, step: int = 0) -> None:
        """Write what was recorded since the last call."""
        if self._prints:
            shown = {key: value for key, value in self.name_to_value.items() if "stdout" not in self._excluded[key]}
            print(_table(shown), flush=True)
        if self._writer is not None:
            for key, value in self.name_to_value.items():
                if "tensorboard" not in self._excluded[key] and not isinstance(value, str):
                    _write(self._writer, key, float(value), step)
            self._writer.flush()
        self.name_to_value.clear()
        self._excluded.clear()
        self._sums.clear()

    def close(self) -> None:
        """Close the files."""
        if self._writer is not None:
            self._writer.close()


def _writer(folder: Path, name: str, is_new: bool) -> Any:
    try:
        from tensorboard.summary.writer.event_file_writer import EventFileWriter
    except ImportError as error:
        raise ImportError("tensorboard_log needs TensorBoard: pip install tensorboard", name="tensorboard") from error
    runs = [
        int(found[1])
        for path in folder.glob(f"{name}_*")
        if (found := re.fullmatch(rf"{re.escape(name)}_(\d+)", path.name))
    ]
    number = max(runs, default=0) + (1 if is_new or not runs else 0)
    return EventFileWriter(str(folder / f"{name}_{number}"))


def _write(writer: Any, key: str, value: float, step: int) -> None:
    from tensorboard.compat.proto.event_pb2 import Event
    from tensorboard.compat.proto.summary_pb2 import Summary

    summary = Summary(value=[Summary.Value(tag=key, simple_value=value)])
    writer.add_event(Event(wall_time=time.time(), step=step, summary=summary))


def _table(values: dict[str, Any]) -> str:
    """Return the numbers as a table, grouped by the part of their names before the slash."""
    rows: list[tuple[str, str]] = []
    last = None
    for key in sorted(values):
        group, _, rest = key.rpartition("/")
        if group and group != last:
            rows.append((f"{group}/", ""))
            last = group
        value = values[key]
        rows.append((f"   {rest}" if group else rest, f"{value:.3g}" if isinstance(value, float) else str(value)))
    left, right = (max((len(row[i]) for row in rows), default=0) for i in (0, 1))
    line = "-" * (left + right + 7)
    return "\n".join([line, *(f"| {name:<{left}} | {value:<{right}} |" for name, value in rows), line])
