"""ArduPilot's JSON interface, flown by a small controller that speaks its servo packets."""

import os
import re
import signal
import struct
import subprocess
import sys
import threading
from contextlib import contextmanager, suppress

import numpy as np
import pytest
from ardupilot_pilot import IDLE, Controller, Pilot, parse, servo_packet
from clients import eventually
from conftest import flat_batch, world_of
from messages import refused
from scipy.spatial.transform import Rotation

import flockstep
from flockstep.bridges import ArduPilotBridge
from flockstep.bridges.ardupilot import rotors_of_quad_x, state_line

HALL = world_of(room={"min": [-20, -20, 0], "max": [20, 20, 10]})
START = (2.0, -3.0, 0.15)  # m: just above the floor, east of the origin and south of it
# Rows: north, east, down in our world frame; forward, right, down in our body frame.
ENU_TO_NED = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]], float)
FLU_TO_FRD = np.diag([1.0, -1.0, -1.0])


def batch_of(num_drones=1, *, drone="x500", control="rotor_thrusts", physics_hz=1200, per_env=1, **settings):
    settings = {"motion": "rotors", "control": control, "on_contact": "stop"} | settings
    batch = flat_batch([HALL], num_drones, drone=drone, drones_per_env=per_env, physics_hz=physics_hz, **settings)
    batch.set_pose([[START[0] + i, *START[1:]] for i in range(num_drones)])
    return batch


@contextmanager
def served(batch, **settings):
    """A bridge that answers on its own thread; it must end without an error."""
    errors = []
    stopped = threading.Event()
    with ArduPilotBridge(batch, port=0, **settings) as bridge:

        def serve():
            try:
                while not stopped.is_set():
                    bridge.exchange(0.02)
            except BaseException as error:  # shown by the assertion below
                errors.append(error)

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield bridge
        finally:
            stopped.set()
            thread.join()
    assert errors == []


class TestFrames:
    def test_state_in_the_frames_of_ardupilot(self):
        generator = np.random.default_rng(0)
        for _ in range(200):
            position, velocity, rates, acceleration = generator.normal(0, 10, (4, 3)).astype(np.float32)
            turn = Rotation.random(random_state=generator)
            quat = np.roll(turn.as_quat(), 1)
            state = parse(state_line(1.25, position, quat, velocity, rates, acceleration))
            assert state["timestamp"] == 1.25
            np.testing.assert_array_equal(state["position"], ENU_TO_NED @ position)
            np.testing.assert_array_equal(state["velocity"], ENU_TO_NED @ velocity)
            np.testing.assert_array_equal(state["gyro"], FLU_TO_FRD @ rates)
            force = FLU_TO_FRD @ turn.inv().apply(acceleration + np.array([0, 0, 9.81]))
            np.testing.assert_allclose(state["accel_body"], force, rtol=0, atol=1e-12)
            matrix = ENU_TO_NED @ turn.as_matrix() @ FLU_TO_FRD.T
            found = Rotation.from_quat(np.roll(state["quaternion"], -1)).as_matrix()
            np.testing.assert_allclose(found, matrix, rtol=0, atol=1e-14)

    def test_the_numbers_of_a_flight_fit_each_other(self):
        """Velocity is the rate of the position, the gyroscope that of the attitude, the accelerometer that of v."""
        batch = batch_of(on_contact="bounce")
        batch.set_pose([[0, 0, 5]])
        generator = np.random.default_rng(1)
        with served(batch) as bridge, Controller(bridge.ports[0], frame_rate=1200) as controller:
            states = []
            pulses = np.array(IDLE)
            for step in range(600):
                if step % 60 == 0:
                    pulses = generator.integers(1500, 1700, 4)
                states.append(controller.step(pulses.tolist()))
        rate = 1200
        track = {key: np.array([state[key] for state in states]) for key in states[0]}
        np.testing.assert_allclose(np.diff(track["timestamp"][:, 0]), 1 / rate, rtol=1e-9)
        middle = (track["velocity"][1:] + track["velocity"][:-1]) / 2
        np.testing.assert_allclose(np.diff(track["position"], axis=0) * rate, middle, atol=5e-3)
        turns = Rotation.from_quat(np.roll(track["quaternion"], -1, axis=1))
        rates = (turns[:-1].inv() * turns[1:]).as_rotvec() * rate
        np.testing.assert_allclose(rates, (track["gyro"][1:] + track["gyro"][:-1]) / 2, atol=5e-3)
        gained = np.diff(track["velocity"], axis=0) * rate
        felt = turns[1:].apply(track["accel_body"][1:]) + np.array([0, 0, 9.81])
        np.testing.assert_allclose(felt, gained, atol=0.02)
        assert np.abs(track["gyro"]).max() > 0.5
        assert np.abs(gained).max() > 1


