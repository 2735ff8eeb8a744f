"""The page in headless Chromium: it plays, shows what was recorded, and hostile recordings do no harm.

These tests run where Chromium, Playwright and the built page are; elsewhere they are skipped.
"""

import base64
import gzip

import numpy as np
import pytest
from chromium import CHROMIUM, drawn, opened_tab, wait
from test_recordings import replaced_objects

import flockstep
from flockstep.recordings import Capture
from flockstep.viewer import page as pages

if CHROMIUM is None or not pages.is_built():
    pytest.skip("needs Chromium and the page of ./dev viewer", allow_module_level=True)

HTML = '<img src=x onerror="window.hacked=1">'


@pytest.fixture
def tab(browser):
    """A tab for files."""
    with opened_tab(browser) as tab:
        yield tab


def opened(tab, path, state="ready"):
    tab.goto(f"file://{path}")
    tab.wait_for_selector("body[data-state]", state="attached")
    assert tab.evaluate("document.body.dataset.state") == state, tab.evaluate("document.body.innerText")


def captured(steps, num_envs=1, seed=0, paths=(), **keywords):
    envs = flockstep.DroneVectorEnv(num_envs, **{"autoreset_mode": "disabled", **keywords})
    envs.action_space.seed(seed)
    envs.reset(seed=seed)
    capture = Capture(envs, paths=paths)
    capture.add()
    for _ in range(steps):
        actions = envs.action_space.sample()
        envs.step(actions)
        capture.add(actions)
    return capture.recording()


@pytest.fixture(scope="module")
def flight():
    camera = flockstep.CameraConfig(width_px=32, height_px=24, offset_m=(0.2, 0.0, 0.1))
    return captured(25, num_envs=2, drones_per_env=2, worlds="playground/train-1", camera=camera)


@pytest.fixture(scope="module")
def flight_page(flight, tmp_path_factory):
    path = tmp_path_factory.mktemp("flight") / "flight.html"
    flight.save(path, ghost=captured(40, seed=1, worlds="playground/train-1"))
    return path


def test_play_scrub_and_choose(tab, flight, flight_page):
    opened(tab, flight_page)
    assert tab.inner_text("#title") == flight.title
    tab.click("#play")
    wait(tab, "flockstep.page.choice.seconds > 0.3")
    tab.click("#play")
    assert not tab.evaluate("flockstep.page.isPlaying")
    drawn(tab, "const time = document.getElementById('time'); time.value = 1.7; time.dispatchEvent(new Event('input'))")
    assert tab.evaluate("flockstep.page.choice.seconds") == 1.7
    # Positions agree to float with what was recorded, also between two moments.
    for seconds, step, part in ((1.7, 17, 0), (1.75, 17, 0.5)):
        drawn(tab, f"flockstep.page.seek({seconds})")
        pose = tab.evaluate("[...flockstep.page.stage.pose()].slice(0, 3)")
        before, after = flight["position"][step, 0].astype(float), flight["position"][step + 1, 0].astype(float)
        np.testing.assert_allclose(pose, before + part * (after - before), atol=1e-6)
    right = "each.getBoundingClientRect().right > each.closest('section').getBoundingClientRect().right"
    assert tab.locator(".legend span").count() > 5
    assert tab.evaluate(f"[...document.querySelectorAll('.legend span')].filter(each => {right}).length") == 0
    tab.keyboard.press("n")
    assert tab.evaluate("flockstep.page.choice.drone") == 1
    tab.select_option("#env", "1")
    assert tab.evaluate("flockstep.page.choice.drone") == 2
    drawn(tab, "flockstep.page.seek(0)")
    np.testing.assert_allclose(tab.evaluate("[...flockstep.page.stage.pose()].slice(0, 3)"), flight["position"][0, 2])
    for key in ("End", "ArrowLeft", "ArrowRight", "Home", "2", "3", "4", "1", "b", "t", "r", "?"):
        tab.keyboard.press(key)
    assert tab.evaluate("document.getElementById('help').open")
    assert tab.evaluate("document.querySelectorAll('#help dt').length") > 8


