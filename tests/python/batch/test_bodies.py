"""Bodies of a batch: solids that move, which LiDARs detect and drones hit."""

import numpy as np
import pytest
from conftest import begun, world_of
from messages import refused

import body_attack
import flockstep
from flockstep import BodyConfig, BodyMotion

ROOM = {
    "flockstep_scene": 1,
    "name": "room",
    "room": {"min": [0, 0, 0], "max": [20, 20, 10]},
    "markers": {"start": [5, 10, 2]},
}


def room(**more):
    return flockstep.World.from_dict({**ROOM, **more})


def batch_with(bodies, num_drones=1, world=None, **more):
    return flockstep.Batch([world or room()], num_drones, bodies=bodies, **more)


class TestArrays:
    def test_every_episode_begins_with_the_configured_bodies(self):
        first = BodyConfig(position_m=[8, 10, 2], motion=BodyMotion(velocity_mps=[1, 0, 0], turn_rate_dps=[0, 0, 90]))
        batch = batch_with([first, BodyConfig(shape="sphere", position_m=[3, 3, 3])], 4, max_bodies=3)
        bodies = batch.bodies
        assert len(bodies) == 3
        assert bodies.position.shape == (4, 3, 3)
        assert bodies.quat_wxyz.shape == (4, 3, 4)
        assert bodies.active.tolist() == [[True, True, False]] * 4
        assert bodies.scripted.tolist() == [[True, True, False]] * 4
        assert (bodies.position[:, 0] == [8, 10, 2]).all()
        assert (bodies.velocity[:, 0] == [1, 0, 0]).all()
        np.testing.assert_allclose(bodies.angular_velocity[:, 0], [[0, 0, np.pi / 2]] * 4, rtol=1e-6)
        for _ in range(5):
            batch.move(batch.position)
        np.testing.assert_allclose(bodies.position[:, 0], [[8.5, 10, 2]] * 4, rtol=1e-6)
        np.testing.assert_allclose(
            bodies.quat_wxyz[:, 0], [[np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)]] * 4, rtol=1e-6
        )
        batch.bodies.spawn(BodyConfig())
        batch.bodies.set_pose(np.ones((4, 3, 3)))
        batch.begin_episode()
        assert (batch.bodies.position[:, 0] == [8, 10, 2]).all()
        assert batch.bodies.active.tolist() == [[True, True, False]] * 4

    def test_only_envs_that_fly_move_their_bodies(self):
        batch = batch_with([BodyConfig(position_m=[8, 10, 2], motion=BodyMotion(velocity_mps=[1, 0, 0]))], 3)
        batch.move(batch.position, mask=np.array([True, False, True]))
        np.testing.assert_allclose(batch.bodies.position[:, 0, 0], [8.1, 8, 8.1], rtol=1e-6)

    def test_a_body_that_leaves_the_world_is_removed(self):
        batch = batch_with([BodyConfig(position_m=[999_500, 0, 0], motion=BodyMotion(velocity_mps=[1e4, 0, 0]))])
        batch.move(batch.position)
        assert not batch.bodies.active.any()
        assert batch.bodies.config(0, 0) is None

    def test_views_keep_the_batch_alive(self):
        bodies = batch_with([BodyConfig(position_m=[1, 2, 3])]).bodies
        position = bodies.position
        del bodies
        assert position.tolist() == [[[1, 2, 3]]]
        assert not position.flags.writeable

    def test_a_batch_without_bodies_has_no_slots(self):
        batch = batch_with([])
        assert len(batch.bodies) == 0
        assert batch.bodies.position.shape == (1, 0, 3)
        with refused(ValueError, "no slots for bodies", "max_bodies=1"):
            batch.bodies.spawn(BodyConfig())