class TestRotors:
    @pytest.mark.parametrize("name", flockstep.DroneModel.names())
    def test_bundled_airframes_fit(self, name):
        drone = flockstep.DroneModel.load(name)
        if drone.num_rotors != 4:
            with refused(ValueError, "drone", "quadrotor", drone.num_rotors):
                rotors_of_quad_x(drone)
            return
        rotors = drone.to_dict()["rotors"]
        for motor, rotor in enumerate(rotors_of_quad_x(drone)):
            x, y, _ = rotors["position_m"][rotor]
            angle = np.degrees(np.arctan2(-y, x))  # clockwise from the nose
            assert abs(angle - np.degrees(Pilot.ANGLES[motor])) < 20
            assert (rotors["spin"][rotor] == "ccw") == (Pilot.YAW[motor] == 1)

    def test_another_order_is_mapped(self):
        data = flockstep.DroneModel.load("x500").to_dict()
        order = [2, 0, 3, 1]
        for key in ("position_m", "spin"):
            data["rotors"][key] = [data["rotors"][key][i] for i in order]
        mixed = flockstep.DroneModel.from_dict(data)
        assert rotors_of_quad_x(mixed) == [order.index(motor) for motor in range(4)]
        batch = batch_of(drone=mixed)
        with served(batch) as bridge, Controller(bridge.ports[0]) as controller:
            for _ in range(100):
                controller.step([2000, 1000, 1000, 1000])
        assert batch.rotor_speed[0].argmax() == order.index(0)

    def test_frames_that_do_not_fit_are_refused(self):
        data = flockstep.DroneModel.load("x500").to_dict()
        plus = {**data["rotors"], "position_m": [[0.2, 0, 0], [-0.2, 0, 0], [0, 0.2, 0], [0, -0.2, 0]]}
        with refused(ValueError, "drone", "motor 1", 0):
            rotors_of_quad_x(flockstep.DroneModel.from_dict(data | {"rotors": plus}))
        turned = {**data["rotors"], "spin": ["cw", "cw", "ccw", "ccw"]}
        with refused(ValueError, "drone", "motor 1", "cw"):
            rotors_of_quad_x(flockstep.DroneModel.from_dict(data | {"rotors": turned}))
        with refused(ValueError, "drone", "airframe"):
            rotors_of_quad_x(flockstep.DroneModel(np.random.default_rng(0).normal(size=(8, 3))))

    @pytest.mark.parametrize("control", ["rotor_thrusts", "rotor_speeds"])
    def test_pulses(self, control):
        batch = batch_of(control=control, rotor_lag=False)
        drone = batch.drone.to_dict()["rotors"]
        with served(batch) as bridge, Controller(bridge.ports[0], frame_rate=1200) as controller:
            for pulses, shares in (
                ([0, 900, 1000, 1000], [0, 0, 0, 0]),
                ([2000, 2001, 65535, 1999], [1, 1, 1, 0.999]),
                ([1250, 1500, 1750, 1001], [0.25, 0.5, 0.75, 0.001]),
            ):
                controller.step(pulses)
                speed = batch.rotor_speed[0].astype(float)
                share = speed / drone["max_speed_radps"]
                if control == "rotor_thrusts":  # this airframe's thrust is quadratic
                    share = share**2
                np.testing.assert_allclose(share, shares, atol=1e-5)


