"""The page of a race in headless Chromium: gates and laps, and a flight against the recorded drone without a server."""

import numpy as np
import pytest
from chromium import CHROMIUM, drawn, opened_tab, wait

import flockstep
from flockstep.viewer import page

if CHROMIUM is None or not page.is_built():
    pytest.skip("needs Chromium and the page of ./dev viewer", allow_module_level=True)

#: A gamepad in the hands of a pilot who flies to the next gate, slowly.
PILOT = """
navigator.getGamepads = () => {
    const {model, world, gate} = window.flockstep?.solo ?? {};
    if (!model) return [];
    const {position, velocity, turn} = model;
    const {center: [x, y, z], quat_wxyz: [qw, qx, qy, qz]} = world.race_gates[gate];
    const ahead = position.clone().set(1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy + qw * qz), 2 * (qx * qz - qw * qy));
    const way = position.clone().set(x, y, z).sub(position);
    const before = way.dot(ahead);
    way.addScaledVector(ahead, before > 0 ? 0.5 - 0.6 * before : -2).setLength(2.5);
    const force = way.sub(velocity).multiplyScalar(2).clampLength(0, 5);
    force.z += 9.81;
    force.applyQuaternion(turn.clone().conjugate());
    const [throttle, pitch, roll] = [(force.z - 9.81) / 29.43, force.x / 18, -force.y / 18];
    return [{connected: true, axes: [0, -throttle, roll, -pitch].map(each => Math.max(Math.min(each, 1), -1))}];
};
"""


@pytest.fixture
def tab(browser):
    """A tab for files."""
    with opened_tab(browser) as tab:
        yield tab


@pytest.fixture(scope="module")
def race(tmp_path_factory):
    """A page of a recorded lap, and its recording."""
    path = tmp_path_factory.mktemp("race") / "race.html"
    envs = flockstep.DroneVectorEnv(1, task=flockstep.RaceConfig(start="gate", laps=1), autoreset_mode="disabled")
    policy, capture = flockstep.policies.load("race"), flockstep.recordings.Capture(envs)
    observation, _ = envs.reset(seed=0)
    capture.add()
    while not envs.batch.terminated[0]:
        actions = policy.predict(observation, deterministic=True)[0]
        observation, *_ = envs.step(actions)
        capture.add(actions)
    recording = capture.recording()
    assert recording.ends[0].success
    recording.save(path)
    return path, recording


def opened(tab, path, address=""):
    tab.goto(f"file://{path}{address}")
    tab.wait_for_selector("body[data-state=ready]", state="attached")


def followed(tab, link):
    """Follow a link, which loads the page again, and return the number of its flights."""
    with tab.expect_event("load"):
        tab.click(f"text={link}")
    tab.wait_for_selector("body[data-state=ready]", state="attached")
    return tab.evaluate("flockstep.flights.length")