def test_the_eye_is_the_camera_of_the_drone(tab, flight, flight_page):
    opened(tab, flight_page)
    drawn(tab, "flockstep.page.seek(2); flockstep.page.setMode('eye')")
    goal = [6.5, 7.5, 1.4]
    shown = tab.evaluate(
        "goal => { const c = flockstep.page.viewer.camera; c.updateMatrixWorld();"
        "const p = c.position.clone().set(...goal).project(c);"
        "return [p.x * c.aspect * Math.tan(c.fov * Math.PI / 360), p.y * Math.tan(c.fov * Math.PI / 360)]; }",
        goal,
    )
    position, (w, x, y, z) = flight["position"][20, 0].astype(float), flight["quat_wxyz"][20, 0].astype(float)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    forward, left, up = turn.T @ (np.array(goal) - position) - [0.2, 0, 0.1]
    np.testing.assert_allclose(shown, [-left / forward, up / forward], atol=1e-5)


def test_beams_that_turn_end_at_their_hits(tab, tmp_path):
    lidar = {"channels": 2, "beams": 30, "vfov_deg": 60, "waves": 3, "turn_deg": 137.5, "quat_wxyz": (0.96, 0, 0.28, 0)}
    envs = flockstep.DroneVectorEnv(1, worlds="playground/train-1", lidar=flockstep.LidarConfig(**lidar, max_range_m=9))
    envs.reset(seed=0)
    capture, points = Capture(envs), []
    for _ in range(4):
        envs.step(envs.action_space.sample())
        capture.add()
        points.append(envs.batch.lidar().points.reshape(-1, 3))
    capture.recording().save(tmp_path / "turned.html")
    opened(tab, tmp_path / "turned.html")
    beams = "flockstep.page.stage.parts[0].overlays.beams.geometry.attributes.position.array"
    for step, expected in enumerate(points):
        drawn(tab, f"flockstep.page.seek({step / 10 + 1e-4})")
        ends = np.reshape(tab.evaluate(f"[...{beams}.slice(0, {6 * 60})]"), (60, 2, 3))[:, 1]
        is_hit = np.isfinite(expected[:, 0])
        assert is_hit.sum() > 30
        np.testing.assert_allclose(ends[is_hit], expected[is_hit], atol=1e-3)


def test_two_flights_as_ghosts_and_side_by_side(tab, flight_page):
    opened(tab, flight_page)
    assert tab.evaluate("flockstep.flights.length") == 2
    drawn(tab, "flockstep.page.seek(1)")
    ghost = tab.evaluate("[...flockstep.page.stage.pose(1)].slice(0, 3)")
    recorded = "[...flockstep.flights[1].column('position').values.slice(30, 33)]"
    np.testing.assert_allclose(ghost, tab.evaluate(recorded))
    tab.keyboard.press("c")
    assert tab.evaluate("flockstep.page.choice.sideBySide")
    drawn(tab, "flockstep.page.seek(99)")
    header, second = (tab.locator(part).bounding_box() for part in ("header", "#label-b"))
    assert header["x"] + header["width"] < second["x"]
    assert tab.inner_text("#label-b") == "B: Navigation"
    assert tab.inner_text("#state").startswith("A: Navigation · drone 0 ")
    assert tab.inner_text("#state-b").startswith("B: Navigation: ")
    tab.keyboard.press("g")
    assert not tab.evaluate("flockstep.page.choice.sideBySide")
    assert len(tab.screenshot()) > 50_000  # an image of one colour would be small


