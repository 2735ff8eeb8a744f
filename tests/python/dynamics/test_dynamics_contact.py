"""Rotor-driven drones that hit walls, floor and pillar."""

import time

import numpy as np
import pytest
from conftest import world_of
from rigid_body import GRAVITY, batch_of, frame, plain, to_world

HALF, HEIGHT, RADIUS = 5.0, 6.0, 0.5  # m: the room's half width, its height, the pillar's radius
ROOM = world_of(
    room={"min": [-HALF, -HALF, 0], "max": [HALF, HALF, HEIGHT]}, pillars=[{"center": [0, 0], "radius": RADIUS}]
)
STILL = np.zeros(4)
BODY = plain(min_speed_radps=0.0)  # at zero speed its rotors give no thrust
HULL = np.array(BODY["hull_m"])
NOSE, SIDE = 0.1425, 0.165  # m, from the centre to the flat faces in front and on the left
GAP = 1e-3  # m: more than the distance that the hull keeps from a surface
MODES = ["terminate", "stop", "bounce"]

every_mode = pytest.mark.parametrize("mode", MODES)


def room_of(num_drones=1, mode="bounce", data=BODY, **settings):
    return batch_of(data, num_drones, physics_hz=500, worlds=[ROOM], on_contact=mode, **settings)


def launch(batch, position, velocity, quat_wxyz=None):
    batch.set_pose([position], quat_wxyz)
    batch.set_velocity([velocity], None, [STILL])


def fly_until_hit(batch, ticks=500):
    """Fly tick by tick until a hit; return the velocity before that tick."""
    for _ in range(ticks):
        before = batch.velocity[0].astype(float)
        if batch.fly([STILL], ticks=1).hit[0]:
            return before
    raise AssertionError("nothing was hit")


# A position, a direction towards a surface, and the distance at which the hull hits it: flat, in line with the centre.
CENTRAL = {
    "wall ahead": ([2, 3, 3], [1, 0, 0], HALF - NOSE - 2),
    "wall behind": ([-2, 3, 3], [-1, 0, 0], HALF - NOSE - 2),
    "wall to the left": ([2, 3, 3], [0, 1, 0], HALF - SIDE - 3),
    "wall to the right": ([2, -3, 3], [0, -1, 0], HALF - SIDE - 3),
    "ceiling": ([2, 3, 3], [0, 0, 1], HEIGHT - 0.06 - 3),
    "floor": ([2, 3, 3], [0, 0, -1], 3 - 0.06),
}


def speeds_of_touching_corners(batch):
    """Velocities (K, 3) m/s of the hull's corners on the contact plane."""
    arms = to_world(np.repeat(batch.quat_wxyz, len(HULL), 0), HULL)
    from_plane = (batch.position[0] + arms - batch.contact.point[0]) @ batch.contact.normal[0]
    arms = arms[from_plane < 2 * GAP]
    return batch.velocity[0] + np.cross(to_world(batch.quat_wxyz, batch.angular_velocity)[0], arms)


@pytest.mark.parametrize("where", CENTRAL)
@pytest.mark.parametrize("speed", [8.0, 100.0])
@every_mode
def test_a_central_hit(where, speed, mode):
    place, direction, way = CENTRAL[where]
    direction = np.array(direction, float)
    batch = room_of(mode=mode, restitution=0.6, friction=0.0)
    launch(batch, place, speed * direction)
    before = fly_until_hit(batch)
    before[2] -= GRAVITY / 500  # the velocity at the end of the tick
    np.testing.assert_allclose(batch.contact.normal[0], -direction, atol=1e-6)
    rest = speed / 500 if mode == "bounce" else 0  # m: after a bounce it flies back for the rest of the tick
    assert way - GAP - rest <= (batch.position[0] - place) @ direction <= way
    assert not batch.contact.inside[0]
    if mode == "stop":
        at_corners = speeds_of_touching_corners(batch)
        assert (at_corners @ direction < 1e-4 * speed).all()
        # If it also falls along a wall, it tips over the corners on which it stands: the others lift off.
        assert np.linalg.norm(at_corners, axis=1).min() < 1e-4 * speed
        return
    after = before if mode == "terminate" else before - 1.6 * (before @ direction) * direction
    since = 1.6 * GRAVITY / 500 if direction[2] else 0  # m/s: the velocity at the hit, not at the end of the tick
    np.testing.assert_allclose(batch.velocity[0], after, atol=1e-3 + since, rtol=1e-4)
    np.testing.assert_array_equal(batch.acceleration[0], 0)
    np.testing.assert_allclose(batch.angular_velocity[0], 0, atol=1e-4)


