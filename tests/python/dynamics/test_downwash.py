"""Downwash against its equations in NumPy, its bounds, and what it must not depend on."""

import numpy as np
import pytest
from messages import refused
from rigid_body import FRAMES, GRAVITY, batch_of, frame, plain
from scipy.spatial.transform import Rotation

import flockstep

B, S, S0 = 10.11, 0.07668, -5.817  # the fit of Bauersfeld et al.
LOSS, MOST = 0.4, 0.5


def geometry(data):
    """Positions of the hubs, the largest distance of two of them, and the area of all rotors."""
    hubs = np.array(data["rotors"]["position_m"])
    length = np.linalg.norm(hubs[:, None] - hubs, axis=2).max()
    return hubs, length, 4 * np.pi * data["rotors"]["radius_m"] ** 2


def thrusts(data, speed):
    c0, c1, c2 = data["rotors"]["thrust_n"]
    return np.maximum(c0 + c1 * speed + c2 * np.asarray(speed, float) ** 2, 0)


def jet(s, q):
    """Velocity in the jet over the induced velocity, at distances along it and from its axis, in lengths."""
    x = q / (S * (s - S0))
    bell = 1 / (1 + (np.sqrt(2) - 1) * x**2) ** 2
    tapered = np.maximum(bell - 1 / 49, 0) / (1 - 1 / 49) * np.clip(s, 0, 1) * np.clip((30 - s) / 10, 0, 1)
    return B / np.maximum(s - S0, 1e-9) * tapered


def shares(data, position, quat_wxyz, speed):
    """(M, 4): share of its thrust that each rotor of the drones of an env keeps."""
    hubs, length, area = geometry(data)
    rotation = Rotation.from_quat(quat_wxyz, scalar_first=True)
    up = rotation.apply([0, 0, 1])
    load = thrusts(data, speed).sum(1) / area
    hover = data["mass_kg"] * GRAVITY / area
    kept = np.ones((len(position), 4))
    center = position + rotation.apply(hubs.mean(0))
    for target in range(len(position)):
        at = position[target] + rotation[target].apply(hubs)
        lost2 = np.zeros(4)
        for source in range(len(position)):
            if source == target:
                continue
            apart = at - center[source]
            s = -apart @ up[source] / length
            q = np.linalg.norm(apart / length + s[:, None] * up[source], axis=1)
            lost = LOSS * max(up[source] @ up[target], 0) * jet(s, q) * np.sqrt(load[source] / hover)
            lost2 += lost**2
        kept[target] = 1 - np.minimum(np.sqrt(lost2), MOST)
    return kept


def swarm(data, drones_per_env, envs=1, **arguments):
    """Envs of drones without drag, with these further arguments of the batch."""
    arguments = {"physics_hz": 1000, "downwash": True, "num_threads": 0, "drones_per_env": drones_per_env} | arguments
    return batch_of(data, envs * drones_per_env, **arguments)


def hover_speed(data):
    return flockstep.DroneModel.from_dict(data).hover_speed_radps


def measured(batch, data, speed):
    """(N, 4): shares of thrust that the accelerations of one tick from rest show, with instant rotors."""
    batch.fly(speed, ticks=1)
    hubs, _, _ = geometry(data)
    sign = np.array([1 if way == "ccw" else -1 for way in data["rotors"]["spin"]])
    ones = np.ones(4)
    allocation = np.stack([ones, hubs[:, 1], -hubs[:, 0], -sign * data["rotors"]["torque_ratio_m"]])
    up = Rotation.from_quat(batch.quat_wxyz, scalar_first=True).apply([0, 0, 1])
    push = data["mass_kg"] * ((batch.acceleration + GRAVITY * np.eye(3)[2]) * up).sum(1)
    torque = batch.angular_acceleration * data["inertia_kgm2"]
    found = np.linalg.solve(allocation, np.column_stack([push, torque]).T).T
    return found / thrusts(data, speed)


