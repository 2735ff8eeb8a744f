"""Hexarotors and octorotors against closed forms and the equations in double precision, alone and beside quadrotors."""

import gymnasium
import numpy as np
import pytest
from clients import served
from conftest import placed
from messages import refused
from rigid_body import FULL, GRAVITY, MIDDLE, OPEN, Body, Start, batch_of, drone_of, frame, plain, rows_of
from scipy.optimize import minimize

import flockstep
from flockstep.client import ServerError
from flockstep.variations import vary

NAMES = ["f550", "naki"]
START = np.float32([[2, 4, 2], [2, 4.5, 2], [3, 2, 1], [6, 6, 3]])
every_frame = pytest.mark.parametrize("name", NAMES)
FIVE = {  # askew, with five rotors
    **{"position_m": [[0.1, 0.0, 0.01], [0.03, 0.1, 0], [-0.08, 0.06, 0], [-0.08, -0.06, 0.02], [0.03, -0.1, 0]]},
    **{"spin": ["ccw", "cw", "ccw", "cw", "ccw"]},
}
ALL = {
    **{"lag_up_s": 0.033, "lag_down_s": 0.05, "rotor_inertia_kgm2": 5e-6, "lift_n_per_mps2": 0.01},
    **{"drag_n_per_radps_mps": [1e-4, 1.2e-4, 5e-5], "linear_n_per_mps": [0.26, 0.3, 0.35]},
}
FRAMES = {**{name: frame(name, **ALL) for name in NAMES}, "five": frame("kingfisher", **ALL, **FIVE)}


def wrench(data, speed):
    """Total thrust and torque about x, y, z of rotors at these speeds, written out."""
    rotors, total = data["rotors"], np.zeros(4)
    for (x, y, _), spin, w in zip(rotors["position_m"], rotors["spin"], speed, strict=True):
        thrust = rotors["thrust_n"][2] * w**2
        total += [thrust, y * thrust, -x * thrust, (1 if spin == "cw" else -1) * rotors["torque_ratio_m"] * thrust]
    return total


def accelerations(data, speed, **fields):
    """Vertical and angular acceleration in the first tick of level drones at rest with these rotor speeds (N, R)."""
    batch = batch_of(data, len(speed), **fields)
    batch.set_pose(np.zeros((len(speed), 3)), None)
    batch.set_velocity(None, None, speed)
    batch.fly(speed, ticks=1)
    return batch.acceleration[:, 2] + GRAVITY, batch.angular_velocity * 500


