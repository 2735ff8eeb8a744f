"""Headless Chromium for tests of pages."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

CHROMIUM = shutil.which("chromium")
TIME_LIMIT_MS = 240_000  # on a busy machine
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # OpenGL without a GPU


@contextmanager
def opened_tab(browser: Any, allowed: str = "file:") -> Iterator[Any]:
    """A tab; at its end no script may have failed and nothing may have been asked for elsewhere."""
    tab = browser.new_page(viewport={"width": 800, "height": 600})
    tab.set_default_timeout(TIME_LIMIT_MS)
    troubles = []
    tab.on("console", lambda message: troubles.append(message.text) if message.type in ("error", "warning") else None)
    tab.on("pageerror", lambda error: troubles.append(str(error)))
    tab.on("dialog", lambda dialog: troubles.append(dialog.message))
    own = (allowed, "blob:", "data:", "about:")
    tab.on("request", lambda request: None if request.url.startswith(own) else troubles.append(request.url))
    yield tab
    tab.close()
    harmless = ("GPU stall", "GL Driver Message", "swiftshader", "SwiftShader")
    assert not [trouble for trouble in troubles if not any(word in trouble for word in harmless)]


def wait(tab: Any, condition: str) -> None:
    """Wait for a condition; Playwright's own function needs eval, which the page forbids."""
    wait_until(tab, lambda: tab.evaluate(condition), condition)


def wait_until(tab: Any, holds: Callable[[], Any], what: str = "") -> None:
    """Wait until something holds, while the tab goes on."""
    end = time.monotonic() + TIME_LIMIT_MS / 1000
    while not holds():
        assert time.monotonic() < end, what
        tab.wait_for_timeout(50)


def drawn(tab: Any, code: str) -> None:
    """Run code, and wait until the page has drawn again."""
    before = tab.evaluate(f"(() => {{ {code}; return flockstep.page.drawn }})()")
    wait(tab, f"flockstep.page.drawn > {before}")