def test_two_flights_have_their_names_ends_worlds_and_shadows(tab, tmp_path):
    flights = [captured(8, worlds=world, max_episode_steps=5) for world in ("playground/train-1", "arena/hall")]
    pages.write(tmp_path / "two.html", flights, ["first", HTML])
    opened(tab, tmp_path / "two.html")
    drawn(tab, "flockstep.page.seek(0.7)")
    ends = tab.locator("#episodes button").all_inner_texts()
    assert [text.split(": ")[:2] for text in ends] == [["● A", "first"], ["● B", HTML]]
    assert tab.inner_text("#state-b") == f"B: {HTML}: time at 0.5 s · in another world, arena/hall"
    assert not tab.evaluate("window.hacked")
    lit = "flockstep.page.stage.light.sun.target.position.x"
    alone = tab.evaluate(lit)
    tab.evaluate(
        """(() => {
            const {stage} = flockstep.page, draw = stage.drawPart;
            window.lit = [];
            stage.drawPart = (...part) => {
                window.lit.push(stage.light.sun.target.position.x);
                draw.apply(stage, part);
            };
        })()"""
    )
    tab.keyboard.press("c")
    wait(tab, "window.lit.length > 1")
    middles = tab.evaluate("flockstep.page.stage.parts.map(({world: {bounds}}) => (bounds.min.x + bounds.max.x) / 2)")
    assert middles[0] != middles[1]
    np.testing.assert_allclose(tab.evaluate("window.lit.slice(0, 2)"), middles)
    assert tab.evaluate(lit) == alone


def test_orbit_after_follow_looks_from_the_height_again(tab, flight_page):
    opened(tab, flight_page)
    distance = "flockstep.page.viewer.camera.position.distanceTo(flockstep.page.viewer.controls.target)"
    overview = tab.evaluate(distance)
    drawn(tab, "flockstep.page.setMode('follow')")
    assert tab.evaluate(distance) < overview / 2
    drawn(tab, "flockstep.page.setMode('orbit')")
    assert tab.evaluate(distance) == pytest.approx(overview)


@pytest.mark.parametrize("scene", ["playground/train-1", "indoor/office", "race/figure-8"])
def test_worlds_are_those_of_the_engine(tab, scene, tmp_path):
    captured(1, worlds=scene).save(tmp_path / "world.html")
    opened(tab, tmp_path / "world.html")
    low, high, area = tab.evaluate(
        """() => {
            let area = 0;
            const [low, high] = [[1e9, 1e9, 1e9], [-1e9, -1e9, -1e9]];
            const corner = (a, i) => [a[i], a[i + 1], a[i + 2]];
            for (const mesh of flockstep.page.stage.parts[0].world.group.children) {
                if (!mesh.isMesh || mesh.name == "marker" || mesh.material.side == 1) continue;
                const a = mesh.geometry.getAttribute("position").array;
                for (let i = 0; i < a.length; i += 9) {
                    const [p, q, r] = [corner(a, i), corner(a, i + 3), corner(a, i + 6)];
                    const [u, v] = [q.map((x, k) => x - p[k]), r.map((x, k) => x - p[k])];
                    const cross = [0, 1, 2].map(k => u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3]);
                    area += Math.hypot(...cross) / 2;
                    for (const c of [p, q, r]) for (let k = 0; k < 3; k++) {
                        low[k] = Math.min(low[k], c[k]);
                        high[k] = Math.max(high[k], c[k]);
                    }
                }
            }
            return [low, high, area];
        }"""
    )
    world = flockstep.scenes.load(scene)[0]
    mesh = world.mesh()
    a, b, c = mesh["vertices"][mesh["triangles"]].astype(float).transpose(1, 0, 2)
    np.testing.assert_allclose([low, high], world.bounds, atol=1e-5)
    assert area == pytest.approx(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2, rel=2e-3)


