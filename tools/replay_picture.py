"""Takes the screenshot of the page that replays flights: ``python -m tools.replay_picture``.

It needs Chromium, Playwright and Pillow.
"""

from __future__ import annotations

import io
import shutil
import tempfile
from pathlib import Path

import flockstep

ROOT = Path(__file__).resolve().parents[1]
TARGET = ROOT / "docs" / "images" / "replay.jpg"
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 1280, "height": 760}
LIMIT_MS = 300_000


def main() -> None:
    """Fly, open the page, and take its picture."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as player:
        path = Path(folder) / "flight.html"
        flockstep.record(path, flockstep.policies.load("lidar"), worlds="playground/train-2", quiet=True)
        browser = player.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS, timeout=LIMIT_MS)
        tab = browser.new_page(viewport=SIZE)
        tab.goto(f"file://{path}", timeout=LIMIT_MS)
        tab.wait_for_selector("body[data-state=ready]", state="attached", timeout=LIMIT_MS)
        tab.evaluate("flockstep.page.seek(9)")
        tab.wait_for_timeout(3000)
        picture = tab.screenshot(timeout=LIMIT_MS)
        browser.close()
    Image.open(io.BytesIO(picture)).convert("RGB").save(TARGET, quality=82, optimize=True)
    print(TARGET, TARGET.stat().st_size, "bytes")


if __name__ == "__main__":
    main()