@every_frame
def test_thrust_and_torque(name):
    """At hover speed the thrust is the weight, without torque; at any speeds it is the sum over the rotors."""
    data = plain(name)
    hover, count = flockstep.DroneModel.load(name).hover_speed_radps, len(data["rotors"]["spin"])
    rng = np.random.default_rng(0)
    speed = np.concatenate([np.full((1, count), hover), hover * rng.uniform(0.8, 1.2, (20, count))]).astype(np.float32)
    lift, turning = accelerations(data, speed)
    expected = np.array([wrench(data, row) for row in speed.astype(float)])
    np.testing.assert_allclose(expected[0], [data["mass_kg"] * GRAVITY, 0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(lift, expected[:, 0] / data["mass_kg"], rtol=1e-5)
    np.testing.assert_allclose(turning, expected[:, 1:] / data["inertia_kgm2"], rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("integrator", ["midpoint", "rk4"])
@pytest.mark.parametrize("name", FRAMES)
def test_flight_is_that_of_the_equations(name, integrator):
    data, drones = FRAMES[name], 5
    batch = batch_of(data, drones, physics_hz=1000.0, integrator=integrator)
    start = Start.random(drones, data, speed_mps=1.0, rates_radps=1.0)
    start.place(batch)
    count = batch.num_rotors
    assert batch.rotor_speed.shape == (drones, count) == (drones, len(data["rotors"]["spin"]))
    commands = start.speed.mean() * np.random.default_rng(2).uniform(0.8, 1.2, (30, drones, count)).astype(np.float32)
    expected = Body([data] * drones).fly(start.rows(), commands.astype(float), 0.01)[-1]
    for command in commands:
        batch.fly(command)
    np.testing.assert_allclose(rows_of(batch), expected, rtol=2e-4, atol=5e-4)


@every_frame
def test_mixer_has_the_least_sum_of_squares(name):
    """Rotor thrusts for a small change of thrust and torque, found by an optimiser."""
    data = plain(name)
    batch = batch_of(data, 1, control="body_rates", physics_hz=500.0, policy_hz=500.0)
    batch.set_pose([[0, 0, 0]], None)
    batch.fly([[GRAVITY * 1.1, 0.05, -0.03, 0.02]], ticks=1)
    found = data["rotors"]["thrust_n"][2] * batch.rotor_speed[0].astype(float) ** 2
    target = wrench(data, batch.rotor_speed[0].astype(float))
    columns = np.array([wrench(data, np.sqrt(row / data["rotors"]["thrust_n"][2])) for row in np.eye(len(found))]).T
    scale = np.array([1, 10, 10, 100])[:, None]
    best = minimize(
        lambda f: (f**2).sum(),
        np.full(len(found), found.mean()),
        method="SLSQP",
        constraints={"type": "eq", "fun": lambda f: (scale * columns) @ f - scale[:, 0] * target},
        options={"ftol": 1e-14},
    )
    assert target[0] == pytest.approx(1.1 * data["mass_kg"] * GRAVITY, rel=1e-5)
    np.testing.assert_allclose(found, best.x, rtol=1e-4)


@every_frame
def test_yaw_is_mirrored(name):
    """Yaw to the left and to the right: the mirror image exchanges the rotors that turn either way."""
    batch = batch_of(frame(name), 2, control="body_rates")
    batch.set_pose(np.zeros((2, 3)), None)
    for _ in range(50):
        batch.fly([[GRAVITY, 0, 0, 1.0], [GRAVITY, 0, 0, -1.0]])
    assert batch.angular_velocity[0, 2] > 0.5
    np.testing.assert_allclose(batch.angular_velocity[0], -batch.angular_velocity[1], atol=1e-4)
    np.testing.assert_allclose(batch.position[0, :2], 0, atol=1e-3)
    hubs, spins = np.array(frame(name)["rotors"]["position_m"]), frame(name)["rotors"]["spin"]
    for rotor, (hub, spin) in enumerate(zip(hubs, spins, strict=True)):
        (mirrored,) = (k for k, other in enumerate(hubs) if np.allclose(other, hub * [1, -1, 1]) and spins[k] != spin)
        assert batch.rotor_speed[0, rotor] == pytest.approx(batch.rotor_speed[1, mirrored], rel=1e-4)


ASKED = [[1e3, 0, 0, 0], [-1e3, 0, 0, 0], [9.81, 50, 0, 0], [9.81, 0, -50, 50], [30, 9, 9, 9]]


@every_frame
@pytest.mark.parametrize("asked", ASKED)
def test_a_saturated_mixer_keeps_roll_and_pitch_first(name, asked):
    """Yaw is reduced first, then thrust is shifted: the torques about x and y keep their ratio."""
    data = plain(name, min_speed_radps=100.0)
    batch = batch_of(data, 1, control="body_rates", max_rate_dps=5000.0, max_yaw_rate_dps=5000.0)
    batch.set_pose([[0, 0, 0]], None)
    batch.fly([asked], ticks=1)
    speed = batch.rotor_speed[0].astype(float)
    low, high = 100.0, data["rotors"]["max_speed_radps"]
    assert ((speed >= low * (1 - 1e-6)) & (speed <= high * (1 + 1e-6))).all()
    thrust, x, y, _ = wrench(data, speed)
    if asked[1] or asked[2]:
        asked_x, asked_y = np.array(asked[1:3]) * data["inertia_kgm2"][:2]
        assert x * asked_y == pytest.approx(y * asked_x, abs=1e-4 * abs(x + y) * abs(asked_x + asked_y))
        assert x * asked_x + y * asked_y > 0
    else:
        limit = high if asked[0] > 0 else low
        assert thrust == pytest.approx(len(speed) * data["rotors"]["thrust_n"][2] * limit**2, rel=1e-5)


def test_drones_of_many_rotors_fly_on_without_one():
    """With position control and fast gains, though the controller knows nothing of it; a quadrotor falls."""
    fast = flockstep.ControllerConfig(rate_gain_per_s=40.0, attitude_gain_per_s=13.0)
    farthest = {}
    for name in ("f450", "f550", "naki"):
        laws = vary(dead_rotor=2.0, dead_from_s=1.0)
        batch = batch_of(frame(name), control="position", variations=laws, controller=fast)
        batch.set_pose([[0, 0, 50]], None)
        farthest[name] = 0.0
        for _ in range(600):
            batch.fly([[0, 0, 50, 0]])
            farthest[name] = max(farthest[name], float(np.linalg.norm(batch.position[0] - [0, 0, 50])))
        assert batch.rotor_speed[0, 2] < 1e-3
        assert batch.rotor_speed[0, 0] > 10
    assert farthest["f550"] < 0.6
    assert farthest["naki"] < 0.3
    assert farthest["f450"] > 20


def mixed(count, control, **fields):
    """Drones of three airframes, drawn by their seeds, in flight."""
    airframes = ["kingfisher", "naki", "f550"]
    batch = batch_of(FULL, count, control=control, airframes=airframes, **fields)
    batch.set_pose(np.zeros((count, 3)), None)
    return batch, batch.params[:, flockstep.parameter_names.index("airframe")].astype(int)


def commands_of(control, size, count=24):
    middle = np.resize({"rotor_speeds": [400.0], "rotor_thrusts": [3.0]}.get(control, MIDDLE[control]), size)
    return (middle * np.random.default_rng(1).uniform(0.8, 1.2, (10, count, size))).astype(np.float32)


@pytest.mark.parametrize("control", MIDDLE)
def test_mixed_batches(control):
    """Each drone flies as alone, with any number of threads; absent rotors are 0, and commands for them are ignored."""
    count = 24
    size = 8 if control.startswith("rotor") else 4
    batch, rows = mixed(count, control, num_threads=3, block_size=5)
    other, _ = mixed(count, control)
    assert set(rows) == {0, 1, 2}
    assert batch.num_rotors == 8
    rotors = np.array([4, 8, 6])[rows]
    absent = np.arange(8) >= rotors[:, None]
    commands = commands_of(control, size)
    for step, told in enumerate(commands):
        batch.fly(told)
        if step == 5:
            other.restore(batch.snapshot())
        elif step > 5:
            other.fly(np.where(absent, 7.0, told) if size == 8 else told)
        assert not batch.rotor_speed[absent].any()
    assert batch.rotor_speed[~absent].all()
    np.testing.assert_array_equal(rows_of(other), rows_of(batch))
    for row, name in enumerate(("kingfisher", "naki", "f550")):
        drones = np.flatnonzero(rows == row)
        alone = batch_of(frame(name), len(drones), control=control, integrator="midpoint" if size == 4 else "automatic")
        alone.set_pose(np.zeros((len(drones), 3)), None)
        for told in commands:
            alone.fly(told[drones, : alone.num_rotors] if size == 8 else told[drones])
        width = 13 + alone.num_rotors
        np.testing.assert_array_equal(rows_of(batch)[drones, :width], rows_of(alone))


def test_absent_rotors_stay_absent():
    batch, rows = mixed(12, "velocity")
    batch.set_velocity(None, None, np.full((12, 8), 200.0))
    rotors = np.array([4, 8, 6])[rows]
    np.testing.assert_array_equal(batch.rotor_speed, np.where(np.arange(8) < rotors[:, None], 200.0, 0.0))
    params = batch.params.copy()
    params[:, flockstep.parameter_names.index("airframe")] = 0
    batch.set_params(params)
    assert not batch.rotor_speed[:, 4:].any()


def test_single_rotors_lose_thrust():
    share = np.array([0.9, 1.0, 1.05, 0.8, 0.95, 0.7])
    laws = vary(**{f"rotor_thrust_scale[{k}]": float(value) for k, value in enumerate(share)})
    speed = np.full((1, 6), 500.0)
    lift, turning = accelerations(plain("f550"), speed, variations=laws)
    expected = wrench(plain("f550"), 500.0 * np.sqrt(share))
    assert lift[0] == pytest.approx(expected[0] / 2.0, rel=1e-5)
    np.testing.assert_allclose(turning[0, :2], expected[1:3] / plain("f550")["inertia_kgm2"][:2], rtol=1e-4)


def test_rotors_that_no_drone_has_are_not_drawn():
    whole = batch_of(FULL, 8, variations=vary(rotor_thrust_scale=(0.9, 1.1)))
    first = flockstep.parameter_names.index("rotor_thrust_scale[0]")
    scales = whole.params[:, first : first + 8]
    assert len(set(scales[:, :4].ravel())) == 32
    assert (scales[:, 4:] == 1).all()
    several = batch_of(frame("naki"), 8, variations=vary(rotor_thrust_scale=(0.9, 1.1)))
    drawn = several.params[:, first : first + 8]
    assert len(set(drawn.ravel())) == 64
    np.testing.assert_array_equal(drawn[:, :4], scales[:, :4])


def test_a_battery_lasts_as_long():
    """Hovering empties a battery in its life, whatever the number of rotors."""
    used = []
    for name in ("f450", "f550", "naki"):
        batch = batch_of(plain(name), variations=vary(battery_life_s=100.0, battery_fall=0.001))
        batch.set_pose([[0, 0, 50]], None)
        hover = np.full((1, batch.num_rotors), batch.drone.hover_speed_radps)
        for _ in range(100):
            batch.fly(hover)
        used.append(float(batch.battery[0]))
    np.testing.assert_allclose(used, 0.01, rtol=1e-2)


def test_commands_may_be_late():
    batches = [
        batch_of(plain("f550"), control="rotor_speeds", variations=laws) for laws in ([], vary(action_delay_s=0.02))
    ]
    commands = np.random.default_rng(3).uniform(400, 700, (10, 1, 6))
    seen = []
    for batch, after in zip(batches, (0, 2), strict=True):
        batch.set_pose([[0, 0, 50]], None)
        for told in commands[: 10 - 2 + after] if after == 0 else commands:
            batch.fly(told)
        seen.append(batch.rotor_speed[0].copy())
    np.testing.assert_allclose(seen[1], seen[0], rtol=1e-6)
    np.testing.assert_allclose(seen[0], commands[7, 0], rtol=1e-6)


@every_frame
@pytest.mark.parametrize("control", ["rotor_thrusts", "rotor_speeds", "body_rates", "position"])
def test_hover_and_track(name, control):
    """An action of 0 hovers; observations hold the speed of each rotor."""
    count = flockstep.DroneModel.load(name).num_rotors
    for task, numbers in (("Hover", 12), ("Track", 26)):
        starts = {"start_offset_m": 0, "start_tilt_deg": 0, "start_speed_mps": 0, "start_rate_dps": 0}
        still = {"task": flockstep.HoverConfig(**starts)} if task == "Hover" else {}
        envs = gymnasium.make_vec(f"flockstep/{task}-v0", 20, drone=name, control=control, **still)
        assert envs.single_action_space.shape == ((count if control.startswith("rotor") else 4),)
        observation, _ = envs.reset(seed=0)
        assert observation.shape == (20, numbers + count)
        levels = observation[:, 12 : 12 + count] if task == "Hover" else observation[:, -2 - count : -2]
        np.testing.assert_allclose(levels, 0, atol=1e-5)
        np.testing.assert_array_equal(levels, envs.unwrapped.batch.terms.rotor_levels())
        before = envs.unwrapped.batch.position.copy()
        for _ in range(10):
            observation, reward, *_ = envs.step(np.zeros(envs.action_space.shape, np.float32))
        if task == "Hover":
            np.testing.assert_allclose(envs.unwrapped.batch.position, before, atol=2e-3)
        assert np.isfinite(reward).all()
        actions = np.random.default_rng(0).uniform(-1, 1, envs.action_space.shape).astype(np.float32)
        command = envs.unwrapped.batch.terms.command(actions)
        assert command.shape == envs.action_space.shape
        envs.step(actions)
        envs.close()


@pytest.mark.parametrize("control", ["body_rates", "rotor_thrusts"])
def test_only_quadrotors_have_derivatives(control):
    envs = gymnasium.make_vec("flockstep/Hover-v0", 8, drone="f550", control=control)
    with refused(ValueError, "drone", "quadrotors", 6):
        flockstep.learning.APG("MlpPolicy", envs, seed=0)
    envs.close()


def test_tasks_in_mixed_batches():
    """Actions of absent rotors neither cost nor show."""
    made = [
        gymnasium.make_vec("flockstep/Hover-v0", 20, drone="f550", airframes=["f450", "f550"], num_threads=threads)
        for threads in (1, 2)
    ]
    names = flockstep.parameter_names.index("airframe")
    for envs in made:
        envs.reset(seed=0)
    absent = (made[0].unwrapped.batch.params[:, names].astype(int) == 0)[:, None] & (np.arange(6) >= 4)
    assert 0 < absent.sum() < 40
    rng = np.random.default_rng(0)
    for _ in range(20):
        actions = rng.uniform(-0.3, 0.3, (20, 6)).astype(np.float32)
        first = made[0].step(actions)
        second = made[1].step(np.where(absent, -1, actions).astype(np.float32))
        np.testing.assert_array_equal(first[0], second[0])
        np.testing.assert_array_equal(first[1], second[1])
        assert not first[0][:, 12:][absent].any()
    for envs in made:
        envs.close()


@pytest.mark.parametrize(
    ("count", "said"),
    [(3, ("drone", "position_m", 4, 8, 3)), (9, ("drone", "position_m", 4, 8, 9)), (0, ("drone", 4, 8, 0))],
)
def test_other_numbers_of_rotors_are_refused(count, said):
    data = frame("f550")
    data["rotors"]["position_m"] = [[np.cos(k), np.sin(k), 0] for k in range(count)]
    data["rotors"]["spin"] = ["cw", "ccw", "cw", "ccw", "cw", "ccw", "cw", "ccw", "cw"][:count]
    with refused(ValueError, *said):
        flockstep.DroneModel.from_dict(data)


def test_wrong_input_is_refused():
    data = frame("f550")
    data["rotors"]["spin"] = data["rotors"]["spin"][:4]
    with refused(ValueError, "drone", "rotors spin", 6, 4):
        flockstep.DroneModel.from_dict(data)
    same = frame("f550")
    same["rotors"]["spin"] = ["cw"] * 6
    with refused(ValueError, "drone", "axis"):
        flockstep.DroneModel.from_dict(same)
    batch = batch_of(frame("f550"), 2)
    with refused(ValueError, "command", (2, 6), (2, 4)):
        batch.fly(np.zeros((2, 4)))
    with refused(ValueError, "command", (2, 4), (2, 6)):
        batch.fly(np.zeros((2, 6)), control="velocity")
    with refused(ValueError, "rotor_speed", (2, 6), (2, 4)):
        batch.set_velocity(None, None, np.zeros((2, 4)))
    with refused(ValueError, "rotor_speed (row 1)", -1):
        batch.set_velocity(None, None, [[0] * 6, [0, 0, 0, 0, 0, -1]])
    with refused(ValueError, "command (row 1)", "nan"):
        batch.fly([[500] * 6, [500, 500, 500, 500, 500, np.nan]])
    with refused(ValueError, "variations", "dead_rotor", 6, 6.5):
        batch_of(frame("f550"), variations=vary(dead_rotor=6.5))
    with refused(ValueError, "variations.parameter", "rotor_thrust_scale[6]", 6):
        batch_of(frame("f550"), variations=vary(**{"rotor_thrust_scale[6]": 0.9}))
    other = flockstep.Batch([OPEN], 2, drone=drone_of(frame("x500")), dynamics=batch.dynamics)
    with refused(ValueError, "snapshot"):
        other.restore(batch.snapshot())


@every_frame
def test_files_scale_and_come_back(name):
    drone = flockstep.DroneModel.load(name)
    assert flockstep.DroneModel.from_dict(drone.to_dict()) == drone
    small = drone.scaled(size=0.5, mass=0.125)
    assert small.num_rotors == drone.num_rotors
    assert small.thrust_to_weight == pytest.approx(drone.thrust_to_weight)
    weak = flockstep.DroneModel.from_dict({"flockstep_drone": 1, "like": name, "rotors": {"max_thrust_n": 12.0}})
    assert weak.thrust_to_weight == pytest.approx(12.0 * drone.num_rotors / (drone.mass_kg * GRAVITY))
    mesh = flockstep.DroneMesh.quadrotor(drone)
    assert len(mesh.triangles) > 100 * drone.num_rotors


def test_flying_by_six_rotors(room, connect):
    dynamics = flockstep.DynamicsConfig(motion="rotors", control="rotor_speeds")
    batches = [placed([room], START, drone="f550", dynamics=dynamics) for _ in range(2)]
    speeds = np.float32([[500, 520, 540, 560, 550, 530]] * 4)

    def check():
        np.testing.assert_array_equal(batches[0].position, batches[1].position)
        np.testing.assert_array_equal(client.get_arrays(["rotor_speed"])["rotor_speed"], batches[1].rotor_speed)

    with served(batches[0], connect) as client:
        assert (client.info.control, client.info.num_rotors) == ("rotor_speeds", 6)
        client.fly(speeds, ticks=50)
        batches[1].fly(speeds, 50)
        check()
        client.set_command(speeds)
        client.drone(2).set_command(speeds[0] + 10)
        client.step()
        speeds[2] += 10
        batches[1].fly(speeds)
        check()
        level = np.float32([[1, 0, 0, 0]] * 4)
        client.set_command(level, control="velocity")
        client.step()
        batches[1].fly(level, control="velocity")
        check()
        for bad in (speeds[:, :4], speeds[:2]):
            with refused(ServerError, "command", (4, 6), bad.shape):
                client.fly(bad)
        with refused(ServerError, "command", (1, 6), (1, 4)):
            client.drone(0).set_command(level[0], control="rotor_thrusts")