def random_swarm(data, count, seed, spread=4.0):
    """Positions within some lengths, attitudes mostly upright, and rotor speeds."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(-1, 1, (count, 3)) * [spread, spread, 3 * spread] * geometry(data)[1]
    tilt = Rotation.from_rotvec(rng.normal(0, 0.4, (count, 3)))
    tilt[0] = Rotation.from_rotvec([2.5, 0, 0])  # upside down
    speed = hover_speed(data) * rng.uniform(0.8, 1.1, (count, 4))
    return position, tilt.as_quat(scalar_first=True), speed


def placed(batch, position, quat_wxyz=None, speed=None):
    batch.set_pose(position, quat_wxyz)
    if speed is not None:
        batch.set_velocity(None, None, speed)
    return batch


def rows(batch):
    return np.concatenate([batch.position, batch.quat_wxyz, batch.velocity, batch.angular_velocity], axis=1)


class TestEquations:
    @pytest.mark.parametrize("integrator", ["midpoint", "rk4"])
    @pytest.mark.parametrize("name", FRAMES)
    def test_random_swarms(self, name, integrator):
        data = plain(name)
        count, lost = 12, 0.0
        for seed in range(5):
            position, quat, speed = random_swarm(data, count, seed)
            batch = placed(swarm(data, count, integrator=integrator), position, quat, speed)
            expected = shares(data, position, quat, speed)
            np.testing.assert_allclose(measured(batch, data, speed), expected, atol=2e-3)
            lost = max(lost, 1 - expected.min())
        assert lost > 0.15

    @pytest.mark.parametrize("name", FRAMES)
    def test_the_jet_has_the_momentum_of_the_thrust(self, name):
        """Its flux of momentum is about the thrust, so the length of the fit is the distance of opposite hubs."""
        _, length, area = geometry(frame(name))
        q = np.linspace(0, 12, 4001)
        for s in (5.0, 10.0, 20.0):
            flux = 2 * np.pi * np.trapezoid(jet(s, q) ** 2 * q, q) * length**2  # over the density and v^2
            assert 0.6 < flux / (2 * area) < 1.1  # the thrust is twice the density times area times v^2

    def test_a_crazyflie_below_another_one(self):
        """The loss is within a factor of 2 of gym-pybullet-drones' fit, 2267.18 (r / 4 z)^2 N, from 1 m on."""
        data = frame("crazyflie")
        for z, of_the_weight in ((1.0, 0.286), (1.5, 0.127), (2.0, 0.072)):
            upright, speed = np.array([[1.0, 0, 0, 0]] * 2), np.full((2, 4), hover_speed(data))
            share = shares(data, np.array([[0, 0, z], [0, 0, 0]]), upright, speed)
            fit = 2267.18 * (0.0231348 / (4 * z)) ** 2 / (0.027 * GRAVITY)
            assert fit == pytest.approx(of_the_weight, abs=0.001)
            assert fit / 2 < 1 - share[1].mean() < fit * 2


