"""The page of the live view in headless Chromium: it watches, pauses, scrubs back and flies."""

import argparse
import threading

import numpy as np
import pytest
from chromium import CHROMIUM, drawn, opened_tab, wait, wait_until

import flockstep
from flockstep.viewer import fly, page

if CHROMIUM is None or not page.is_built():
    pytest.skip("needs Chromium and the page of ./dev viewer", allow_module_level=True)

FLOWN = "flockstep.page.flight"
POSE = "[...flockstep.page.stage.pose()].slice(0, 3)"


@pytest.fixture
def tab(browser):
    """A tab for the view on this machine."""
    with opened_tab(browser, "http://127.0.0.1:") as tab:
        yield tab


class Program:
    """Runs something with envs in another thread, and a view of them."""

    def __init__(self, envs, run, **keywords):
        self.envs, self.run, self.over = envs, run, threading.Event()
        self.live = flockstep.view(envs, browser=False, **keywords)
        self._thread = threading.Thread(target=self._go, daemon=True)

    def _go(self):
        while not self.over.wait(0.01):  # leaves the browser some of the CPU
            self.run()

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.live.close()
        self._thread.join()


@pytest.fixture
def flying():
    """A program that flies eight envs, with a camera, at random."""
    camera = flockstep.CameraConfig(width_px=16, height_px=12)
    envs = flockstep.DroneVectorEnv(8, worlds="train", num_threads=1, camera=camera)
    envs.reset(seed=0)
    envs.action_space.seed(0)
    with Program(envs, lambda: envs.step(envs.action_space.sample())) as program:
        yield program


def opened(tab, program):
    tab.goto(program.live.address)
    tab.wait_for_selector("body[data-state=ready]", state="attached")


def test_watch_choose_pause_step_and_scrub(tab, flying):
    opened(tab, flying)
    wait(tab, f"{FLOWN}.steps > 10")
    tab.fill("#watched", "3")
    tab.press("#watched", "Enter")
    wait(tab, f"{FLOWN}.worlds.length === 2 && {FLOWN}.steps > 5")
    tab.click("text=Pause")
    tab.wait_for_selector("text=Resume")
    batch = flying.envs.batch
    wait_until(tab, lambda: flying.live._changed._waiters)  # the program stands still
    wait(tab, f"Math.abs({FLOWN}.column('position').values.at(-1) - {batch.position[3, 2]}) < 1e-6")
    drawn(tab, "flockstep.page.invalidate()")
    np.testing.assert_allclose(tab.evaluate(POSE), batch.position[3], atol=1e-6)
    steps, moments = batch.steps.copy(), tab.evaluate(f"{FLOWN}.steps")
    tab.click("text=Step")
    wait(tab, f"{FLOWN}.steps === {moments} + 1")
    assert (batch.steps != steps).all()
    wait(tab, f"Math.abs({POSE}[0] - {batch.position[3, 0]}) < 1e-6")
    first = tab.evaluate(f"[...{FLOWN}.column('position').values.subarray(0, 3)]")
    drawn(tab, "flockstep.page.seek(0)")
    np.testing.assert_allclose(tab.evaluate(POSE), first, atol=1e-6)
    tab.click("text=Resume")  # the program goes on; the page stays where it is
    tab.wait_for_selector("text=Pause")
    wait(tab, f"{FLOWN}.steps > {moments} + 5")
    assert tab.evaluate("flockstep.page.choice.seconds") == 0
    tab.keyboard.press("Escape")
    tab.locator("#view").focus()
    tab.keyboard.press("End")
    wait(tab, f"flockstep.page.choice.seconds === {FLOWN}.seconds && {FLOWN}.seconds > 1")


def test_a_pause_ends_with_the_page(tab, flying):
    opened(tab, flying)
    tab.click("text=Pause")
    tab.wait_for_selector("text=Resume")
    assert flying.live._is_paused
    tab.goto("about:blank")
    steps = flying.envs.batch.steps.sum()
    wait_until(tab, lambda: flying.envs.batch.steps.sum() != steps)
    assert not flying.live.is_watched


