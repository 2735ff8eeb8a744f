"""Drones that differ: each flies as one that is made so, draws follow their laws, and commands come late."""

import numpy as np
import pytest
from rigid_body import GRAVITY, Body, batch_of, fly_for, frame, plain
from scipy import stats
from variation_rows import FIELDS, columns, constants, row

import flockstep
from flockstep import DroneParameters, vary
from flockstep.variations import choice, controllers, log_uniform, normal, presets, uniform


def as_made(data, **p):
    """The frame of a drone with these parameters: its mass as points, which are moved one by one."""
    p = {name: np.float64(np.float32(p.get(name, getattr(DroneParameters(), name)))) for name in FIELDS}
    inertia = np.array(data["inertia_kgm2"])
    reach = np.sqrt(0.5 * (inertia.sum() - 2 * inertia) / data["mass_kg"])  # six points, a pair on each axis
    points = np.concatenate([np.diag(reach), -np.diag(reach)]) * np.sqrt(3) * p["stretch"]
    masses = np.full(6, data["mass_kg"] / 6) * p["mass_scale"]
    points = np.vstack([points, [0, 0, -p["payload_below_m"]]])
    masses = np.append(masses, p["payload_kg"])
    middle = masses @ points / masses.sum()
    apart = points - middle
    rotors, drag = dict(data["rotors"]), dict(data["drag"])
    hubs = np.array(rotors["position_m"]) * p["arm_scale"] - p["center_m"] - middle
    rotors |= {
        "position_m": hubs.tolist(),
        "thrust_n": (np.array(rotors["thrust_n"]) * p["thrust_scale"]).tolist(),
        "torque_ratio_m": rotors["torque_ratio_m"] * p["torque_scale"],
        "lag_up_s": rotors["lag_up_s"] * p["lag_up_scale"],
        "lag_down_s": rotors["lag_down_s"] * p["lag_down_scale"],
        "drag_n_per_radps_mps": (np.array(rotors["drag_n_per_radps_mps"]) * p["rotor_drag_scale"]).tolist(),
        "lift_n_per_mps2": rotors["lift_n_per_mps2"] * p["rotor_drag_scale"],
    }
    for name in ("linear_n_per_mps", "quadratic_n_per_mps2"):
        drag[name] = (np.array(drag[name]) * p["body_drag_scale"]).tolist()
    return data | {
        "mass_kg": masses.sum(),
        "inertia_kgm2": (masses @ (apart**2).sum(1) - masses @ apart**2).tolist(),
        "rotors": rotors,
        "drag": drag,
    }


BODIES = {
    "mass": {"mass_scale": 1.3},
    "stretch": {"stretch": [1.2, 0.9, 1.1]},
    "center": {"center_m": [0.004, -0.003, 0.01]},
    "arm": {"arm_scale": 1.15},
    "payload": {"payload_kg": 0.2, "payload_below_m": 0.15},
    "thrust": {"thrust_scale": 0.9, "torque_scale": 1.4},
    "lag": {"lag_up_scale": 0.7, "lag_down_scale": 1.6},
    "drag": {"body_drag_scale": 1.7, "rotor_drag_scale": 0.5},
}
FULL = frame(drag_n_per_radps_mps=[1e-4, 1.2e-4, 5e-5], lift_n_per_mps2=1e-3)


def states_of(batch):
    arrays = (batch.position, batch.quat_wxyz, batch.velocity, batch.angular_velocity, batch.rotor_speed)
    return np.concatenate(arrays, axis=1).astype(float)


@pytest.mark.parametrize("name", [*BODIES, "all"])
def test_a_drone_flies_as_a_body_that_is_made_so(name):
    values = {k: v for each in BODIES.values() for k, v in each.items()} if name == "all" else BODIES[name]
    batch = batch_of(FULL, variations=constants(**values), physics_hz=1000.0)
    rng = np.random.default_rng(1)
    commands = rng.uniform(950, 1250, (30, 1, 4)).astype(np.float32)
    made = Body([as_made(FULL, **values)])
    batch.set_pose([[0, 0, 5]], None)
    start = states_of(batch)
    if name in ("mass", "payload", "thrust"):  # rotors begin at the hover speed of this drone
        lift = made.thrust(start[:, 13:]).sum()
        assert lift == pytest.approx(made.mass[0, 0] * GRAVITY, rel=1e-6)
    expected = made.fly(start, commands.astype(float), 0.01)[-1]
    for command in commands:
        batch.fly(command)
    np.testing.assert_allclose(states_of(batch), expected, rtol=2e-4, atol=2e-4)
    plain_batch = batch_of(FULL, physics_hz=1000.0)
    plain_batch.set_pose([[0, 0, 5]], None)
    for command in commands:
        plain_batch.fly(command)
    assert np.abs(states_of(plain_batch) - expected).max() > 0.01  # the parameters matter