class TestCalls:
    def test_spawn_takes_the_first_free_slot(self):
        batch = batch_with([BodyConfig(name="first")], 3, max_bodies=3)
        mask = np.array([True, False, True])
        ball = BodyConfig(name="ball", shape="sphere")
        assert batch.bodies.spawn(ball, position=np.full((3, 3), 4.0), mask=mask).tolist() == [1, -1, 1]
        assert batch.bodies.spawn(ball, velocity=np.full((3, 3), 2.0)).tolist() == [2, 1, 2]
        assert batch.bodies.config(0, 1).name == "ball"
        assert batch.bodies.config(1, 2) is None
        assert (batch.bodies.velocity[0, 2] == 2).all()
        batch.bodies.remove(np.array([[True, False, False]] * 3))
        assert batch.bodies.spawn(ball).tolist() == [0, 0, 0]

    def test_a_spawned_script_runs_on(self):
        batch = batch_with([], max_bodies=1)
        batch.move(batch.position)
        batch.bodies.spawn(BodyConfig(position_m=[1, 1, 1], motion=BodyMotion(velocity_mps=[1, 0, 0])))
        assert batch.bodies.position[0, 0].tolist() == [1, 1, 1]  # constant velocity begins where it was spawned
        batch.move(batch.position)
        np.testing.assert_allclose(batch.bodies.position[0, 0], [1.1, 1, 1], rtol=1e-6)

    def test_calls_concern_only_selected_bodies(self):
        batch = batch_with([BodyConfig(), BodyConfig()], 2, max_bodies=3)
        mask = np.array([[True, False, True], [False, True, True]])
        position = np.arange(18).reshape(2, 3, 3)
        batch.bodies.set_pose(position, mask=mask)
        assert batch.bodies.position[0, 0].tolist() == [0, 1, 2]
        assert batch.bodies.position[1, 1].tolist() == [12, 13, 14]
        assert (batch.bodies.position[0, 1] == 0).all()
        assert (batch.bodies.position[:, 2] == 0).all()  # free slots
        assert batch.bodies.scripted.tolist() == [[False, True, False], [True, False, False]]
        batch.bodies.set_velocity(angular_velocity=np.full((2, 3, 3), 0.5), mask=np.array([False, True]))
        assert (batch.bodies.angular_velocity[1, :2] == 0.5).all()
        assert (batch.bodies.angular_velocity[0] == 0).all()
        batch.bodies.remove(np.array([True, False]))
        assert batch.bodies.active.tolist() == [[False, False, False], [True, True, False]]


