"""Rotor flight gives the same bits beside any other drones, and after a snapshot or a teleport."""

import numpy as np
import pytest
from rigid_body import FULL, MIDDLE, Start, batch_of, rows_of


def commands_of(control, count):
    """Commands (10, count, 4); row i does not depend on the count."""
    rows = [np.random.default_rng([3, i]).uniform(0.8, 1.2, (10, 4)) for i in range(count)]
    return np.stack(rows, axis=1) * MIDDLE[control]


def begun(control, count, **arguments):
    """A batch in flight; row i depends only on i."""
    batch = batch_of(FULL, count, control=control, ground_effect=True, **arguments)
    starts = [Start.random(1, FULL, seed=i, speed_mps=1.0, rates_radps=1.0).rows()[0] for i in range(count)]
    p, q, v, w, speed = np.split(np.array(starts), [3, 7, 10, 13], axis=1)
    batch.set_pose(p, q)
    batch.set_velocity(v, w, speed)
    return batch


def bits(batch):
    return np.concatenate([rows_of(batch), batch.acceleration, batch.angular_acceleration], axis=1)


@pytest.mark.parametrize("integrator", ["automatic", "rk4"])
@pytest.mark.parametrize("control", MIDDLE)
def test_same_bits(control, integrator):
    """Each drone flies the same bits with another batch size, threads and blocks, and after a snapshot in between."""
    wide = begun(control, 37, num_threads=3, block_size=1, integrator=integrator)
    copy = begun(control, 37, integrator=integrator)
    for step, told in enumerate(commands_of(control, 37)):
        if step == 5:
            copy.restore(wide.snapshot())
        wide.fly(told)
        if step >= 5:
            copy.fly(told)
    np.testing.assert_array_equal(bits(copy), bits(wide))
    for drone in (0, 17, 36):
        alone = begun(control, drone + 1, integrator=integrator)
        only = np.arange(drone + 1) == drone
        for told in commands_of(control, drone + 1):
            alone.fly(told, mask=only)
        np.testing.assert_array_equal(bits(alone)[drone], bits(wide)[drone])
    small = begun(control, 20, block_size=7, integrator=integrator)
    for told in commands_of(control, 20):
        small.fly(told)
    np.testing.assert_array_equal(bits(small), bits(wide)[:20])


@pytest.mark.parametrize("control", MIDDLE)
def test_nothing_is_left_over_after_set_pose(control):
    used, fresh = begun(control, 3), batch_of(FULL, 3, control=control, ground_effect=True)
    for told in commands_of(control, 3):
        used.fly(told)
    used.set_pose(np.zeros((3, 3)), np.tile([1.0, 0, 0, 0], (3, 1)))
    assert not used.contact.hit.any()
    for told in commands_of(control, 3):
        used.fly(told)
        fresh.fly(told)
    np.testing.assert_array_equal(bits(used), bits(fresh))


def test_a_flight_in_parts_is_the_flight():
    """Single ticks give the same result as a whole step, except for the rounding of positions."""
    whole, parts = begun("velocity", 5), begun("velocity", 5)
    for told in commands_of("velocity", 5):
        whole.fly(told)
        for _ in range(5):
            parts.fly(told, ticks=1)
    np.testing.assert_allclose(rows_of(parts), rows_of(whole), rtol=1e-5, atol=1e-5)
    np.testing.assert_array_equal(parts.tick, whole.tick)


def test_motions_too_small_for_a_position_keep_their_bits():
    """The rounding remainder of float32 positions is kept, with the same bits singly and in rows of sixteen."""

    def flown(block_size):
        batch = batch_of(FULL, 32, control="rotor_thrusts", block_size=block_size)
        rng = np.random.default_rng(0)
        batch.set_pose(rng.uniform([-500, -500, 100], [500, 500, 1100], (32, 3)))
        batch.set_velocity(1e-8 * rng.normal(size=(32, 3)))
        for _ in range(20):
            batch.fly(np.full((32, 4), FULL["mass_kg"] * 9.81 / 4))
        return batch.snapshot()

    assert flown(1) == flown(64)