@pytest.mark.parametrize(("name", "speed"), [("kingfisher", 1000.0), ("f550", 500.0)])
def test_single_rotors_lose_thrust(name, speed):
    body = Body([plain(name)])
    share = np.array([0.9, 1.0, 1.05, 0.8, 0.95, 0.7])[: len(body.hub[0])]
    laws = vary(**{f"rotor_thrust_scale[{k}]": float(value) for k, value in enumerate(share)})
    batch = batch_of(plain(name), variations=laws)
    batch.set_pose([[0, 0, 5]], None)
    batch.fly(np.full((1, len(share)), speed), ticks=1)
    thrust = body.thrust(np.full((1, len(share)), speed))[0] * share
    assert batch.acceleration[0, 2] == pytest.approx(thrust.sum() / body.mass[0, 0] - GRAVITY, rel=1e-5)
    turning = np.cross(body.hub[0], np.outer(thrust, [0, 0, 1])).sum(0) / body.inertia[0]
    np.testing.assert_allclose(batch.angular_velocity[0, :2], turning[:2] / 500, rtol=1e-4)


def test_draws_follow_their_laws():
    laws = {
        "mass_scale": (0.8, 1.2),
        "thrust_scale": log_uniform(0.8, 2.5),
        "push_mps2": normal(0.1, 0.4, -9.0, 9.0),
        "lag_up_scale": choice([0.5, 1.0, 1.5, 2.0]),
        "lag_down_scale": uniform(0.5, 2.0, group="pair"),
        "torque_scale": log_uniform(0.5, 2.0, group="pair"),
    }
    n = 1000  # drones, in 1,000 episodes
    batch = batch_of(frame(), n, variations=vary(**laws))
    drawn = []
    for _ in range(1000):
        batch.begin_episode()
        drawn.append(
            batch.params[
                :,
                [
                    *columns("mass_scale"),
                    *columns("thrust_scale"),
                    *columns("push_mps2"),
                    *columns("lag_up_scale"),
                    *columns("lag_down_scale"),
                    *columns("torque_scale"),
                ],
            ]
        )
    mass, thrust, x, y, z, lag, down, torque = np.concatenate(drawn).astype(float).T
    for values, mean, std in (
        ((mass - 0.8) / 0.4, 0.5, np.sqrt(1 / 12)),
        (np.log(thrust / 0.8) / np.log(2.5 / 0.8), 0.5, np.sqrt(1 / 12)),
        *(((each - 0.1) / 0.4, 0.0, 1.0) for each in (x, y, z)),
    ):
        m = len(values)
        assert abs(values.mean() - mean) < 3 * std / np.sqrt(m)
        fourth = ((values - mean) ** 4).mean()
        assert abs(values.var() - std**2) < 3 * np.sqrt((fourth - std**4) / m)
    kolmogorov = stats.kstest((x[:50000] - 0.1) / 0.4, "norm").statistic
    assert kolmogorov < 1.95 / np.sqrt(50000)  # a thousandth by chance
    shares = np.unique(lag, return_counts=True)[1] / len(lag)
    assert np.abs(shares - 0.25).max() < 3.5 * np.sqrt(0.25 * 0.75 / len(lag))
    for other in (thrust, x, lag, np.roll(mass, 1), np.roll(mass, n)):  # other parameters, the next drone and episode
        assert abs(np.corrcoef(mass, other)[0, 1]) < 4 / np.sqrt(len(mass))
    np.testing.assert_allclose((down - 0.5) / 1.5, np.log(torque / 0.5) / np.log(4), atol=2e-6)  # the same quantile