class TestRefusals:
    @pytest.fixture
    def batch(self):
        return batch_with([BodyConfig(), BodyConfig()], 2, max_bodies=3)

    @pytest.mark.parametrize(
        ("call", "said"),
        [
            (lambda b: b.set_pose(np.full((2, 3, 3), np.nan)), ["position of body 0 in env 0", "finite", np.nan]),
            (lambda b: b.set_pose(np.full((2, 3, 3), 1e9)), ["position of body 0 in env 0", "1e+09"]),
            (lambda b: b.set_pose(np.zeros((2, 2, 3))), ["position", (2, 3, 3), (2, 2, 3)]),
            (lambda b: b.set_pose(quat_wxyz=np.zeros((2, 3, 4))), ["quat_wxyz of body 0 in env 0", "unit"]),
            (lambda b: b.set_velocity(np.full((2, 3, 3), 1e9)), ["velocity of body 0 in env 0"]),
            (lambda b: b.set_velocity(None, np.full((2, 3, 3), np.inf)), ["angular_velocity of body 0 in env 0"]),
            (lambda b: b.set_velocity(None, np.full((2, 3, 3), 32)), ["angular_velocity of body 0 in env 0", 31.4159]),
            (lambda b: b.remove(np.zeros((3, 2), bool)), ["mask"]),
            (lambda b: b.remove(np.zeros(2)), ["mask"]),
            (lambda b: b.spawn(BodyConfig(), position=np.full((2, 3), np.nan)), ["position of env 0", "finite"]),
            (lambda b: b.spawn(BodyConfig(name="third")), ["env 0", "free slot", "third"]),
            (lambda b: b.config(2, 0), ["env", 2]),
            (lambda b: b.config(0, 3), ["body", 3]),
        ],
    )
    def test_a_bad_call_changes_nothing(self, batch, call, said):
        if "free slot" in said:
            batch.bodies.spawn(BodyConfig())
        before = batch.snapshot()
        with refused(ValueError, *said):
            call(batch.bodies)
        assert batch.snapshot() == before

    def test_a_bad_value_of_another_row_is_not_read(self, batch):
        position = np.full((2, 3, 3), np.nan)
        position[1, 0] = 3
        batch.bodies.set_pose(position, mask=np.array([[False] * 3, [True, False, True]]))
        assert batch.bodies.position[1, 0].tolist() == [3, 3, 3]

    @pytest.mark.parametrize(
        ("make", "fields", "said"),
        [
            (BodyConfig, {"shape": "sphere", "size_m": [1, 2, 1]}, ["body.size_m", "equal"]),
            (BodyConfig, {"shape": "cylinder", "size_m": [1, 2, 1]}, ["body.size_m", "equal"]),
            (BodyConfig, {"shape": "capsule", "size_m": [1, 1, 0.5]}, ["body.size_m", "at least"]),
            (BodyConfig, {"shape": "cone"}, ["shape", "cone"]),
            (BodyConfig, {"quat_wxyz": [0, 0, 0, 0]}, ["body.quat_wxyz", "unit"]),
            (BodyConfig, {"name": "a b"}, ["body.name", "a b"]),
            (BodyMotion, {"kind": "waypoints"}, ["body.motion.points_m", "two points"]),
            (BodyMotion, {"kind": "waypoints", "points_m": [[0, 0, 0], [0, 0, 0]]}, ["body.motion.points_m[1]"]),
            (BodyMotion, {"kind": "hinge", "axis": [0, 0, 0]}, ["body.motion.axis"]),
            (BodyMotion, {"kind": "hinge", "axis": [1e-40, 0, 0]}, ["body.motion.axis", 1e-06]),
            (BodyMotion, {"kind": "orbit", "axis": [1e-7, 0, 0]}, ["body.motion.axis", 1e-06]),
            (BodyMotion, {"kind": "random_walk", "box_min_m": [1, 0, 0]}, ["body.motion.box_max_m[0]"]),
            (batch_with, {"bodies": [BodyConfig()] * 3, "max_bodies": 2}, ["max_bodies", 2]),
            (batch_with, {"bodies": [], "max_bodies": 5000}, ["max_bodies", 5000]),
        ],
    )
    def test_bad_configurations_name_their_field(self, make, fields, said):
        with refused(ValueError, *said):
            make(**fields)


def test_an_invisible_body_is_hit_only_by_drones():
    ahead = {"size_m": [0.2, 2, 2], "position_m": [7, 10, 2]}
    lidar = flockstep.LidarConfig(beams=1, hfov_deg=1, max_range_m=5)
    for visibility, sees, hits in (("full", True, True), ("visual", True, False), ("solid", False, True)):
        batch = batch_with([BodyConfig(visibility=visibility, **ahead)], lidar=lidar)
        batch.sense()
        assert np.isfinite(batch.lidar().ranges).all() == sees
        batch.move([[9, 10, 2]])
        assert batch.contact.hit.all() == hits


class TestContacts:
    def test_a_body_runs_into_a_standing_drone(self):
        plate = BodyConfig(size_m=[0.2, 2, 2], position_m=[8, 10, 2], motion=BodyMotion(velocity_mps=[-2, 0, 0]))
        batch = batch_with([plate])
        while not batch.contact.hit[0]:
            assert batch.bodies.position[0, 0, 0] > 5
            batch.move(batch.position)
        contact = batch.contact
        assert contact.body.tolist() == [0]
        np.testing.assert_allclose(contact.surface_velocity, [[-2, 0, 0]], rtol=1e-5)
        np.testing.assert_allclose(contact.normal, [[-1, 0, 0]], atol=1e-6)
        before = batch.position.copy()
        batch.move(batch.position)
        np.testing.assert_allclose(batch.position - before, [[-0.2, 0, 0]], atol=1e-4)  # the plate pushes it
        assert not batch.contact.inside[0]

    def test_a_static_contact_names_no_body(self):
        batch = batch_with([BodyConfig(position_m=[15, 15, 5])])
        batch.move([[-3, 10, 2]])
        assert batch.contact.hit[0]
        assert batch.contact.body[0] == -1
        assert (batch.contact.surface_velocity == 0).all()


