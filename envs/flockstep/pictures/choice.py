"""The keywords of `DroneVectorEnv` that choose its pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flockstep.errors import did_you_mean

NAMES = ("top", "camera", "third_person", "fleet")
STYLES = ("bright", "dark", "soft")
SAMPLES = (1, 4, 9, 16)
_MAX_PX = 8192


@dataclass(frozen=True)
class Choice:
    """The checked keywords that begin with ``render_``, except ``render_mode``."""

    view: str | tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]  # a name, or viewer and target positions
    size_px: tuple[int, int] | None  # width and height; None: the view's default
    camera: str | None  # a name; None: the first
    style: str
    samples: int
    own_beams: bool


def choose(view: Any, size: Any, camera: Any, style: Any = "bright", samples: Any = 4, own_beams: Any = True) -> Choice:
    """Check the keywords.

    Raises
    ------
    ValueError
        A keyword is invalid; the message names it, the expected value and the value given.
    """
    if isinstance(view, str):
        if view not in NAMES:
            expected = ", ".join(map(repr, NAMES))
            raise ValueError(
                f"render_view: expected one of {expected} or two points, got {view!r}{did_you_mean(view, NAMES)}"
            )
    else:
        view = _place(view)
    if size is not None:
        pair = tuple(size) if isinstance(size, (Sequence, np.ndarray)) else ()
        if len(pair) != 2 or not all(_is_count(n) and 1 <= n <= _MAX_PX for n in pair):
            raise ValueError(f"render_size: expected (width, height) from 1 to {_MAX_PX} pixels, got {size!r}")
        size = (int(pair[0]), int(pair[1]))
    if camera is not None and view != "camera":
        raise ValueError(f"render_camera: expected None unless render_view='camera', got {camera!r}")
    if not isinstance(style, str) or style not in STYLES:
        expected, hint = ", ".join(map(repr, STYLES)), did_you_mean(style, STYLES) if isinstance(style, str) else ""
        raise ValueError(f"render_style: expected one of {expected}, got {style!r}{hint}")
    if not _is_count(samples) or samples not in SAMPLES:
        raise ValueError(f"render_samples: expected one of {', '.join(map(str, SAMPLES))}, got {samples!r}")
    for name, value, usual in (("style", style, "bright"), ("samples", samples, 4)):
        if value != usual and view in ("top", "camera"):
            raise ValueError(f"render_{name}: expected {usual!r} for render_view={view!r}, got {value!r}")
    if not isinstance(own_beams, (bool, np.bool_)):
        raise ValueError(f"render_beams: expected True or False, got {own_beams!r}")
    return Choice(view, size, camera, style, int(samples), bool(own_beams))


def _is_count(value: Any) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def _place(view: Any) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    try:
        points = np.asarray(view, float)
    except (TypeError, ValueError):
        points = np.zeros(0)
    if points.shape != (2, 3) or not np.isfinite(points).all() or (points[0] == points[1]).all():
        expected = f"one of {', '.join(map(repr, NAMES))}, or two points (x, y, z): the eye and the point to look at"
        raise ValueError(f"render_view: expected {expected}, got {view!r}")
    return points[0], points[1]