def test_what_is_drawn_at_the_start_stays_and_intervals_change():
    envs = flockstep.DroneVectorEnv(
        num_envs=8,
        task=flockstep.HoverConfig(),
        variations=vary(
            mass_scale=uniform(0.9, 1.1, when="start"),
            thrust_scale=(0.9, 1.1),
            push_mps2=uniform(-1, 1, when="interval", interval_s=0.1),
        ),
        max_episode_steps=12,
        autoreset_mode="same_step",
    )
    envs.reset(seed=0)
    seen = []
    for _ in range(24):
        envs.step(np.zeros((8, 4), np.float32))
        seen.append(envs.batch.params.copy())
    seen = np.stack(seen)
    mass, thrust = seen[:, :, columns("mass_scale")[0]], seen[:, :, columns("thrust_scale")[0]]
    assert (mass == mass[0]).all()
    changes = (np.diff(thrust, axis=0) != 0).any(1)
    assert np.flatnonzero(changes).tolist() == [10, 22]
    pushes = (np.diff(seen[:, :, columns("push_mps2")[0]], axis=0) != 0).any(1)
    assert np.flatnonzero(pushes).tolist() == [4, 9, 10, 16, 21, 22]  # every fifth step of an episode, and resets
    envs.close()


def test_a_force_from_outside_moves_the_drone_by_its_closed_form():
    data = plain(min_speed_radps=0.0)
    batch = batch_of(data, variations=constants(push_mps2=[1.0, -2.0, 3.0], twist_radps2=[0.0, 0.0, 0.5]))
    batch.set_pose([[0, 0, 50]], None)
    fly_for(batch, np.zeros(4), 1.0)
    np.testing.assert_allclose(batch.position[0], [0.5, -1.0, 50 + 0.5 * (3 - GRAVITY)], atol=2e-4)
    np.testing.assert_allclose(batch.angular_velocity[0], [0, 0, 0.5], atol=1e-5)


def test_wind_is_added():
    data = plain(linear_n_per_mps=[0.3, 0.3, 0.3], min_speed_radps=0.0)
    wind = flockstep.WindConfig(mean_mps=(1.0, 0.0, 0.0))
    batch = batch_of(data, variations=constants(wind_mps=[2.0, -1.0, 0.0]), wind=wind)
    np.testing.assert_array_equal(batch.wind, [[3.0, -1.0, 0.0]])


@pytest.mark.parametrize("name", ["kingfisher", "f550", "naki"])
def test_a_battery_is_used_up_and_rotors_slow_down(name):
    """Hovering empties it in its life, whatever the number of rotors."""
    values = {"battery_life_s": 20.0, "battery_fall": 0.3, "battery_used": 0.1}
    batch = batch_of(plain(name, lag_up_s=0.0), variations=constants(**values))
    batch.set_pose([[0, 0, 500]], None)
    hover = batch.rotor_speed[0, 0]
    used = 0.1
    for _ in range(500):
        power = (float(batch.rotor_speed[0, 0]) / hover) ** 3
        batch.fly(np.full((1, batch.num_rotors), hover))
        used += power * 0.01 / 20
    assert batch.battery[0] == pytest.approx(used, rel=1e-4)
    assert batch.rotor_speed[0, 0] == pytest.approx(hover * (1 - 0.3 * used), rel=1e-5)
    sagging = batch_of(plain(lag_up_s=0.0), variations=constants(battery_sag=0.2))
    sagging.set_pose([[0, 0, 500]], None)
    fly_for(sagging, np.full(4, hover), 0.5)
    most = plain()["rotors"]["max_speed_radps"]
    speed = sagging.rotor_speed[0, 0]
    assert speed == pytest.approx(hover * (1 - 0.2 * (speed / most) ** 3), rel=1e-5)


def test_a_rotor_dies():
    data = plain(lag_up_s=0.05, lag_down_s=0.05)
    batch = batch_of(data, variations=constants(dead_rotor=2.0, dead_from_s=0.2))
    batch.set_pose([[0, 0, 500]], None)
    hover = batch.rotor_speed[0, 0]
    fly_for(batch, np.full(4, hover), 0.2)
    assert (batch.rotor_speed == hover).all()
    fly_for(batch, np.full(4, hover), 0.1)
    np.testing.assert_allclose(batch.rotor_speed[0], hover * np.array([1, 1, np.exp(-0.1 / 0.05), 1]), rtol=1e-5)