@pytest.mark.parametrize("speed", [8.0, 100.0])
def test_a_pillar_throws_back_a_flat_nose(speed):
    """The contact is a line. For any first contact point on it, the others bounce in the same tick."""
    batch = room_of(restitution=0.6, friction=0.0)
    launch(batch, [-3, 0, 3], [speed, 0, 0])
    fly_until_hit(batch)
    assert -RADIUS - NOSE - GAP - speed / 500 <= batch.position[0, 0] <= -RADIUS - NOSE
    np.testing.assert_allclose(batch.contact.normal[0], [-1, 0, 0], atol=1e-3)
    assert -0.6 * speed <= batch.velocity[0, 0] <= -0.4 * speed
    assert not batch.fly([STILL], ticks=1).hit[0]


@pytest.mark.parametrize("friction", [0.0, 0.05, 10.0])
def test_an_edge_that_hits_a_wall_turns_the_body(friction):
    """Upright and yawed, its edge touches along its whole length: seen from above, one impulse at one point."""
    batch, yaw = room_of(restitution=0.5, friction=friction), np.radians(15)
    turned = [[np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]]
    launch(batch, [HALF - 0.25, 3, 3], [2, -1.5, 0], turned)
    fly_until_hit(batch)
    mass, inertia = BODY["mass_kg"], BODY["inertia_kgm2"][2]
    arms = to_world(np.repeat(turned, len(HULL), 0), HULL)
    arm = arms[np.argmax(arms[:, 0]), :2]
    # (2, 2) velocity gain at the edge per impulse (x, y) on it.
    across = np.array([-arm[1], arm[0]])
    gain = np.eye(2) / mass + np.outer(across, across) / inertia
    start = np.array([2, -1.5])
    impulse = np.linalg.solve(gain, [-1 - 2, 1.5])  # makes the edge stick
    if abs(impulse[1]) > friction * -impulse[0]:
        slides = np.array([-1, friction])
        impulse = slides * -3 / (gain @ slides)[0]
    np.testing.assert_allclose(batch.velocity[0, :2], start + impulse / mass, atol=2e-3)
    assert batch.angular_velocity[0, 2] == pytest.approx(across @ impulse / inertia, rel=2e-3)
    assert abs(across @ impulse / inertia) > 1


def test_slow_hits_do_not_bounce():
    batch = room_of(restitution=1.0, friction=0.0)
    launch(batch, [HALF - NOSE - 1e-3, 3, 3], [0.04, 0, 0])
    fly_until_hit(batch)
    assert batch.velocity[0, 0] == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("mode", ["terminate", "bounce", "stop"])
def test_with_contacts_that_terminate_a_drone_stays(mode):
    """It stays for the rest of the step; with other settings it flies on."""
    batch = room_of(mode=mode)
    launch(batch, [2, 3, 3], [100, 0, 0])
    batch.fly([STILL], ticks=60)  # the hit is in tick 15
    assert batch.contact.hit[0]
    assert batch.tick[0] == 60
    fell, fell_until_hit = 3 - batch.position[0, 2], GRAVITY / 2 * ((HALF - NOSE - 2) / 100) ** 2
    if mode == "terminate":
        assert fell == pytest.approx(fell_until_hit, abs=1e-3)
    else:
        assert fell > fell_until_hit + 0.02


def test_a_body_that_slides_on_the_floor_is_slowed_by_friction():
    """The deceleration is friction times gravity, and the sliding distance follows from it."""
    batch = room_of(restitution=0.0, friction=0.2)
    launch(batch, [-4, 3, 0.0602], [3, 0, 0])
    for _ in range(200):
        batch.fly([STILL])
    way = 3**2 / (2 * 0.2 * GRAVITY)
    assert batch.position[0, 0] + 4 == pytest.approx(way, rel=0.1)
    np.testing.assert_allclose(batch.velocity[0], 0, atol=0.05)