FAST = {
    "turns": BodyMotion(turn_rate_dps=[0, 0, 2000]),
    "orbits": BodyMotion(kind="orbit", period_s=0.4, center_m=[10, 5, 5]),
    "slides": BodyMotion(kind="slider", travel_m=[4, 0, 0], period_s=0.1),
    "swings": BodyMotion(kind="hinge", angle_deg=180, period_s=0.15, center_m=[8, 5, 5]),
    "walks": BodyMotion(kind="random_walk", period_s=0.2, box_min_m=[8, 5, 5], box_max_m=[12, 5, 5]),
    "turns round": BodyMotion(kind="waypoints", points_m=[[10, 5, 5], [11, 5, 5]], speed_mps=6, route="back_and_forth"),
}


@pytest.mark.parametrize("motion", FAST.values(), ids=FAST)
def test_scripts_that_contacts_could_not_follow_are_refused(motion):
    world = world_of(room={"min": [0] * 3, "max": [20, 20, 10]})
    fast = BodyConfig(shape="sphere", size_m=[0.5] * 3, position_m=[10, 10, 5], motion=motion)
    slow = flockstep.ClockConfig(policy_hz=10)
    with refused(ValueError, "too fast for contacts", 10, "physics_hz to") as caught:
        flockstep.Batch([world], 1, bodies=[fast], clock=slow)
    with refused(ValueError, "too fast for contacts"):
        flockstep.Batch([world.with_bodies([fast])], 1, clock=slow)
    batch = flockstep.Batch([world], 1, max_bodies=1, clock=slow)
    with refused(ValueError, "too fast for contacts"):
        batch.bodies.spawn(fast)
    assert not batch.bodies.active.any()
    enough = float(str(caught.value).split("physics_hz to ")[1].split()[0])
    clock = flockstep.ClockConfig(policy_hz=10, physics_hz=10 * round(enough / 10 + 0.5))
    flockstep.Batch([world], 1, bodies=[fast], clock=clock)


def test_a_fast_body_hits_what_stands_in_its_way():
    """A ball flies around its circle of 5 m in 0.4 s and meets the drone in every turn."""
    world = world_of(room={"min": [0] * 3, "max": [20, 20, 10]})
    motion = BodyMotion(kind="orbit", period_s=0.4, center_m=[10, 10, 5])
    ball = BodyConfig(shape="sphere", size_m=[0.5] * 3, position_m=[15, 10, 5], motion=motion)
    clock = flockstep.ClockConfig(policy_hz=10, physics_hz=1000)
    batch = flockstep.Batch([world], 1, bodies=[ball], clock=clock)
    on_circle = [10 - 5 * np.sqrt(0.5), 10 - 5 * np.sqrt(0.5), 5]
    hits = 0
    for _ in range(8):
        batch.set_pose([on_circle])
        hits += int(batch.move(batch.position).hit[0])
    assert hits >= 2
    batch.set_pose([[10, 10 - 3.54, 5]])  # inside the circle, on the chord of a quarter turn
    assert not any(batch.move(batch.position).hit[0] for _ in range(8))


def test_an_env_takes_bodies():
    env = flockstep.DroneVectorEnv(2, bodies=BodyConfig(position_m=[2, 2, 1]), max_bodies=2)
    assert env.batch.bodies.active.tolist() == [[True, False]] * 2
    again = flockstep.DroneVectorEnv.from_recipe(env.recipe.to_json())
    assert again.batch.bodies.position.tolist() == env.batch.bodies.position.tolist()
    assert len(again.batch.bodies) == 2
    with refused(TypeError, "bodies"):
        flockstep.DroneVectorEnv(2, bodies="cars")


