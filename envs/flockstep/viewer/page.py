"""Pages that replay recordings: one file each, for any browser."""

from __future__ import annotations

import base64
import gzip
import html
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from flockstep.recordings.recording import Recording
from flockstep.viewer.packing import pack

_TEMPLATE = Path(__file__).with_name("page.html")
_PLACE = "<!-- flights -->"


def is_built() -> bool:
    """Return whether this build of flockstep has the page."""
    return _TEMPLATE.is_file()


def template() -> str:
    """Return the page without flights.

    Raises
    ------
    FileNotFoundError
        This build of flockstep has none.
    """
    try:
        return _TEMPLATE.read_text(encoding="utf-8")
    except FileNotFoundError:
        hint = "build it with Node.js 18 or newer: ./dev viewer"
        raise FileNotFoundError(f"{_TEMPLATE.name}: this build of flockstep has no page for replays; {hint}") from None


def page(recordings: Sequence[Recording]) -> str:
    """Return the text of a page that shows one recording, or two: the second as a ghost, or side by side."""
    if not 1 <= len(recordings) <= 2:
        raise ValueError(f"recordings: expected one or two, got {len(recordings)}")
    flights = (base64.b64encode(gzip.compress(pack(recording), 6, mtime=0)).decode() for recording in recordings)
    return with_block("\n".join(f'<script type="application/gzip">{flight}</script>' for flight in flights))


def with_block(block: str) -> str:
    """Return the text of the page with a block that says what it shows."""
    before, found, after = template().partition(_PLACE)
    assert found, "the page has no place for flights"
    return before + block + after


def write(path: str | PathLike[str], recordings: Sequence[Recording]) -> None:
    """Write a page, completely or not at all."""
    text = page(recordings)
    part = Path(f"{path}.part")
    part.write_text(text, encoding="utf-8")
    part.replace(path)


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
