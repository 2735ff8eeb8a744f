"""The state that a flight changes, as one array; the derivatives of a step; and both in PyTorch."""

import numpy as np
import pytest
from conftest import world_of
from messages import refused

import flockstep

HALL = world_of(name="hall", room={"min": [-20, -20, 0], "max": [20, 20, 40]}, markers={"start": [0, 0, 20]})
# Numbers that change a step about as much, by column.
UNITS = np.repeat([0.3, 0.3, 0.02, 0.3, 0.1, 30, 30], [3, 3, 4, 3, 3, 4, 4])
COMMANDS = {
    "rotor_speeds": ([1500.0] * 4, 20.0),
    "rotor_thrusts": ([0.07] * 4, 0.005),
    "body_rates": ([10.0, 0.5, -0.5, 0.2], 0.3),
    "velocity": ([1.0, -0.5, 0.3, 0.2], 0.1),
    "heading_velocity": ([1.0, -0.5, 0.3, 0.2], 0.1),
}


def batch_of(num_drones=1, control="body_rates", **fields):
    """Return a batch whose step is two midpoint ticks, which `pullback` differentiates exactly."""
    dynamics = flockstep.DynamicsConfig(motion="rotors", control=control, integrator="midpoint")
    clock = flockstep.ClockConfig(policy_hz=50, physics_hz=100)
    fields = {"num_threads": 1, **fields}
    return flockstep.Batch(HALL, num_drones, drone="crazyflie", dynamics=dynamics, clock=clock, **fields)


def random_flown(batch, rng):
    flown = batch.flown
    flown += rng.normal(size=flown.shape) * np.repeat([2, 2, 0.3, 2, 0.2, 200, 200], [3, 3, 4, 3, 3, 4, 4])
    flown[:, 6:10] /= np.linalg.norm(flown[:, 6:10], axis=1, keepdims=True)
    flown[:, 16:] = flown[:, 16:].clip(100, 2300)
    return flown.astype(np.float32)


class TestFlown:
    def test_has_the_arrays_of_the_batch_and_brings_drones_back(self):
        batch, rng = batch_of(5), np.random.default_rng(0)
        command = np.float32(COMMANDS["body_rates"][0]) + rng.normal(size=(5, 4))
        batch.fly(command)
        flown = batch.flown
        arrays = [batch.position, batch.velocity, batch.quat_wxyz, batch.angular_velocity]
        np.testing.assert_array_equal(flown[:, :13], np.concatenate(arrays, axis=1))
        np.testing.assert_array_equal(flown[:, 16:20], batch.rotor_speed)
        batch.fly(command)
        first = batch.flown
        assert np.all(first[:, :3] != flown[:, :3])
        batch.flown = flown
        np.testing.assert_array_equal(batch.flown, flown)
        batch.fly(command)
        np.testing.assert_allclose(batch.flown, first, atol=2e-6)  # the rounding of the positions is lost

    def test_leaves_drones_alone_whose_row_is_theirs(self):
        batch = batch_of(2)
        batch.fly([10.0, 1, 0, 0] * np.ones((2, 1)))
        batch.flown = np.where([[True], [False]], batch.flown, random_flown(batch, np.random.default_rng(1)))
        other = batch_of(2)
        other.fly([10.0, 1, 0, 0] * np.ones((2, 1)))
        for each in (batch, other):
            each.fly([10.0, 0, 1, 0] * np.ones((2, 1)))
        np.testing.assert_array_equal(batch.flown[0], other.flown[0])

    @pytest.mark.parametrize(
        ("column", "value", "field"),
        [
            (0, np.nan, "position"),
            (4, 1e6, "velocity"),
            (6, 3.0, "quat_wxyz"),
            (11, 1e6, "angular_velocity"),
            (14, np.inf, "integral of the velocity error"),
            (17, -1.0, "rotor_speed"),
            (22, 1e9, "rotor_speed"),
        ],
    )
    def test_refuses_states_that_no_flight_has(self, column, value, field):
        batch = batch_of(2)
        flown = before = batch.flown
        flown = flown.copy()
        flown[1, column] = value
        with refused(ValueError, field, "row 1"):
            batch.flown = flown
        np.testing.assert_array_equal(batch.flown, before)
        with refused(ValueError, "flown", "(2, 24)"):
            batch.flown = flown[:, :23]