class TestCameras:
    CAMERA = flockstep.CameraConfig(
        width_px=64, height_px=48, outputs=["rgb", "depth", "semantic", "instance"], capture_mode="on_movement"
    )

    @pytest.mark.parametrize("change", ["script", "pose", "spawn", "remove"])
    def test_a_change_of_bodies_makes_frames_stale(self, change):
        motion = BodyMotion(velocity_mps=[0, 1, 0]) if change == "script" else BodyMotion()
        body = BodyConfig(position_m=[8, 10, 2], motion=motion)
        batch = batch_with([body], 2, max_bodies=2, cameras=[self.CAMERA])
        batch.sense()
        steps = batch.camera().frame_step.copy()
        batch.sense()
        assert (batch.camera().frame_step == steps).all()  # nothing has moved
        only_first = np.array([True, False])
        if change == "script":
            batch.move(batch.position, mask=only_first)
        elif change == "pose":
            batch.bodies.set_pose(batch.bodies.position + 1, mask=only_first)
        elif change == "spawn":
            batch.bodies.spawn(body, position=[[8, 9, 2]] * 2, mask=only_first)
        else:
            batch.bodies.remove(only_first)
        before = batch.camera().depth.copy()
        batch.sense()
        assert (batch.camera().frame_step > steps).tolist() == [True, False]
        assert (batch.camera().depth[0] != before[0]).any()
        assert (batch.camera().depth[1] == before[1]).all()

    def test_a_restored_frame_shows_the_bodies_of_its_time(self):
        body = BodyConfig(position_m=[8, 10, 2], motion=BodyMotion(velocity_mps=[0, 1, 0]))
        camera = flockstep.CameraConfig(width_px=64, height_px=48, outputs=["rgb"], capture_mode="on_demand")
        batch = batch_with([body], cameras=[camera])
        batch.capture()
        frame = batch.camera().rgb.copy()
        for _ in range(5):
            batch.move(batch.position)
        blob = batch.snapshot()
        batch.capture()
        assert (batch.camera().rgb != frame).any()
        batch.restore(blob)
        assert (batch.camera().rgb == frame).all()


class TestPictures:
    BALL = BodyConfig(shape="sphere", size_m=[2, 2, 2], position_m=[9, 10, 2], color=[0, 0, 1])

    def test_a_picture_shows_the_given_bodies(self):
        camera = flockstep.CameraConfig(width_px=32, height_px=32, outputs=["instance"])
        view = {"position": [5, 10, 2], "camera": camera}
        world = room()
        assert (flockstep.render(world, **view)["instance"] < 61440).all()
        assert flockstep.render(world, **view, bodies=[self.BALL])["instance"][16, 16] == 61440

    @pytest.mark.parametrize("view", ["top", "third_person", ((3, 10, 2), (9, 10, 2))])
    def test_an_env_draws_its_bodies(self, view):
        task = flockstep.DodgeConfig()
        envs = begun(2, task=task, worlds=room(), max_bodies=1, render_mode="rgb_array", render_view=view)
        envs.batch.set_pose([[5, 10, 2]] * 2)
        empty = envs.render()
        envs.batch.bodies.spawn(self.BALL, mask=np.array([True, False]))
        shown = envs.render()
        assert (shown[0] != empty[0]).any()
        assert (shown[1] == empty[1]).all()
        envs.batch.bodies.set_pose(np.full((2, 1, 3), [9, 12, 2]))
        moved = envs.render()
        assert (moved[0] != shown[0]).any()


@pytest.mark.parametrize("seed", [0, 100, 200])
def test_random_calls_break_nothing(seed):
    """A share of `./dev try attacks`: random calls of `batch.bodies`, many of them invalid."""
    counts = body_attack.run(600, seed)
    assert counts["refused"] > 100
    for call in ("spawn", "set_pose", "set_velocity", "remove", "fly", "restore", "remove_all", "check_twin"):
        assert counts[f"accepted {call}"] > 0, call


def test_a_refused_call_that_changes_something_is_found():
    attack = body_attack.Attack(0)

    def bad_call():
        attack.batch.bodies.spawn(attack.valid_body())
        raise ValueError

    attack.batch.bodies.remove()
    attack.spawn = bad_call
    with pytest.raises(AssertionError, match=r"a refused bad_call changed .*active"):
        [attack.call() for _ in range(100)]