def test_old_moments_are_forgotten(tab, flying):
    opened(tab, flying)
    wait(tab, f"{FLOWN}.steps > 20")
    flying.live.close()
    wait(tab, "document.getElementById('watch').innerText.includes('The program has ended')")
    kept = tab.evaluate(
        f"""(() => {{
          const flight = {FLOWN}, last = [...flight.column("position").values.slice(-3)];
          const times = [...flight.column("time_s").values], image = flight.column("camera.front.image").values;
          const newest = image[flight.steps - 1], jpeg = [...flight.jpeg(flight.cameras[0], newest)];
          const before = flight.steps;
          flight.mostMoments = 8;
          const gone = flight.forget();
          return [before, flight.steps, gone, times[before - 8], flight.timeAt(0), last,
            [...flight.column("position").values.slice(-3)], jpeg, [...flight.jpeg(flight.cameras[0], newest)]];
        }})()"""
    )
    before, steps, gone, began, first, last, still, jpeg, same = kept
    assert before > steps == 8
    assert (gone, first) == (began, 0)
    assert last == still
    assert jpeg == same
    drawn(tab, "flockstep.page.seek(0)")


def test_a_gamepad_flies_the_drone_up_and_keys_turn_it(tab):
    arguments = argparse.Namespace(world="arena/hall", drone=None, control="heading_velocity", ghost=None, through=None)
    envs = fly.envs_for(arguments)
    with Program(envs, lambda: fly.fly(envs, envs._live, "heading_velocity"), flies=True) as program:
        tab.add_init_script(
            "window.axes = [0, 0, 0, 0]; navigator.getGamepads = () => [null, {connected: true, axes: window.axes}]"
        )
        opened(tab, program)
        wait(tab, f"{FLOWN}.steps > 2")
        tab.evaluate("window.axes[1] = -1")
        wait_until(tab, lambda: envs.batch.position[0, 2] > 3)
        tab.evaluate("window.axes[1] = 0.03")  # in the dead zone
        tab.keyboard.down("d")
        wait_until(tab, lambda: envs.batch.angular_velocity[0, 2] < -0.5)  # to the right
        tab.keyboard.up("d")
        assert program.live.is_watched
        shown = tab.evaluate("[...document.querySelectorAll('#help dt')].map(term => term.textContent)")
        assert shown[:5] == ["W S", "A D", "↑ ↓", "← →", "R"]
        assert len(set(shown) - {""}) == len([term for term in shown if term])  # no key stands for two things
        assert "W A S D Q E" not in shown
        wait(tab, f"{FLOWN}.cameras.length === 1 && {FLOWN}.lidars.length === 1")


def test_drones_have_the_names_that_the_program_gives(tab):
    envs = flockstep.DroneVectorEnv(1, drones_per_env=2, worlds="train", num_threads=1)
    envs.reset(seed=0)
    with Program(envs, lambda: envs.step(envs.action_space.sample())) as program:
        program.live.names = ("you", "<b>ghost</b>")
        opened(tab, program)
        wait(tab, "[...document.getElementById('drone').options].map(each => each.text).join() === 'you,<b>ghost</b>'")
        wait(tab, "document.getElementById('state').textContent.startsWith('you ·')")


def test_pages_of_others_may_not_connect(browser, flying):
    tab = browser.new_page()
    assert tab.goto(flying.live.address.split("?")[0]).status == 403
    tab.route("http://other.test/", lambda route: route.fulfill(body="<p>other", content_type="text/html"))
    tab.goto("http://other.test/")
    connecting = (
        "address => new Promise(done => { const socket = new WebSocket(address);"
        "socket.onclose = ({code}) => done(code); socket.onopen = () => done('open'); })"
    )
    assert tab.evaluate(connecting, flying.live.address.replace("http", "ws").replace("/?", "/live?")) == 1006
    tab.close()
    assert not flying.live.is_watched
