"""The equations of multirotor flight in double precision, solved by SciPy: the reference for the engine's flight.

World frame z up, body frame x forward, y left, z up; SI units. Every function takes rows, one drone each. Every term of
the equations has its own function, which is zero for a frame without its numbers.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from conftest import flat_batch, world_of
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import flockstep

GRAVITY = 9.81  # m/s^2
OPEN = world_of(room={"min": [-2e4] * 3, "max": [2e4] * 3})
UP = np.array([0.0, 0.0, 1.0])
FRAMES = [name for name in flockstep.DroneModel.names() if flockstep.DroneModel.load(name).num_rotors == 4]
CONTROLS = (  # that `fly` and the flight tasks accept
    "rotor_speeds",
    "rotor_thrusts",
    "body_rates",
    "attitude",
    "acceleration",
    "velocity",
    "heading_velocity",
    "position",
)


def frame(name="kingfisher", **changes):
    """The data of a bundled airframe with some fields changed, including fields of its rotors and drag by name."""
    data = flockstep.DroneModel.load(name).to_dict()
    for field, value in changes.items():
        if field == "rotor_inertia_kgm2":
            data["rotors"]["inertia_kgm2"] = value
        else:
            next(home for home in (data, data["rotors"], data["drag"]) if field in home)[field] = value
    return data


FULL = frame(rotor_inertia_kgm2=5e-6, drag_n_per_radps_mps=[1e-4, 1.2e-4, 5e-5])
MIDDLE = {  # a command of each control that keeps a kingfisher in the air
    "rotor_speeds": [1000, 1100, 1050, 1080],
    "rotor_thrusts": [1.7, 1.9, 1.8, 1.85],
    "body_rates": [10, 0.5, -0.3, 0.4],
    "attitude": [10, 0.2, -0.1, 0.5],
    "acceleration": [1, -2, 0.5, 0.3],
    "velocity": [1, -2, 0.5, 0.3],
    "heading_velocity": [1, -2, 0.5, 0.3],
    "position": [1, -2, 0.5, 0.3],
}


def plain(name="kingfisher", **changes):
    """A frame with only mass, inertia, thrust and torque, plus the given changes."""
    nothing = {
        "lag_up_s": 0.0,
        "lag_down_s": 0.0,
        "rotor_inertia_kgm2": 0.0,
        "drag_n_per_radps_mps": [0.0] * 3,
        "lift_n_per_mps2": 0.0,
        "linear_n_per_mps": [0.0] * 3,
        "quadratic_n_per_mps2": [0.0] * 3,
    }
    return frame(name, **{**nothing, **changes})


def drone_of(data):
    """The drone of a frame, without warnings: frames of tests may be extreme."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return flockstep.DroneModel.from_dict(data)


def batch_of(data, num_drones=1, policy_hz=100.0, physics_hz=500.0, worlds=(OPEN,), **fields):
    """A batch of drones with simulated rotors of a frame, commanded by rotor speeds unless ``control`` is given."""
    usual = {"motion": "rotors", "control": "rotor_speeds", "num_threads": 1, "policy_hz": policy_hz}
    return flat_batch(list(worlds), num_drones, drone=drone_of(data), **usual | {"physics_hz": physics_hz} | fields)


def fly_for(batch, command, seconds, policy_hz=100):
    """Fly one command, a row or one of each drone, for a whole number of steps."""
    command = np.asarray(command, float)
    command = np.broadcast_to(command, (batch.num_drones, command.shape[-1]))
    for _ in range(round(seconds * policy_hz)):
        batch.fly(command)


def to_world(quat_wxyz, vectors):
    return Rotation.from_quat(quat_wxyz, scalar_first=True).apply(vectors)


def to_body(quat_wxyz, vectors):
    return Rotation.from_quat(quat_wxyz, scalar_first=True).inv().apply(vectors)


def angle_between(a, b):
    """Degrees between two arrays of attitudes (N, 4)."""
    return np.degrees(
        (Rotation.from_quat(a, scalar_first=True).inv() * Rotation.from_quat(b, scalar_first=True)).magnitude()
    )