@pytest.mark.parametrize(
    ("name", "control", "middle", "spread"),
    [
        ("kingfisher", "rotor_speeds", [1050] * 4, 100),
        ("f550", "rotor_speeds", [550] * 6, 100),
        ("kingfisher", "body_rates", [10, 0, 0, 0], 1),
        ("kingfisher", "velocity", [0] * 4, 1),
        ("kingfisher", "attitude", [10, 0, 0, 0], 0.2),
    ],
)
def test_a_command_takes_effect_when_it_arrives(name, control, middle, spread):
    commands = middle + np.random.default_rng(4).uniform(-spread, spread, (30, 1, len(middle))).astype(np.float32)
    for delay in (0.004, 0.010, 0.026):
        late, twin = (
            batch_of(frame(name), control=control, variations=constants(**values))
            for values in ({"action_delay_s": delay}, {"rate_gain_scale": 1.0})
        )
        ticks = round(delay * 500)
        for batch in (late, twin):
            batch.set_pose([[0, 0, 50]], None)
            batch.begin_episode()
        at = 0
        for command in commands:
            late.fly(command)
            for _ in range(5):
                sent = max((at - ticks) // 5, 0)  # the first command is there at once
                twin.fly(commands[sent], ticks=1)
                at += 1
            np.testing.assert_allclose(states_of(late), states_of(twin), rtol=1e-6, atol=1e-12)  # legs of other lengths


def test_a_step_delays_commands_as_fly_does():
    made = {"num_envs": 20, "task": flockstep.HoverConfig(), "autoreset_mode": "disabled"}
    actions = np.random.default_rng(0).uniform(-1, 1, (20, 20, 4)).astype(np.float32)
    for laws, steps in ((vary(action_delay_s=0.06), 3), (vary(action_delay_s=0.02, action_loss=1.0), len(actions))):
        late = flockstep.DroneVectorEnv(**made, variations=laws)
        twin = flockstep.DroneVectorEnv(**made, variations=vary(action_loss=0.0))
        late.reset(seed=7)
        twin.reset(seed=7)
        for t, action in enumerate(actions):
            late.step(action)
            twin.step(actions[max(t - steps, 0)])  # the first command is there at once
            np.testing.assert_array_equal(states_of(late.batch), states_of(twin.batch))
        late.close()
        twin.close()


def test_jitter_is_uniform():
    n, quick = 4000, frame(lag_up_s=0.0, lag_down_s=0.0)
    for ticks in (4, 5, 6, 9, 12, 15, 16):
        batch = batch_of(quick, n, variations=constants(action_delay_s=0.01, action_jitter_s=0.02))  # 5 to 15 ticks
        batch.set_pose(np.tile([0, 0, 50.0], (n, 1)), None)
        batch.begin_episode()
        batch.fly(np.full((n, 4), 1000.0), ticks=5)
        batch.fly(np.full((n, 4), 1100.0), ticks=ticks)
        share = (batch.rotor_speed[:, 0] > 1050).mean()
        expected = np.clip((ticks - 1 - 5 + 0.5) / 10, 0, 1)  # a delay is rounded to ticks
        assert abs(share - expected) <= 4 * np.sqrt(expected * (1 - expected) / n)


def test_controllers():
    usual = batch_of(frame("racer5"), control="body_rates")
    lag = frame("racer5")["rotors"]["lag_up_s"]
    lead = max(lag / 0.035, 1.0)
    named = flockstep.ControllerConfig(rate_gain_per_s=0.5 * lead / lag, lead=lead)
    same = batch_of(frame("racer5"), control="body_rates", controller=named)
    quick = batch_of(frame("racer5"), control="body_rates", controller=controllers["betaflight"])
    slow = batch_of(frame("racer5"), control="body_rates", controller=flockstep.ControllerConfig(command_lag_s=0.1))
    rates = []
    for batch in (usual, same, quick, slow):
        batch.set_pose([[0, 0, 50]], None)
        fly_for(batch, [GRAVITY, 3.0, 0, 0], 0.08)
        rates.append(batch.angular_velocity[0, 0])
    assert rates[1] == pytest.approx(rates[0], rel=1e-5)
    assert rates[2] > 1.1 * rates[0]
    assert rates[3] < 0.6 * rates[0]


def test_gains_are_scaled_as_those_of_a_controller():
    scaled = batch_of(
        frame(),
        control="position",
        variations=constants(
            rate_gain_scale=1.5, attitude_gain_scale=0.8, velocity_gain_scale=1.2, position_gain_scale=0.7
        ),
    )
    lag = frame()["rotors"]["lag_up_s"]
    rate = 0.5 / lag
    named = flockstep.ControllerConfig(
        rate_gain_per_s=1.5 * rate,
        yaw_rate_gain_per_s=1.5 * rate / 3,
        attitude_gain_per_s=0.8 * rate / 3,
        yaw_gain_per_s=0.8 * rate / 9,
        velocity_gain_per_s=1.2 * rate / 9,
        velocity_integral_per_s2=1.2 * 0.1 * (rate / 9) ** 2,
        position_gain_per_s=0.7 * rate / 18,
    )
    given = batch_of(frame(), control="position", controller=named)
    for batch in (scaled, given):
        batch.set_pose([[0, 0, 50]], None)
        fly_for(batch, [1, 2, 51, 0.5], 1.0)
    np.testing.assert_allclose(states_of(scaled), states_of(given), rtol=2e-4, atol=2e-4)


def test_frames_are_drawn_and_actions_mean_their_own_thrust():
    names = ["crazyflie", "racer5", "x500", "random/seed-5"]
    envs = flockstep.DroneVectorEnv(
        num_envs=64, task=flockstep.HoverConfig(), airframes=names, autoreset_mode="disabled"
    )
    envs.reset(seed=0)
    rows = envs.batch.params[:, -1].astype(int)
    assert set(rows) == set(range(4))
    alone = {}
    for i, name in enumerate(names):
        one = flockstep.DroneVectorEnv(num_envs=64, task=flockstep.HoverConfig(), drone=name, autoreset_mode="disabled")
        one.reset(seed=0)
        alone[i] = one
    actions = np.random.default_rng(1).uniform(-1, 1, (10, 64, 4)).astype(np.float32)
    for action in actions:
        seen = envs.step(action)[0]
        for i, one in alone.items():
            np.testing.assert_allclose(one.step(action)[0][rows == i], seen[rows == i], rtol=1e-5, atol=1e-5)
    for each in (envs, *alone.values()):
        each.close()


def test_random_drones_fly():
    for seed in range(50):
        drone = flockstep.DroneModel.load(f"random/seed-{seed}").to_dict()
        assert 0.02 <= drone["mass_kg"] <= 5
        rotors = drone["rotors"]
        lift = 4 * rotors["thrust_n"][2] * rotors["max_speed_radps"] ** 2 / (drone["mass_kg"] * GRAVITY)
        assert 1.5 <= lift <= 5


def test_off_gives_the_same_bits():
    def states(**fields):
        envs = flockstep.DroneVectorEnv(num_envs=33, task=flockstep.HoverConfig(), **fields)
        envs.reset(seed=2)
        rng = np.random.default_rng(3)
        for _ in range(30):
            envs.step(rng.uniform(-1, 1, (33, 4)).astype(np.float32))
        seen = states_of(envs.batch)
        envs.close()
        return seen

    usual = states()
    np.testing.assert_array_equal(states(variations=constants(mass_scale=1.0)), usual)
    np.testing.assert_array_equal(states(variations=vary(payload_below_m=(0.0, 1.0))), usual)


def test_params_are_set_by_hand():
    batch = batch_of(plain(), 20, variations=vary(mass_scale=1.0, push_mps2=0.0))
    params = np.tile(row(), (20, 1))
    params[:, columns("mass_scale")[0]] = np.linspace(0.8, 1.2, 20)
    params[:, columns("push_mps2")[1]] = 2.0
    batch.set_params(params)
    np.testing.assert_array_equal(batch.params, params)
    batch.set_pose(np.tile([0, 0, 50.0], (20, 1)), None)
    batch.fly(np.full((20, 4), 1000.0), ticks=1)
    body = Body([plain()])
    lift = body.thrust(np.full((1, 4), 1000.0)).sum() / (body.mass[0, 0] * np.linspace(0.8, 1.2, 20)) - GRAVITY
    np.testing.assert_allclose(batch.acceleration[:, 2], lift, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(batch.acceleration[:, 1], 2.0, rtol=1e-5)


def test_describe():
    envs = flockstep.DroneVectorEnv(
        num_envs=4, task=flockstep.HoverConfig(), variations=vary(presets["diffaero"], mass_scale=1.1)
    )
    text = flockstep.describe(envs)
    assert "mass_scale: 1.1, constant" in text
    assert "torque_scale: uniform in [0.75, 1.25], each episode; now" in text
    envs.close()
    plain_envs = flockstep.DroneVectorEnv(num_envs=1, task=flockstep.HoverConfig())
    assert flockstep.describe(plain_envs) == "nothing differs"
    plain_envs.close()