class TestBounds:
    def test_no_wash_beside_above_and_far_below(self):
        """The same bits as without downwash."""
        data = frame("x500")
        length = geometry(data)[1]
        edge = np.sqrt(6 / (np.sqrt(2) - 1)) * S
        beside = [[0.501 + edge * (s - S0), 0, -s] for s in (0.5, 2, 29)]
        for at in [[0, 0, 0], [0, 0, 1], [2, 0, 0], [0, 0, -30.001], *beside]:
            position = [[0, 0, 0], np.multiply(at, length)]
            speed = np.full((2, 4), hover_speed(data))
            on, off = (placed(swarm(data, 2, downwash=downwash), position) for downwash in (True, False))
            for batch in (on, off):
                batch.fly(speed, ticks=1)
            if at == [0, 0, 1]:  # the other drone is below
                np.testing.assert_array_equal(rows(on)[1], rows(off)[1])
                assert on.acceleration[0, 2] < -1
            else:
                np.testing.assert_array_equal(rows(on), rows(off))

    def test_continuity(self):
        """Small steps along lines through the jet, its edge and both ends change the loss by little."""
        data = plain("kingfisher")
        length = geometry(data)[1]
        steps = np.linspace(0, 1, 4000)[:, None]
        lines = (([0, 0, 2], [0, 0, -33]), ([-14, 0, -20], [14, 0, -20]), ([-4, 2, 1], [6, -2, -4]))
        for begin, end in lines:
            at = np.array(begin) + steps * (np.array(end) - begin)
            position = np.zeros((len(at), 2, 3))
            position[:, 1] = at * length
            batch = placed(swarm(data, 2, envs=len(at)), position.reshape(-1, 3))
            speed = np.full((2 * len(at), 4), hover_speed(data))
            found = measured(batch, data, speed).reshape(len(at), 2, 4)
            assert found[:, 1].min() < 0.85
            jump = np.abs(np.diff(found[:, 1], axis=0)).max()
            assert jump < 1.2 * np.linalg.norm(np.subtract(end, begin)) / len(at)
            np.testing.assert_allclose(found[[0, -1], 1], 1, atol=1e-4)

    @pytest.mark.parametrize("name", FRAMES)
    @pytest.mark.parametrize("spacing", [0.0, 0.01, 1.0])
    def test_a_stack_of_hundreds(self, name, spacing):
        """Rotors lose at most half of their thrust, even under 300 drones."""
        data = plain(name)
        position = np.zeros((300, 3))
        position[:, 2] = spacing * np.arange(300) * geometry(data)[1]
        speed = np.full((300, 4), hover_speed(data))
        batch = placed(swarm(data, 300), position)
        found = measured(batch, data, speed)
        assert found.min() > 0.5 - 1e-3
        assert found.max() < 1 + 1e-3
        if spacing > 0:
            assert found[0] == pytest.approx(0.5, abs=1e-3)
            assert found[299] == pytest.approx(1, abs=1e-3)
        for _ in range(20):
            batch.fly(speed)
        assert np.isfinite(rows(batch)).all()