class Body:
    """The frames of rows of drones, stacked as (N, ...)."""

    def __init__(self, datas):
        rotors, drags = [data["rotors"] for data in datas], [data["drag"] for data in datas]
        self.mass = np.array([data["mass_kg"] for data in datas])[:, None]
        self.inertia = np.array([data["inertia_kgm2"] for data in datas])
        self.hub = np.array([r["position_m"] for r in rotors])
        self.sign = np.array([[1.0 if way == "ccw" else -1.0 for way in r["spin"]] for r in rotors])
        self.polynomial = np.array([r["thrust_n"] for r in rotors])
        self.torque_ratio = np.array([r["torque_ratio_m"] for r in rotors])
        self.lag = np.array([[r["lag_up_s"], r["lag_down_s"]] for r in rotors])
        self.rotor_inertia = np.array([r["inertia_kgm2"] for r in rotors])
        self.rotor_drag = np.array([r["drag_n_per_radps_mps"] for r in rotors])
        self.rotor_lift = np.array([r["lift_n_per_mps2"] for r in rotors])
        self.linear = np.array([d["linear_n_per_mps"] for d in drags])
        self.quadratic = np.array([d["quadratic_n_per_mps2"] for d in drags])

    def thrust(self, speed):
        """Thrust in N along the body's z axis, of rotors (N, R) at these speeds."""
        c0, c1, c2 = self.polynomial.T[:, :, None]
        return np.maximum(c0 + c1 * speed + c2 * speed**2, 0.0)

    def air_at_rotors(self, velocity, rates):
        """(N, R, 3) m/s, velocity of the hubs through the air; both arguments in the body frame."""
        return velocity[:, None] + np.cross(rates[:, None], self.hub)

    def drag_of_rotors(self, speed, air):
        return -speed[:, :, None] * self.rotor_drag[:, None] * air

    def lift(self, air):
        return self.rotor_lift[:, None] * (air[:, :, 0] ** 2 + air[:, :, 1] ** 2)

    def drag_of_body(self, velocity):
        return -self.linear * velocity - np.linalg.norm(velocity, axis=1, keepdims=True) * self.quadratic * velocity

    def acceleration_of_rotors(self, speed, command):
        lag = np.where(command > speed, self.lag[:, :1], self.lag[:, 1:])
        return np.divide(command - speed, lag, out=np.zeros_like(speed), where=lag > 0)

    def gyroscopic(self, rates, speed, spin_up):
        """Torque in N m from spinning rotors on the body: from its rotation, and from changes of the rotor speeds."""
        inertia = self.rotor_inertia[:, None] * UP
        momentum = inertia * (self.sign * speed).sum(1, keepdims=True)
        return -np.cross(rates, momentum) - inertia * (self.sign * spin_up).sum(1, keepdims=True)

    def derivative(self, state, command):
        """Derivative of rows of position, quaternion, velocity in the world, body rates, rotor speeds: (N, 13 + R)."""
        quat, velocity, rates, speed = state[:, 3:7], state[:, 7:10], state[:, 10:13], state[:, 13:]
        rotation = Rotation.from_quat(quat, scalar_first=True).as_matrix()
        through_air = (velocity[:, None] @ rotation)[:, 0]
        air = self.air_at_rotors(through_air, rates)
        spin_up = self.acceleration_of_rotors(speed, command)
        push = self.thrust(speed) + self.lift(air)
        at_rotors = self.drag_of_rotors(speed, air) + push[:, :, None] * UP
        force = at_rotors.sum(1) + self.drag_of_body(through_air)
        yaw = -self.torque_ratio[:, None] * (self.sign * push).sum(1, keepdims=True) * UP
        torque = np.cross(self.hub, at_rotors).sum(1) + yaw + self.gyroscopic(rates, speed, spin_up)
        torque -= np.cross(rates, self.inertia * rates)
        w, v = quat[:, :1], quat[:, 1:]
        turning = 0.5 * np.concatenate([-(v * rates).sum(1, keepdims=True), w * rates + np.cross(v, rates)], axis=1)
        falling = (rotation @ force[:, :, None])[:, :, 0] / self.mass - GRAVITY * UP
        return np.concatenate([velocity, turning, falling, torque / self.inertia, spin_up], axis=1)

    def runge_kutta(self, state, command, dt):
        """One step of the classical fourth-order Runge-Kutta method."""
        a = self.derivative(state, command)
        b = self.derivative(state + dt / 2 * a, command)
        c = self.derivative(state + dt / 2 * b, command)
        d = self.derivative(state + dt * c, command)
        return state + dt / 6 * (a + 2 * b + 2 * c + d)

    def fly(self, state, commands, step_s):
        """States after each of the commands (T, N, R), each held for one step: (T, N, 13 + R)."""
        states, lags = [], self.lag.max(1, keepdims=True) > 0
        for command in commands:
            state = state.copy()
            state[:, 13:] = np.where(lags, state[:, 13:], command)

            def rows(_, flat, command=command, shape=state.shape):
                return self.derivative(flat.reshape(shape), command).ravel()

            solved = solve_ivp(rows, (0, step_s), state.ravel(), "DOP853", first_step=step_s, rtol=1e-10, atol=1e-10)
            assert solved.success
            state = solved.y[:, -1].reshape(state.shape)
            state[:, 3:7] /= np.linalg.norm(state[:, 3:7], axis=1, keepdims=True)
            states.append(state)
        return np.stack(states)


@dataclass
class Start:
    """Initial states of rows of drones."""

    position: np.ndarray
    quat_wxyz: np.ndarray
    velocity: np.ndarray
    rates: np.ndarray
    speed: np.ndarray

    @staticmethod
    def random(num_drones, data, seed=0, speed_mps=3.0, rates_radps=3.0):
        """Random attitudes and headings, with rotors around hover speed."""
        rng = np.random.default_rng(seed)
        hover = drone_of(data).hover_speed_radps
        rows = (
            rng.uniform(-1, 1, (num_drones, 3)),
            Rotation.random(num_drones, rng).as_quat(scalar_first=True),
            rng.normal(0, speed_mps, (num_drones, 3)),
            rng.normal(0, rates_radps, (num_drones, 3)),
            hover * rng.uniform(0.97, 1.03, (num_drones, drone_of(data).num_rotors)),
        )
        return Start(*(row.astype(np.float32) for row in rows))

    def place(self, batch):
        batch.set_pose(self.position, self.quat_wxyz)
        batch.set_velocity(self.velocity, self.rates, self.speed)

    def rows(self):
        parts = (self.position, self.quat_wxyz, self.velocity, self.rates, self.speed)
        rows = np.concatenate(parts, axis=1).astype(float)
        rows[:, 3:7] /= np.linalg.norm(rows[:, 3:7], axis=1, keepdims=True)
        return rows


def rows_of(batch):
    """The engine's state in the order of `Start.rows`."""
    parts = (batch.position, batch.quat_wxyz, batch.velocity, batch.angular_velocity, batch.rotor_speed)
    return np.concatenate(parts, axis=1).astype(float)