@pytest.mark.parametrize("mode", ["stop", "bounce"])
def test_a_level_drone_comes_to_rest_on_the_floor(mode):
    batch = room_of(mode=mode)
    launch(batch, [3, 3, 0.5], [0, 0, 0])
    for _ in range(300):
        batch.fly([STILL])
    np.testing.assert_allclose(batch.position[0], [3, 3, 0.06], atol=GAP)
    np.testing.assert_allclose(batch.velocity[0], 0, atol=0.05)
    np.testing.assert_allclose(batch.angular_velocity[0], 0, atol=0.05)


@pytest.mark.parametrize("mode", ["stop", "bounce"])
def test_a_drone_takes_off_again(mode):
    """It flew to the floor, and then flies to the next commanded position."""
    batch = room_of(mode=mode, data=frame(), control="position")
    batch.set_pose([[3, 3, 1.0]])
    hit = False
    for _ in range(200):
        hit |= bool(batch.fly([[3, 3, -1.0, 0]]).hit[0])
    assert hit
    for _ in range(1500):
        batch.fly([[3, 3, 2.0, 0]])
    np.testing.assert_allclose(batch.position[0], [3, 3, 2], atol=0.05)


BOX = world_of(
    room={"min": [-9, -9, -9], "max": [9, 9, 9]},
    boxes=[{"center": [0, 0, -1], "size": [8, 8, 2]}],
    spheres=[{"center": [-7, 0, 0], "radius": 1}],
)


@pytest.mark.parametrize(("world", "place"), [(ROOM, [3, 3, 0.045]), (BOX, [3, 3, 0.045]), (BOX, [-7, 0, 1.045])])
@pytest.mark.parametrize("mode", ["stop", "bounce"])
def test_what_starts_inside_is_moved_out(world, place, mode):
    """It leaves at 2.5 m/s or faster; on the way forces accelerate it as in the open."""
    batch, free = (
        batch_of(frame(), 1, 50, worlds=[room], on_contact=mode, control="velocity")
        for room in (
            world,
            world_of(room={"min": [-99] * 3, "max": [99] * 3}),
        )
    )
    for each in (batch, free):
        each.set_pose([place])
    inside = 0
    while batch.fly([[0, 0, 1, 0]], ticks=1).inside[0]:
        free.fly([[0, 0, 1, 0]], ticks=1)
        inside += 1
        assert batch.contact.hit[0]
        np.testing.assert_array_equal(batch.velocity, free.velocity)
    assert 0 < inside < 10
    for _ in range(50):
        assert not batch.fly([[0, 0, 1, 0]]).hit[0]


@pytest.mark.parametrize("mode", ["stop", "bounce"])
def test_what_starts_inside_and_wants_to_go_deeper_ends_on_the_surface(mode):
    batch = batch_of(frame(), 1, 50, worlds=[BOX], on_contact=mode, control="velocity")
    batch.set_pose([[3, 3, 0.045]])
    batch.fly([[0, 0, -1, 0]])
    for _ in range(50):
        batch.fly([[0, 0, -1, 0]])
        assert not batch.contact.inside[0]
        assert abs(batch.position[0, 2] - 0.06) < GAP


@pytest.mark.parametrize("mode", ["stop", "bounce"])
def test_a_corner_costs_little_more_than_a_floor(mode):
    """Duplicate contact points, or points a tenth of a millimetre off plane, would need hundreds of rounds."""

    def pressed(place, command):
        batch = batch_of(frame(), 16, 100, worlds=[ROOM], on_contact=mode, control="velocity")
        batch.set_pose(place + np.random.default_rng(0).uniform(0, 0.05, (16, 3)))
        command = np.tile(command, (16, 1)).astype(np.float32)
        for _ in range(100):
            batch.fly(command)
        assert batch.contact.hit.mean() > 0.8
        return lambda: batch.fly(command, ticks=20)

    def cost(fly):
        begun = time.process_time()
        fly()
        return time.process_time() - begun

    floor, corner = pressed([3, 3, 0.1], [0, 0, -1, 0]), pressed([4.6, 4.6, 0.1], [3, 3, -1, 0])
    times = np.array([[cost(floor), cost(corner)] for _ in range(30)])
    assert np.median(times[:, 1]) < 8 * np.median(times[:, 0])
