"""The page that shows flights in a browser, recorded or live."""

from flockstep.viewer.live import LiveView, view
from flockstep.viewer.page import show

__all__ = ["LiveView", "show", "view"]