def test_a_replay_shows_the_next_gate_and_the_laps(tab, race):
    path, recording = race
    opened(tab, path)
    openings = """flockstep.page.stage.parts[0].world.gates.group.children.map(({children}) => children[1].visible)"""
    for moment in (0, len(recording) // 2, len(recording) - 1):
        drawn(tab, f"flockstep.page.seek({recording.times_s[moment]} + 1e-4)")
        gate, passed = int(recording["gate.next"][moment, 0]), int(recording["gate.passed"][moment, 0])
        assert tab.evaluate(openings) == [i == gate for i in range(7)]
        said = tab.inner_text("#race").split(" · ")
        assert said[:2] == [f"Lap {1 + passed // 7}", f"gate {gate + 1} of 7"]
    lap_s = f"{recording.times_s[-1]:.1f} s"
    assert said[2:] == ["0.0 s", f"last {lap_s}", f"best {lap_s}"]
    tab.click("text=Markers")
    drawn(tab, "flockstep.page.invalidate()")
    assert not tab.evaluate("flockstep.page.stage.parts[0].world.gates.group.visible")


def test_a_gamepad_flies_through_a_gate_against_the_recorded_drone(tab, race):
    path, recording = race
    opened(tab, path)
    assert followed(tab, "Fly against this drone") == 2
    assert tab.evaluate("[flockstep.page.viewer.mode, flockstep.solo.ticks]") == ["follow", 0]  # it waits for a stick
    np.testing.assert_allclose(
        tab.evaluate("[...flockstep.page.stage.pose()].slice(0, 3)"), recording["position"][0, 0], atol=1e-6
    )
    first = int(recording["gate.next"][0, 0])
    tab.evaluate(PILOT)
    wait(tab, "flockstep.solo.passed === 1")
    wait(tab, f"document.getElementById('race').innerText.startsWith('Lap 1 · gate {(first + 1) % 7 + 1} of 7')")
    seconds = tab.evaluate("flockstep.page.choice.seconds")
    ghost = tab.evaluate("[...flockstep.page.stage.pose(1)].slice(0, 3)")  # at the same time since its start
    assert seconds > 0.5
    assert np.linalg.norm(recording["position"][:, 0] - ghost, axis=1).min() < 0.2
    assert tab.inner_text("#state-b").startswith("ghost: ")
    tab.evaluate("navigator.getGamepads = () => []")
    tab.keyboard.press("r")
    wait(tab, "flockstep.solo.passed === 0 && flockstep.page.choice.seconds === 0")
    assert followed(tab, "Watch the recorded flight") == 1


def test_walls_throw_the_drone_back(tab, race):
    opened(tab, race[0], "#fly")
    low, high = flockstep.World.load("race/figure-8").bounds
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1), (2, -1)):
        towards = [sign * 15.0 if i == axis else 0.0 for i in range(3)]
        flown = tab.evaluate(
            """towards => {
                const {solo} = flockstep;
                solo.begin();
                solo.model.position.set(0, 0, 4);
                solo.model.velocity.set(...towards);
                return Array.from({length: 100}, () => {
                    solo.fly(0.02, [0, 0, 0, 0]);
                    return [...solo.model.position, ...solo.model.velocity];
                });
            }""",
            towards,
        )
        places, speeds = np.split(np.array(flown), 2, axis=1)
        assert (places > low + 0.1).all()
        assert (places < high - 0.1).all()
        assert (sign * speeds[:, axis]).min() < -1


STICKS = (
    *[(0.2, 0.0, 0.0, 0.0)] * 25,
    *[(0.1, 0.1, 0.05, 0.3)] * 20,
    *[(-1.0, 0.0, 0.0, 0.0)] * 20,  # falls
    *[(0.4, -0.3, -0.2, -0.5)] * 15,
    *[(1.0, 1.0, -1.0, 1.0)] * 5,  # rotors at their limits
)


def test_the_model_of_the_page_flies_as_the_engine(tab, race):
    """Within 0.1 mm and 1 mm/s over 1.7 s of open-loop flight, after hovering for a second."""
    opened(tab, race[0], "#fly")
    flown = tab.evaluate(
        """sticks => {
            const {solo} = flockstep, {model} = solo;
            model.position.set(0, 0, 4);
            model.turn.identity();
            return [...Array(50).fill([0, 0, 0, 0]), ...sticks].map(each => {
                for (let tick = 0; tick < 10; tick++) model.fly(each);
                return [...model.position, ...model.velocity];
            });
        }""",
        STICKS,
    )
    drone = flockstep.DroneModel.load("racer5")
    world = flockstep.World.from_dict({"flockstep_scene": 1, "room": {"min": [-50, -50, -50], "max": [50, 50, 50]}})
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="body_rates")
    clock = flockstep.ClockConfig(policy_hz=50)
    batch = flockstep.Batch([world], 1, drone=drone, dynamics=dynamics, clock=clock)
    batch.set_pose(np.array([[0, 0, 4]], np.float32), np.array([[1, 0, 0, 0]], np.float32))
    rotors = drone.to_dict()["rotors"]
    least = 4 * rotors["thrust_n"][2] * rotors["min_speed_radps"] ** 2 / drone.to_dict()["mass_kg"]
    expected = []
    for throttle, roll, pitch, yaw in [*[(0.0, 0.0, 0.0, 0.0)] * 50, *STICKS]:
        thrust = 9.81 + throttle * (3 * 9.81 if throttle > 0 else 9.81 - least)
        rates = np.radians([600 * roll, 600 * pitch, -200 * yaw])
        batch.fly(np.array([[thrust, *rates]], np.float32))
        expected.append([*batch.position[0], *batch.velocity[0]])
    flown, expected = np.array(flown), np.array(expected)
    np.testing.assert_allclose(flown[:50, :3] - [0, 0, 4], 0, atol=1e-4)  # it hovers
    assert np.linalg.norm(np.diff(expected[:, 3:], axis=0), axis=1).max() > 0.5  # and is far from hovering then
    np.testing.assert_allclose(flown[:, :3], expected[:, :3], atol=1e-4)
    np.testing.assert_allclose(flown[:, 3:], expected[:, 3:], atol=1e-3)