class TestPullback:
    @pytest.mark.parametrize("control", COMMANDS)
    @pytest.mark.parametrize("variations", [[], [flockstep.Variation(parameter="mass_scale", low=1.1, high=1.2)]])
    def test_agrees_with_differences(self, control, variations):
        rng, count = np.random.default_rng(3), 200
        batch = batch_of(count, control, variations=variations)
        middle, unit = COMMANDS[control]
        command = (middle + unit * rng.normal(size=(count, 4))).astype(np.float32)
        before = random_flown(batch, rng)
        along, along_command = UNITS * rng.normal(size=(count, 24)), unit * rng.normal(size=(count, 4))
        weights = (rng.normal(size=(count, 24)) / UNITS).astype(np.float32)

        def after(distance):
            batch.flown = before + distance * along
            batch.fly(command + distance * along_command)
            return batch.flown.astype(float)

        expected = ((after(0.01) - after(-0.01)) / 0.02 * weights).sum(1)
        d_before, d_command = batch.pullback(before, command, weights, ticks=2)
        found = (d_before * along).sum(1) + (d_command * along_command).sum(1)
        size = np.abs(d_before * along).sum(1) + np.abs(d_command * along_command).sum(1) + 1
        wrong = np.abs(found - expected) > 2e-3 * size
        assert wrong.mean() < 0.05  # near kinks

    def test_the_same_bits_for_any_number_of_threads_and_drones(self):
        rng, command = np.random.default_rng(4), np.float32([[10, 1, 2, 3]] * 37)
        first = None
        for threads, count in ((1, 37), (4, 37), (1, 5)):
            batch = batch_of(count, num_threads=threads)
            if first is None:
                before, weights = random_flown(batch, rng), rng.normal(size=(37, 24)).astype(np.float32)
            found = batch.pullback(before[:count], command[:count], weights[:count])
            first = first or found
            for one, other in zip(first, found, strict=True):
                np.testing.assert_array_equal(one[:count], other)

    def test_a_rotor_beyond_its_range_and_a_removed_drone_have_no_derivative(self):
        batch, ones = batch_of(3, "rotor_speeds"), np.ones((3, 24), np.float32)
        batch.remove([2])
        command = np.float32([[1500] * 4, [1500, 1500, 1500, 1e6], [1500] * 4])
        d_before, d_command = batch.pullback(batch.flown, command, ones)
        assert (d_command != 0).tolist() == [[True] * 4, [True] * 3 + [False], [False] * 4]
        assert not d_before[2].any()

    def test_refuses_what_it_cannot_differentiate(self):
        batch = batch_of()
        flown, command = batch.flown, np.zeros((1, 4), np.float32)
        with refused(ValueError, "before", "(1, 24)"):
            batch.pullback(flown[:, 1:], command, flown)
        with refused(ValueError, "command", "(1, 4)"):
            batch.pullback(flown, command[0], flown)
        for field, arguments in (("before", [np.nan, 0, 0]), ("command", [0, np.nan, 0]), ("d_after", [0, 0, np.inf])):
            with refused(ValueError, field, "row 0"):
                batch.pullback(flown + arguments[0], command + arguments[1], flown + arguments[2])
        with refused(ValueError, "before", "unit quaternion"):
            batch.pullback(0 * flown, command, flown)
        for ticks in (0, 1001):
            with refused(ValueError, "ticks", ticks):
                batch.pullback(flown, command, flown, ticks)
        with refused(ValueError, "control", "rotor_thrusts"):
            batch_of(control="position").pullback(flown, command, flown)
        with refused(ValueError, "variations", "action_delay_s"):
            late = [flockstep.Variation(parameter="action_delay_s", low=0.0, high=0.1)]
            batch_of(variations=late).pullback(flown, command, flown)
        six = flockstep.Batch(
            HALL, 1, drone="f550", dynamics=flockstep.DynamicsConfig(motion="rotors", control="body_rates")
        )
        for call in (lambda: six.flown, lambda: six.pullback(flown, command, flown)):
            with refused(ValueError, "drone", "6 rotors"):
                call()
        kinematic = flockstep.Batch(HALL, 1)
        with refused(RuntimeError, "pullback"):
            kinematic.pullback(flown, command, flown)
        with refused(RuntimeError, "flown"):
            kinematic.flown  # noqa: B018