class TestFlight:
    @pytest.mark.parametrize(
        ("control", "frame_rate", "channels"), [("rotor_thrusts", 400, 16), ("rotor_speeds", 600, 32)]
    )
    def test_takes_off_hovers_and_flies_to_a_place(self, control, frame_rate, channels):
        batch = batch_of(control=control)
        hover = 1 / batch.drone.thrust_to_weight
        settings = {"is_speed": control == "rotor_speeds", "frame_rate": frame_rate, "channels": channels}
        with served(batch) as bridge, Pilot(bridge.ports[0], hover, **settings) as pilot:
            rest = [pilot.step() for _ in range(frame_rate // 2)]
            # On the ground the accelerometer measures gravity, and ArduPilot's north is our y.
            np.testing.assert_allclose(rest[-1]["accel_body"], [0, 0, -9.81], atol=1e-5)
            np.testing.assert_allclose(rest[-1]["position"][:2], [START[1], START[0]], atol=1e-3)
            climb = pilot.fly_to([START[1], START[0], -3], 6)
            assert climb[-1]["position"][2] == pytest.approx(-3, abs=0.05)
            hold = pilot.fly_to([START[1], START[0], -3], 2)
            assert max(np.linalg.norm(state["position"] - [START[1], START[0], -3]) for state in hold) < 0.06
            cruise = pilot.fly_to([4, -5, -2], 9)
            np.testing.assert_allclose(cruise[-1]["position"], [4, -5, -2], atol=0.05)
            assert np.linalg.norm(cruise[-1]["velocity"]) < 0.05
            states = rest + climb + hold + cruise
            steps = np.diff([state["timestamp"][0] for state in states])
            np.testing.assert_allclose(steps, 1 / frame_rate, rtol=1e-9)
            counts = bridge.counts[0]
        np.testing.assert_allclose(batch.position[0], [-5, 4, 2], atol=0.05)
        assert not batch.contact.hit[0]
        flown = len(states) + 1  # and the pilot's first
        assert (counts.flown, counts.lost, counts.repeated, counts.bad) == (flown, 0, 0, 0)
        assert batch.tick[0] == flown * 1200 // frame_rate

    def test_several_drones_fly_in_their_own_time(self):
        batch = batch_of(2)
        hover = 1 / batch.drone.thrust_to_weight
        with served(batch) as bridge:
            first, second = bridge.ports
            with Pilot(first, hover) as pilot, Pilot(second, hover) as other:
                pilot.fly_to([START[1], START[0], -2], 4)
                assert pilot.state["position"][2] == pytest.approx(-2, abs=0.1)
                assert other.step()["timestamp"] == pytest.approx(2 / 400)
        np.testing.assert_array_equal(batch.tick, [1601 * 3, 2 * 3])
        assert batch.position[1, 2] < 0.2

    def test_drones_of_one_env_fly_in_step(self):
        batch = batch_of(2, per_env=2)
        with served(batch) as bridge, Controller(bridge.ports[0]) as one, Controller(bridge.ports[1]) as two:
            one.send()
            assert one.is_silent()
            one.send()  # again, as ArduPilot does after a second
            assert two.step()["timestamp"] == one.receive()["timestamp"] == 1 / 400
            assert one.is_silent()
            assert (bridge.counts[0].flown, bridge.counts[0].repeated, bridge.counts[1].flown) == (1, 1, 1)
            two.frame_rate = 1200
            one.send(frame_count=1)
            with refused(RuntimeWarning, "frame_rate", 1200):
                two.send_in_vain(bridge.counts[1])
            two.frame_rate = 400
            assert two.step()["timestamp"] == one.receive()["timestamp"] == 2 / 400
        np.testing.assert_array_equal(batch.tick, [6])

    def test_ports_are_those_of_ardupilots_instances(self):
        with ArduPilotBridge(batch_of(3), port=0) as free:
            taken = set(free.ports)
        base = next(port for port in range(20000, 30000) if not taken & {port, port + 10, port + 20})
        with ArduPilotBridge(batch_of(3), port=base) as bridge:
            assert bridge.ports == [base, base + 10, base + 20]


class TestPackets:
    def test_a_repeated_frame_gets_the_same_answer(self):
        batch = batch_of()
        with served(batch) as bridge, Controller(bridge.ports[0]) as controller:
            controller.step([1700] * 4)
            controller.send([1900] * 4, frame_count=0)
            answer = controller.socket.recv(65000)
            controller.send([1900] * 4, frame_count=0)
            assert controller.socket.recv(65000) == answer
            assert parse(answer)["timestamp"] == 1 / 400
            assert (bridge.counts[0].flown, bridge.counts[0].repeated) == (1, 2)
        assert batch.tick[0] == 3

    def test_lost_frames_are_counted(self):
        with served(batch_of()) as bridge, Controller(bridge.ports[0]) as controller:
            controller.step()
            controller.frame_count = 5
            assert controller.step()["timestamp"] == 2 / 400
            assert bridge.counts[0].lost == 4

    def test_a_restart_returns_the_drone_to_its_start(self):
        batch = batch_of()
        start = batch.position.copy()
        with served(batch) as bridge:
            with Pilot(bridge.ports[0], 1 / batch.drone.thrust_to_weight) as pilot:
                first = pilot.state
                pilot.fly_to([0, 0, -3], 3)
                assert pilot.state["position"][2] < -1
            with Controller(bridge.ports[0]) as again:  # another socket, and frame 0
                state = again.step()
            for key in state:
                np.testing.assert_allclose(state[key], first[key], atol=1e-9, err_msg=key)
            assert bridge.counts[0].restarts == 1
        np.testing.assert_allclose(batch.position, start, atol=1e-3)

    def test_a_late_duplicate_is_not_a_restart(self):
        with served(batch_of()) as bridge, Controller(bridge.ports[0]) as controller:
            for _ in range(4):
                controller.step()
            controller.send(frame_count=2)
            assert controller.is_silent()
            assert controller.step()["timestamp"] == 5 / 400
            assert (bridge.counts[0].late, bridge.counts[0].restarts) == (1, 0)
            # A controller that restarted early sends an identical packet, and again if there is no answer.
            controller.send(frame_count=0)
            assert controller.is_silent()
            controller.send(frame_count=0)
            assert controller.receive()["timestamp"] == 1 / 400
            assert bridge.counts[0].restarts == 1

    @pytest.mark.parametrize("seed", range(3))
    def test_bad_packets_are_ignored(self, seed):
        """Cut, extended and changed packets. A changed one may be valid; the flight goes on in any case."""
        generator = np.random.default_rng(seed)
        batch = batch_of()
        good = servo_packet(7, [1600] * 4)
        bad = [good[:length] for length in range(len(good))] + [good + b"\0", good * 2, b"x" * 60000]
        bad += [struct.pack("<H", magic) + good[2:] for magic in (0, 18457, 29569, 65535)]
        bad += [servo_packet(7, IDLE, channels=32)[:40], servo_packet(7, IDLE, frame_rate=0)]
        with served(batch) as bridge, Controller(bridge.ports[0]) as controller:
            before = controller.step()
            for number, packet in enumerate(bad, 1):
                controller.socket.send(packet)
                if number % 20 == 0:  # so that the socket's buffer does not overflow
                    controller.send(frame_count=0)
                    assert controller.receive()["timestamp"] == before["timestamp"]
            assert controller.step()["timestamp"] == 2 / 400
            assert bridge.counts[0].bad == len(bad)
        changed = batch_of()
        with served(changed) as bridge, Controller(bridge.ports[0]) as controller:
            controller.step()
            with refused(RuntimeWarning, "frame_rate"):
                self.send_changed(controller, good, generator, bridge.counts[0])
            controller.send(frame_count=2**32 - 1)
            controller.receive()
            counts = bridge.counts[0]
            assert counts.bad > 0
            assert counts.unfit > 0
        assert np.isfinite(changed.position).all()

    def send_changed(self, controller, good, generator, counts):
        for _ in range(300):
            packet = bytearray(good)
            for place in generator.integers(0, len(packet), generator.integers(1, 4)):
                packet[place] = generator.integers(256)
            controller.socket.send(packet)
            controller.socket.settimeout(0.002)
            with suppress(TimeoutError):
                parse(controller.socket.recv(65000))
        eventually(lambda: counts.flown + counts.repeated + counts.late + counts.bad + counts.unfit == 301)
        while not controller.is_silent():
            pass

    @pytest.mark.parametrize("frame_rate", [700, 1201, 2400])
    def test_an_unfit_rate_is_reported_once(self, frame_rate):
        batch = batch_of()
        with served(batch) as bridge, Controller(bridge.ports[0], frame_rate=frame_rate) as controller:
            with refused(RuntimeWarning, "frame_rate", 1200, frame_rate, "drone 0") as warned:
                controller.send_in_vain(bridge.counts[0], 2)
            assert len(warned) == 1
            assert bridge.counts[0].unfit == 2
            controller.frame_rate = 600
            assert controller.step()["timestamp"] == 1 / 600
        assert batch.tick[0] == 2

    def test_only_the_first_host_is_answered(self):
        with served(batch_of()) as bridge, Controller(bridge.ports[0]) as controller:
            controller.step()
            with Controller(bridge.ports[0], host="127.0.0.2") as foreign:
                foreign.send(frame_count=1)
                assert foreign.is_silent()
            assert controller.step()["timestamp"] == 2 / 400
            assert bridge.counts[0].foreign == 1


class TestRefusals:
    @pytest.mark.parametrize(
        ("settings", "said"),
        [
            ({"motion": "kinematic", "control": "pose", "physics_hz": None}, ('motion="kinematic"', 'control="pose"')),
            ({"control": "velocity"}, ('motion="rotors"', "rotor_speeds", "rotor_thrusts", "velocity")),
            ({"on_contact": "terminate"}, ('on_contact="stop"', "bounce", "terminate")),
        ],
    )
    def test_batches(self, settings, said):
        with refused(ValueError, "batch", *said):
            ArduPilotBridge(batch_of(**settings), port=0)

    @pytest.mark.parametrize("port", [-1, 65536, 65530, 1.5, True])
    def test_ports(self, port):
        with refused(ValueError, "port"):
            ArduPilotBridge(batch_of(2), port=port)

    def test_addresses_and_taken_ports(self):
        with refused(OSError, "cannot listen on UDP port 9002", "192.0.2.1"):
            ArduPilotBridge(batch_of(), address="192.0.2.1")
        with ArduPilotBridge(batch_of(), port=0) as bridge:
            (port,) = bridge.ports
            with refused(OSError, f"cannot listen on UDP port {port}"):
                ArduPilotBridge(batch_of(), port=port)


class TestCommand:
    def start(self, *arguments):
        command = [sys.executable, "-m", "flockstep", "ardupilot", "--port", "0", *arguments]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ)

    @pytest.mark.parametrize("with_recipe", [False, True])
    def test_flies_and_ends_with_ctrl_c(self, with_recipe, tmp_path):
        recipe = tmp_path / "recipe.json"
        recipe.write_text('{"worlds": ["playground/train-2"], "drone": "kingfisher", "clock": {"physics_hz": 400}}')
        process = self.start(*([str(recipe)] if with_recipe else ["--world", "playground/train-1", "--drones", "2"]))
        line = process.stdout.readline()
        try:
            expected = (
                "1 x kingfisher in playground/train-2, 400" if with_recipe else "2 x x500 in playground/train-1, 1200"
            )
            assert line.startswith(expected), line + process.stderr.read()
            port = int(re.search(r"port (\d+)", line)[1])
            with Controller(port) as controller:
                state = [controller.step() for _ in range(200)][-1]
            np.testing.assert_allclose(state["accel_body"], [0, 0, -9.81], atol=0.01)  # it stands on the ground
        finally:
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=30)
        assert (process.returncode, err) == (0, "")
        assert f"port {port}: PacketCounts(flown=200, repeated=0" in out

    def test_refuses_with_one_line(self):
        process = self.start("--drone", "x501")
        _, err = process.communicate(timeout=60)
        assert process.returncode == 1
        assert err.startswith("flockstep ardupilot: ")
        assert "x500" in err
        assert "Traceback" not in err