def test_html_in_names_stays_text(tab, tmp_path):
    world = flockstep.scenes.load("playground/train-1")[0].to_dict()
    world["name"] = HTML
    recording = captured(5, worlds=flockstep.World.from_dict(world))
    recording.title = HTML
    recording._contents.settings["reward_terms"] = [HTML] * len(recording.reward_terms)
    recording.save(tmp_path / "hostile.html")
    opened(tab, tmp_path / "hostile.html")
    assert tab.inner_text("#title") == HTML
    assert HTML.replace(" ", "\xa0") in tab.inner_text("#about")
    assert tab.evaluate("[window.hacked, document.images.length]") == [None, 0]
    tab.evaluate("setTimeout(() => { try { eval('1') } catch (error) { window.refused = error.name } })")
    wait(tab, "window.refused == 'EvalError'")


def test_poses_that_are_not_finite_are_not_drawn(tab, tmp_path):
    recording = captured(20, worlds="playground/train-1")
    arrays = recording._contents.arrays
    arrays["position"] = arrays["position"].copy()
    arrays["position"][5:9] = np.nan
    arrays["quat_wxyz"] = np.where(np.arange(21)[:, None, None] == 12, 0, arrays["quat_wxyz"])
    arrays["reward_terms"] = np.full_like(arrays["reward_terms"], np.inf)
    recording.save(tmp_path / "hostile.html")
    opened(tab, tmp_path / "hostile.html")
    for step, is_shown in ((4, True), (6, False), (12, False), (15, True)):
        drawn(tab, f"flockstep.page.seek({step / 10 + 1e-4})")
        pose = tab.evaluate("flockstep.page.stage.pose() && [...flockstep.page.stage.pose()]")
        assert (pose is not None) == is_shown
        assert ("no finite pose" in tab.inner_text("#state")) != is_shown
    assert tab.evaluate("flockstep.page.viewer.camera.position.toArray().every(Number.isFinite)")


def test_a_million_moments_open_and_play(tab, tmp_path):
    short = captured(9, worlds="playground/train-1")
    contents = short._contents
    kept = ("position", "quat_wxyz", "active", "world_index", "episode", "reward_terms", "actions")
    contents.arrays = {name: np.concatenate([contents.arrays[name]] * 100_000) for name in kept}
    contents.arrays["episode"] = contents.arrays["episode"] + np.arange(1_000_000)[:, None] // 1000
    contents.settings["scanners"] = []
    short.times_s = np.arange(1_000_000) / 10
    short.save(tmp_path / "long.html")
    opened(tab, tmp_path / "long.html")
    drawn(tab, "flockstep.page.seek(99_999)")
    assert tab.evaluate("flockstep.flights[0].stepAt(flockstep.page.choice.seconds)") == 999_990
    tab.click("#play")
    wait(tab, "flockstep.page.choice.seconds > 99_999.2 || !flockstep.page.isPlaying")