class TestTorch:
    torch = pytest.importorskip("torch")

    def test_flies_as_the_batch(self):
        torch, batch, other = self.torch, batch_of(4), batch_of(4)
        command = np.float32([[10, 0.3, 0.2, 0.1]] * 4)
        state = torch.as_tensor(batch.flown)
        for _ in range(3):
            state = flockstep.torch.fly(batch, state, torch.as_tensor(command))
            other.fly(command)
        np.testing.assert_array_equal(state, other.flown)
        assert [part.shape[1] for part in flockstep.torch.parts(state)] == [3, 3, 4, 3, 3, 4, 4]

    @pytest.mark.parametrize("control", ["rotor_thrusts", "body_rates"])
    def test_a_loss_of_several_steps_agrees_with_differences(self, control):
        torch, batch, rng = self.torch, batch_of(6, control), np.random.default_rng(5)
        middle, unit = COMMANDS[control]
        commands = (middle + unit * rng.normal(size=(4, 6, 4))).astype(np.float32)
        start, along = random_flown(batch, rng), unit * rng.normal(size=commands.shape)

        def loss(commands):
            state = torch.as_tensor(start)
            for command in commands:
                state = flockstep.torch.fly(batch, state, command, ticks=2)
            parts = flockstep.torch.parts(state)
            return (parts.velocity.square().sum(1) + parts.angular_velocity.square().sum(1)).sqrt()

        given = torch.tensor(commands, requires_grad=True)
        loss(given).sum().backward()
        ahead, behind = (loss(torch.tensor(commands + h * along, dtype=torch.float32)) for h in (0.02, -0.02))
        found, expected = (given.grad.numpy() * along).sum((0, 2)), (ahead - behind).numpy() / 0.04
        np.testing.assert_allclose(found, expected, rtol=0.02, atol=0.01)

    def test_a_drone_in_contact_has_no_derivative(self):
        torch, batch = self.torch, batch_of(2, "rotor_thrusts")
        flown = batch.flown
        flown[0, 2], flown[0, 5] = 0.1, -10.0  # into the floor
        state, command = torch.tensor(flown, requires_grad=True), torch.full((2, 4), 0.07, requires_grad=True)
        flockstep.torch.fly(batch, state, command).sum().backward()
        assert batch.contact.hit.tolist() == [True, False]
        assert state.grad.any(1).tolist() == command.grad.any(1).tolist() == [False, True]

    def test_a_drone_that_becomes_too_fast_has_no_derivative(self):
        torch, batch = self.torch, batch_of(4, "rotor_speeds")
        flown, rotors = batch.flown, np.float32([2300, 2300, 100, 100])
        flown[:, 3], flown[:, 10] = 1.0, 314.0
        flown[:, 16:20] = flown[:, 20:] = [np.roll(rotors, shift) for shift in range(4)]  # one of them rolls faster
        state = torch.tensor(flown, requires_grad=True)
        with pytest.warns(RuntimeWarning):
            after = flockstep.torch.fly(batch, state, state[:, 16:20])
        after.sum().backward()
        goes_on = after[:, 3] != 0
        assert 0 < goes_on.sum() < 4
        assert state.grad.any(1).tolist() == goes_on.tolist()

    def test_the_example_learns(self, example):
        own_loss = example("own_loss")
        flight = own_loss.Flight(own_loss.THROWS, 0)
        policy = own_loss.train(updates=2)
        assert all(self.torch.isfinite(each).all() for each in policy.parameters())
        action = policy(flight.observe(flight.throw()))
        assert own_loss.loss(flight, flight.fly(flight.throw(), action), action) > 0
