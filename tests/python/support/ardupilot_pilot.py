"""The other end of ArduPilot's JSON interface: a small controller that speaks its servo packets."""

import json
import re
import socket
import struct

import numpy as np
from clients import eventually
from scipy.spatial.transform import Rotation

IDLE = [1000] * 4


def servo_packet(frame_count, pwm, frame_rate=400, channels=16):
    pulses = [*pwm, *[1500] * (channels - len(pwm))]
    return struct.pack(f"<HHI{channels}H", {16: 18458, 32: 29569}[channels], frame_rate, frame_count, *pulses)


def parse(line):
    """Return the state in a line, read as ArduPilot does: it searches each key and scans what follows."""
    text = line.decode("ascii")
    assert text[0] == text[-1] == "\n"
    assert text.count("\n") == 2
    rows = {}
    for section, key, count in (
        ("", "timestamp", 1),
        ("imu", "gyro", 3),
        ("imu", "accel_body", 3),
        ("", "position", 3),
        ("", "quaternion", 4),
        ("", "velocity", 3),
    ):
        place = text.index(section) + len(section) + 1
        place = text.index(key, place) + len(key) + 2
        number = r"([-+\d.e]+)"
        scanned = re.match(number if count == 1 else r"\[" + ", ?".join([number] * count) + r"\]", text[place:])
        rows[key] = np.array([float(number) for number in scanned.groups()])
    assert json.loads(text)["timestamp"] == rows["timestamp"]
    return rows


class Controller:
    """One controller on its own socket."""

    def __init__(self, port, *, host="127.0.0.1", frame_rate=400, channels=16):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((host, 0))
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(10)
        self.frame_rate, self.channels, self.frame_count = frame_rate, channels, 0
        self.state = None

    def send(self, pwm=IDLE, frame_count=None):
        frame_count = self.frame_count if frame_count is None else frame_count
        self.socket.send(servo_packet(frame_count, pwm, self.frame_rate, self.channels))

    def receive(self):
        self.state = parse(self.socket.recv(65000))
        return self.state

    def step(self, pwm=IDLE):
        self.send(pwm)
        self.frame_count += 1
        return self.receive()

    def is_silent(self):
        self.socket.settimeout(0.2)
        try:
            self.socket.recv(65000)
        except TimeoutError:
            return True
        finally:
            self.socket.settimeout(10)
        return False

    def send_in_vain(self, counts, times=1):
        before = counts.unfit
        for _ in range(times):
            self.send()
        eventually(lambda: counts.unfit == before + times)
        assert self.is_silent()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()


class Pilot(Controller):
    """Holds a position in ArduPilot's frames: PD control of position and attitude, and the mixer of QUAD X."""

    #: Clockwise from the nose, and 1 for a rotor that turns counter-clockwise: ArduPilot's motors 1 to 4.
    ANGLES = np.radians([45, -135, -45, 135])
    YAW = np.array([1, 1, -1, -1])

    def __init__(self, port, hover, *, is_speed=False, **settings):
        super().__init__(port, **settings)
        self.hover, self.is_speed = hover, is_speed
        self.step()
        self.heading = self.frame().apply([1, 0, 0])

    def frame(self):
        return Rotation.from_quat(np.roll(self.state["quaternion"], -1))  # forward, right, down to north, east, down

    def fly_to(self, target_ned, seconds):
        """Fly there; return the states."""
        states = []
        for _ in range(round(seconds * self.frame_rate)):
            states.append(self.step(self.pulses(np.asarray(target_ned, float))))
        return states

    def pulses(self, target_ned):
        state, frame = self.state, self.frame()
        pull = 1.5 * np.clip(target_ned - state["position"], -2, 2) - 2.2 * state["velocity"]
        force = np.clip(pull, -4, 4) - [0, 0, 9.81]  # per mass
        tilt = frame.inv().apply(-force / np.linalg.norm(force))  # where the body's z axis has to point
        turn = np.cross(frame.inv().apply(self.heading), [1, 0, 0])[2]
        rates = state["gyro"]
        roll, pitch = -0.33 * tilt[1] - 0.066 * rates[0], 0.33 * tilt[0] - 0.066 * rates[1]
        yaw = -0.2 * turn - 0.15 * rates[2]
        thrust = self.hover * np.linalg.norm(force) / 9.81
        motors = thrust - np.sin(self.ANGLES) * roll + np.cos(self.ANGLES) * pitch + self.YAW * yaw
        motors = np.clip(motors, 0, 1)
        if self.is_speed:
            motors = np.sqrt(motors)
        return [round(1000 + 1000 * motor) for motor in motors]