@pytest.mark.parametrize("damage", ["cut", "not gzip", "format", "counts", "none"])
def test_a_damaged_page_says_so(tab, damage, flight, tmp_path):
    text = pages.page([flight])
    before, after = text.split('<script type="application/gzip">')
    block, rest = after.split("</script>", 1)
    data = gzip.decompress(base64.b64decode(block))
    if damage == "cut":
        block = block[: len(block) // 2 // 4 * 4]
    elif damage == "not gzip":
        block = base64.b64encode(data).decode()
    elif damage == "format":
        block = base64.b64encode(gzip.compress(data.replace(b'"format": 3', b'"format": 9', 1))).decode()
    elif damage == "counts":
        block = base64.b64encode(gzip.compress(data.replace(b'"shape": [26,', b'"shape": [999999999,', 1))).decode()
    blocks = "" if damage == "none" else f'<script type="application/gzip">{block}</script>'
    path = tmp_path / "damaged.html"
    path.write_text(before + blocks + rest, encoding="utf-8")
    opened(tab, path, state="failed")
    assert tab.inner_text("#problem").startswith("This flight cannot be shown: ")


def test_a_swarm_is_drawn_by_few_calls(tab, tmp_path):
    captured(3, num_envs=300, worlds="playground/train-1").save(tmp_path / "swarm.html")
    opened(tab, tmp_path / "swarm.html")
    tab.select_option("#which", "world")
    drawn(tab, "flockstep.page.seek(0.2)")
    assert tab.evaluate("flockstep.page.stage.parts[0].drones.poses.size") == 300
    assert tab.evaluate("flockstep.page.stage.renderer.info.render.calls") < 40


def test_a_slot_shows_the_object_that_it_holds_at_each_moment(tab, tmp_path):
    replaced_objects().save(tmp_path / "flight.html")
    opened(tab, tmp_path / "flight.html")
    shown = """(([{group}, other]) => [
        group.visible && group.children[0].children.map(({material}) => material.color.getHexString()),
        other.group.visible,
    ])(flockstep.page.stage.parts[0].overlays.slots)"""
    for moment, colors in enumerate((["ff0000"], ["00ff00"], ["ff0000"], False, False)):
        drawn(tab, f"flockstep.page.seek({moment / 10 + 1e-4})")
        assert tab.evaluate(shown) == [colors, False]


def test_hull_cameras_and_planned_paths(tab, tmp_path):
    cameras = [
        flockstep.CameraConfig(name=name, width_px=16 * number, height_px=8, rate_hz=10)
        for number, name in ((1, "front"), (2, "down"))
    ]
    paths = [[(2, 2, 1), (3, 4, 2), (6, 4, 2)], [(1, 1, 1), (1, 1, 3)]]
    task = flockstep.HoverConfig()  # its drones have rotors
    recording = captured(4, num_envs=2, worlds="playground/train-1", camera=cameras, task=task, paths=paths)
    recording.save(tmp_path / "a.html")
    opened(tab, tmp_path / "a.html")

    wait(tab, "[...document.querySelectorAll('#images canvas')].map(image => image.width) == '16,32'")
    assert tab.locator("#images figcaption").all_inner_texts() == ["front", "down"]

    shown = "flockstep.page.stage.parts[0].overlays.paths.map(path => path.visible)"
    assert tab.evaluate(shown) == [True, False]
    segments = tab.evaluate(
        """['instanceStart', 'instanceEnd'].map(name => [0, 1].map(i => {
            const place = flockstep.page.stage.parts[0].overlays.paths[0].geometry.getAttribute(name);
            return [place.getX(i), place.getY(i), place.getZ(i)];
        }))"""
    )
    assert segments == [[list(point) for point in paths[0][:2]], [list(point) for point in paths[0][1:]]]
    drawn(tab, "flockstep.page.choose(1)")
    assert tab.evaluate(shown) == [False, True]
    tab.keyboard.press("l")
    drawn(tab, "flockstep.page.seek(0.02)")
    assert tab.evaluate(shown) == [False, False]

    places = """(() => {
        const drones = flockstep.page.stage.parts[0].drones;
        const corners = [...drones.body, ...drones.hull].filter(mesh => mesh.visible).flatMap(mesh => {
            const place = mesh.geometry.getAttribute('position');
            return Array.from({length: place.count}, (_, i) => [place.getX(i), place.getY(i), place.getZ(i)]);
        });
        return [corners, [...drones.blades, drones.discs].map(mesh => mesh.visible)];
    })()"""
    corners, turning = tab.evaluate(places)
    hull = np.asarray(flockstep.DroneVectorEnv(1, worlds="playground/train-1", task=task).batch.drone.hull)
    assert turning == [True, True, True]
    assert len(corners) > 10 * len(hull)
    tab.keyboard.press("m")
    drawn(tab, "flockstep.page.seek(0.04)")
    corners, turning = tab.evaluate(places)
    assert turning == [False, False, False]
    np.testing.assert_allclose(np.unique(np.round(corners, 5), axis=0), np.unique(np.round(hull, 5), axis=0), atol=2e-5)
