"""Pages that replay recordings: one file each, for any browser."""

from __future__ import annotations

import base64
import gzip
import html
import os
import re
import sys
from collections.abc import Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from flockstep.pictures.shown import PAGE
from flockstep.recordings.recording import Recording
from flockstep.viewer.packing import header, pack

_PLACE = "<!-- flights -->"
_BLOCK = '<script type="application/gzip"{}>{}</script>'


def is_built() -> bool:
    """Return whether this build of flockstep has the page."""
    return PAGE.is_file()


def template() -> str:
    """Return the page without flights.

    Raises
    ------
    FileNotFoundError
        This build of flockstep has none.
    """
    try:
        return PAGE.read_text(encoding="utf-8")
    except FileNotFoundError:
        hint = "build it with Node.js 18 or newer: ./dev viewer"
        raise FileNotFoundError(f"{PAGE.name}: this build of flockstep has no page for replays; {hint}") from None


def flight_in(path: str | PathLike[str]) -> Recording | str:
    """Return the recording of a file ``.mcap``, or the first flight of a page, as it stands there.

    Raises
    ------
    ValueError
        The file is neither.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".html", ".mcap"):
        raise ValueError(f"path: expected a name that ends with .html or .mcap, got {fspath(path)!r}")
    if not os.path.isfile(path):
        kind = "is a directory" if os.path.isdir(path) else "is no file" if os.path.exists(path) else "does not exist"
        raise ValueError(f"path: expected a file, got {fspath(path)!r}, which {kind}")
    try:
        if suffix == ".mcap":
            return Recording(path)
        text = Path(path).read_bytes()
    except PermissionError:
        raise ValueError(f"path: expected a file that you may read, got {fspath(path)!r}") from None
    found = re.search(_BLOCK.format("[^>]*", r"([\w+/=\s]+)").encode(), text)
    if found is None or not text.rstrip().endswith(b"</html>"):  # or it was cut short
        raise ValueError(f"path: expected a page that replays a flight, got {fspath(path)!r}")
    return found[1].decode()


def page(recordings: Sequence[Recording | str], names: Sequence[str] = ()) -> str:
    """Return the text of a page that shows one recording, or two: the second as a ghost, or side by side.

    Those of other pages are texts of `flight_in`. Two have names in the page, by default the titles of their flights.
    """
    if not 1 <= len(recordings) <= 2:
        raise ValueError(f"recordings: expected one or two, got {len(recordings)}")
    said = [f' data-name="{html.escape(name)}"' for name in names] or [""] * len(recordings)
    blocks = (_BLOCK.format(name, _flight(each)) for name, each in zip(said, recordings, strict=True))
    return with_block("\n".join(blocks))


def with_block(block: str) -> str:
    """Return the text of the page with a block that says what it shows."""
    before, found, after = template().partition(_PLACE)
    assert found, "the page has no place for flights"
    return before + block + after


def _flight(recording: Recording | str) -> str:
    if isinstance(recording, str):
        return recording
    return base64.b64encode(gzip.compress(pack(recording), 6, mtime=0)).decode()


def worlds_of(recording: Recording | str) -> set[str]:
    """Return the names of the worlds of a recording, or of a flight in a page."""
    if isinstance(recording, Recording):
        return {world.name for world in recording.worlds.values()}
    return {world["name"] for world in header(gzip.decompress(base64.b64decode(recording)))["worlds"]}


def write(path: str | PathLike[str], recordings: Sequence[Recording | str], names: Sequence[str] = ()) -> None:
    """Write a page, completely or not at all."""
    text = page(recordings, names)
    part = Path(f"{path}.part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


def has_display() -> bool:
    """Return whether a browser could open a window that somebody sees."""
    is_screen = sys.platform in ("darwin", "win32") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    return is_screen and not os.environ.get("CI")


def show(*recordings: Recording, height: int = 600) -> Any:
    """Show one recording, or two, in a Jupyter notebook.

    Two are flown in one view, the second as a ghost, or side by side.

    Parameters
    ----------
    *recordings
        One or two.
    height
        Height of the view in pixels.
    """
    from IPython.display import HTML  # only notebooks have it

    text = html.escape(page(recordings), quote=True)
    style = f"width:100%;height:{int(height)}px;border:0;border-radius:8px"
    return HTML(f'<iframe srcdoc="{text}" style="{style}" sandbox="allow-scripts"></iframe>')
