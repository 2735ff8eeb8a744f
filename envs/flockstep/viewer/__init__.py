"""The page that replays flights in a browser."""

from flockstep.viewer.page import show

__all__ = ["show"]