class TestInvariance:
    DATA = frame("x500", rotor_inertia_kgm2=5e-6, drag_n_per_radps_mps=[1e-4, 1.2e-4, 5e-5])

    def begun(self, envs, members=range(9), seeds=None, **arguments):
        """Envs in flight; env i depends only on its seed."""
        batch = swarm(self.DATA, len(members), envs, physics_hz=500, **arguments)
        starts = [random_swarm(self.DATA, 9, seed, 2.0) for seed in seeds or range(envs)]
        placed(batch, *(np.concatenate([start[k][list(members)] for start in starts]) for k in range(3)))
        return batch

    def command(self, envs, members=range(9)):
        rng = np.random.default_rng(1)
        return np.tile((hover_speed(self.DATA) * rng.uniform(0.9, 1.1, (9, 4)))[list(members)], (envs, 1))

    def fly(self, batch, steps=30, members=range(9)):
        for _ in range(steps):
            batch.fly(self.command(batch.num_drones // len(members), members))
        return batch

    def test_the_wash_matters_here(self):
        on, off = self.fly(self.begun(3)), self.fly(self.begun(3, downwash=False))
        assert np.abs(on.position - off.position).max() > 0.05

    def test_numbers_of_the_drones(self):
        order = np.random.default_rng(2).permutation(9)
        expected = rows(self.fly(self.begun(2))).reshape(2, 9, -1)[:, order]
        found = rows(self.fly(self.begun(2, order), members=order)).reshape(2, 9, -1)
        np.testing.assert_array_equal(found, expected)

    def test_snapshots(self):
        batch, copy = self.begun(2), self.begun(2)
        self.fly(batch, 10).fly(self.command(2), ticks=3)
        copy.restore(batch.snapshot())
        for each in (batch, copy):
            each.fly(self.command(2), ticks=4)
            self.fly(each, 10)
        np.testing.assert_array_equal(rows(batch), rows(copy))
        with refused(ValueError, "snapshot"):
            self.begun(2, downwash=False).restore(batch.snapshot())

    @pytest.mark.parametrize("interaction", ["none", "sense", "collide", "both"])
    def test_drones_apart_may_meet(self, interaction):
        """Downwash does not depend on what else the drones are to each other."""
        expected, found = self.begun(2), self.begun(2, interaction=interaction)
        apart = np.tile(np.c_[np.zeros((9, 2)), 3.0 * np.arange(9)], (2, 1))
        for batch in (expected, found):
            placed(batch, apart, np.tile([1.0, 0, 0, 0], (18, 1)))
            self.fly(batch, 20)
        np.testing.assert_array_equal(rows(found), rows(expected))

    def test_drones_that_hold_still_make_a_wash(self):
        """A mask leaves them out of the flight, with their rotors running."""
        data = plain("x500")
        batch = placed(swarm(data, 2), [[0, 0, 0], [0, 0, -1]])
        batch.fly(np.full((2, 4), hover_speed(data)), ticks=1, mask=[False, True])
        assert batch.acceleration[1, 2] < -1

    def test_a_long_call_follows_the_steps(self):
        """One call of many steps is as many calls of one step, for envs at any tick, except for rounding."""
        long, short = self.begun(2), self.begun(2)
        for batch in (long, short):
            batch.fly(self.command(2), ticks=2, mask=np.arange(18) < 9)  # of 5 ticks
        ticks = 13
        long.fly(self.command(2), ticks=ticks)
        one, two = np.arange(18) < 9, np.arange(18) >= 9
        for first, mask in ((3, one), (5, two)):
            flown = 0
            while flown < ticks:
                leg = min(first if flown == 0 else 5, ticks - flown)
                short.fly(self.command(2), ticks=leg, mask=mask)
                flown += leg
        np.testing.assert_allclose(rows(long), rows(short), atol=2e-6)

    @staticmethod
    def hovering(**arguments):
        """The task Hover begins with all drones of an env near one point."""
        return flockstep.DroneVectorEnv(
            6, drones_per_env=4, task=flockstep.HoverConfig(), control="rotor_thrusts", **arguments
        )

    def test_sensors_between_ticks_change_nothing(self):
        """With them a step is flown tick by tick; its wash is still that of its beginning."""
        end = []
        for arguments in ({}, {"imu": flockstep.ImuConfig(rate_hz=500)}, {"downwash": False}):
            envs = self.hovering(**{"downwash": True, **arguments})
            envs.reset(seed=3)
            for _ in range(10):
                envs.step(np.full((24, 4), 0.1, np.float32))
            end.append(rows(envs.batch))
        np.testing.assert_allclose(end[0], end[1], atol=1e-5)
        assert np.abs(end[0] - end[2]).max() > 1e-2

    def test_accelerations_at_the_beginning_of_an_episode(self):
        envs = self.hovering(downwash=True, body_drag=False, rotor_drag=False, gyroscopic=False)
        envs.reset(seed=3)
        batch, data = envs.batch, envs.batch.drone.to_dict()
        up = Rotation.from_quat(batch.quat_wxyz, scalar_first=True).apply([0, 0, 1])
        least = 1.0
        for env in range(6):
            own = slice(4 * env, 4 * env + 4)
            kept = shares(data, batch.position[own].astype(float), batch.quat_wxyz[own], batch.rotor_speed[own])
            push = (kept * thrusts(data, batch.rotor_speed[own])).sum(1) / data["mass_kg"]
            np.testing.assert_allclose(batch.acceleration[own], push[:, None] * up[own] - [0, 0, GRAVITY], atol=0.02)
            least = min(least, kept.min())
        assert least < 0.95


class TestInterface:
    @pytest.mark.parametrize(
        ("field", "value", "shown"),
        [
            ("downwash", True, "True"),
            ("ground_effect", True, "True"),
            ("wind", flockstep.WindConfig(gusts="dryden"), "some"),
            ("wind", flockstep.WindConfig(mean_mps=[0, 0, 0.1]), "some"),
        ],
    )
    def test_kinematic_motion_is_refused(self, field, value, shown):
        with refused(ValueError, field, shown):
            flockstep.Batch(dynamics=flockstep.DynamicsConfig(**{field: value}))
