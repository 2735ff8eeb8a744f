"""Trails of pictures and the live view of a vector env."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from flockstep._core import Batch
    from flockstep.pictures.lines import Trail
    from flockstep.viewer.live import LiveView

RENDER_MODES = ["human", "rgb_array"]
#: The page of live views and replays, if Node.js was there. Its home `flockstep.viewer` imports vector envs.
PAGE = Path(__file__).parents[1] / "viewer" / "page.html"

#: Actions of all rows, a function that returns them, or None if there are none.
Actions: TypeAlias = npt.ArrayLike | Callable[[], npt.ArrayLike] | None


class Shown:
    """A vector env that says when its drones have moved."""

    batch: Batch
    render_mode: str | None
    trail: Trail | None = None
    _live: LiveView | None = None
    _watched: LiveView | None = None  # the same while a page is open

    def _begun(self, mask: npt.NDArray[np.bool_] | None = None, opens: bool = True) -> None:
        """Show that episodes have begun in the envs, or for the drones, of a mask; open the view of ``"human"``."""
        if self.trail is not None:
            self.trail.record(True if mask is None else np.repeat(mask, self.batch.num_drones // len(mask)))
        if opens and self.render_mode == "human" and self._live is None:
            from flockstep.viewer import view  # it imports vector envs

            view(self)
        if self._watched is not None:
            self._watched.begun()

    def _flown(self, actions: Actions = None, steps: int = 1) -> None:
        """Show that all drones have flown env steps. A live view may wait here."""
        if self.trail is not None:
            self.trail.record()
        if self._watched is not None:
            self._watched.flown(actions, steps)


def built_render_modes() -> list[str]:
    """Return the render modes of this build: ``"human"`` needs the page."""
    return [mode for mode in RENDER_MODES if mode != "human" or PAGE.is_file()]


def require_render_mode(mode: Any) -> None:
    """Raise ValueError for an unknown render mode, or another error if something that it needs is missing."""
    if mode is not None and mode not in RENDER_MODES:
        raise ValueError(f"render_mode: expected None or {', '.join(map(repr, RENDER_MODES))}, got {mode!r}")
    if mode == "human":
        from flockstep.viewer import live  # it imports vector envs

        live.require()
