"""A world's measurements of itself, against trimesh, SciPy's trees and closed forms."""

import numpy as np
import pytest
import trimesh
from conftest import world_of
from messages import refused
from scipy.spatial import cKDTree

import flockstep

CENTER, RADIUS = np.array([1.0, 0.5, 2.0]), 0.8
CORNERS = np.array([[-2.0, -1.5, 0.3], [-1.0, 0.5, 1.7]])
ROOM = np.array([[-4.0, -3.0, 0.0], [4.0, 3.0, 4.0]])


def as_dict(mesh, **more):
    return {"vertices": np.asarray(mesh.vertices).tolist(), "triangles": np.asarray(mesh.faces).tolist(), **more}


def as_trimesh(world, chord_error_m=1e-3):
    mesh = world.mesh(chord_error_m)
    return trimesh.Trimesh(mesh["vertices"].astype(float), mesh["triangles"], process=False), mesh


SPHERE = {"center": CENTER.tolist(), "radius": RADIUS, "material": "red"}
BOX = {"center": CORNERS.mean(axis=0).tolist(), "size": (CORNERS[1] - CORNERS[0]).tolist(), "material": "blue"}
MATERIALS = {"red": {"base_color": [1, 0, 0], "semantic": 70}, "blue": {"base_color": [0, 0, 1]}}
IN_A_ROOM = {"room": {"min": ROOM[0].tolist(), "max": ROOM[1].tolist()}, "spheres": [SPHERE], "boxes": [BOX]}


@pytest.fixture(scope="module")
def solids():
    return world_of(materials=MATERIALS, **IN_A_ROOM)


@pytest.fixture(scope="module")
def blobs():
    """Three meshes, one of them with two materials."""
    knot = trimesh.creation.torus(1.0, 0.3, major_sections=24, minor_sections=12)
    knot.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], point=[0.2, 0, 0]))
    ball = trimesh.creation.icosphere(2, 0.6)
    ball.apply_translation([2, 1, 0.5])
    builder = flockstep.WorldBuilder("blobs")
    red, blue = builder.material("red", semantic=70), builder.material("blue")
    builder.mesh(knot.vertices, knot.faces, red)
    builder.mesh(ball.vertices, ball.faces, blue, uv=ball.vertices[:, :2])
    builder.mesh([[0, 0, 3], [1, 0, 3], [0, 1, 3]], [[0, 1, 2]], blue)
    return builder.build()


def signed(points):
    """Distances (N,) m to the sphere, the box and the walls of `solids`; negative in a solid and outside the room."""
    ball = np.linalg.norm(points - CENTER, axis=1) - RADIUS
    beyond = np.maximum(CORNERS[0] - points, points - CORNERS[1])
    box = np.linalg.norm(beyond.clip(0), axis=1) + beyond.max(axis=1).clip(None, 0)
    return np.minimum(np.minimum(ball, box), np.minimum(points - ROOM[0], ROOM[1] - points).min(axis=1))


def centers(grid, name):
    return grid["origin"] + grid["cell_m"] * (np.argwhere(np.ones_like(grid[name], bool)) + 0.5)


class TestMesh:
    def test_has_materials_objects_and_places_in_textures(self):
        pixels = np.zeros((2, 2, 3), np.uint8)
        builder = flockstep.WorldBuilder()
        wood = builder.material("wood", texture=builder.texture("planks", pixels))
        stone = builder.material("stone")
        builder.mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], wood, uv=[[0, 0], [0.5, 0], [0, 0.25]])
        builder.mesh([[0, 0, 1], [1, 0, 1], [0, 1, 1]], [[0, 1, 2]], stone)
        builder.box([5, 5, 5], [1, 1, 1], stone)
        mesh = builder.build().mesh()
        assert mesh["objects"].tolist() == [0] * 12 + [1, 2]
        assert mesh["materials"].tolist() == [stone] * 12 + [wood, stone]
        assert mesh["uv"].shape == (len(mesh["vertices"]), 2)
        assert mesh["uv"][8:].tolist() == [[0, 0], [0.5, 0], [0, 0.25], [0, 0], [0, 0], [0, 0]]
        assert not mesh["uv"][:8].any()
        assert {array.dtype.name for array in mesh.values()} == {"float32", "int32"}

    def test_objects_are_counted_beyond_16_bits(self):
        builder = flockstep.WorldBuilder()
        stone = builder.material("stone")
        for i in range(66_000):
            builder.box([i % 300, i // 300, 0], [0.5, 0.5, 0.5], stone)
        world = builder.build()
        assert world.mesh()["objects"].tolist() == np.repeat(np.arange(66_000), 12).tolist()
        assert len(world.objects()["boxes"]) == 66_000


class TestObjects:
    def test_boxes_are_those_of_trimesh(self, solids, blobs):
        turned = {"center": [0, 0, 3], "radius": 0.3, "height": 1.5, "quat_wxyz": [0.8, 0.6, 0, 0]}
        for world in (
            solids,
            blobs,
            world_of(cylinders=[turned], capsules=[turned], boxes=[BOX | {"material": "default"}]),
        ):
            whole, mesh = as_trimesh(world, 1e-4)
            boxes = world.objects()["boxes"]
            assert len(boxes) == mesh["objects"].max() + 1
            for index, box in enumerate(boxes):
                part = whole.submesh([mesh["objects"] == index], append=True)
                np.testing.assert_allclose(box, part.bounds, atol=1.1e-4)

    def test_are_what_cameras_number(self, solids, blobs):
        for world in (solids, blobs):
            camera = flockstep.CameraConfig(
                width_px=64, height_px=64, outputs=("depth", "instance", "semantic"), depth_kind="range"
            )
            batch = flockstep.Batch([world], 2, cameras=[camera])
            quats = [[1, 0, 0, 0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]]  # towards +x and +y
            batch.set_pose([[-3.9, -1.6, 1.0], [0.3, -2.9, 1.2]], quats)
            batch.sense()
            objects, seen = world.objects(), batch.camera().instance
            right = np.array([[0, -1, 0], [1, 0, 0]])
            ahead = np.array([[1, 0, 0], [0, 1, 0]])
            columns, rows = np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5)
            assert len(np.unique(seen[seen > 0])) >= 2
            for i in range(2):
                along = (
                    ahead[i]
                    + ((columns - camera.cx) / camera.fx)[..., None] * right[i]
                    - ((rows - camera.cy) / camera.fy)[..., None] * np.array([0, 0, 1])
                )
                along /= np.linalg.norm(along, axis=-1, keepdims=True)
                hit = seen[i] > 0
                points = batch.position[i] + (batch.camera().depth[i][..., None] * along)[hit]
                box = objects["boxes"][seen[i][hit].astype(int) - 1]
                assert (points >= box[:, 0] - 1e-3).all()
                assert (points <= box[:, 1] + 1e-3).all()
                classes = np.array([material["semantic"] for material in world.materials])
                of_object = classes[objects["materials"][seen[i][hit].astype(int) - 1]]
                np.testing.assert_array_equal(batch.camera().semantic[i][hit], of_object)

    def test_each_object_has_its_material(self):
        corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]
        red, blue = ({"vertices": corners, "triangles": [face]} for face in ([0, 1, 2], [1, 3, 2]))
        world = world_of(materials=MATERIALS, meshes=[red | {"material": "red"}, blue | {"material": "blue"}])
        assert world.objects()["materials"].tolist() == [0, 1]


class TestPointCloud:
    def test_lies_on_the_surfaces_and_says_of_which(self, solids):
        spacing = 0.1
        cloud = solids.point_cloud(spacing)
        points, normals = cloud["points"].astype(float), cloud["normals"].astype(float)
        np.testing.assert_allclose(signed(points), 0, atol=spacing / 100)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)
        assert (signed(points + 0.01 * normals) > 0.005).all(), "normals point to where one can fly"
        ball = cloud["objects"] == 2
        np.testing.assert_allclose(np.linalg.norm(points[ball] - CENTER, axis=1), RADIUS, atol=spacing / 100)
        names = [material["semantic"] for material in solids.materials]
        assert set(cloud["semantic"][ball]) == {70}
        assert set(cloud["semantic"][cloud["objects"] == 1]) == {names[1]}
        assert cloud["semantic"].dtype == np.uint16
        area = 4 * np.pi * RADIUS**2
        assert ball.sum() == pytest.approx(area / spacing**2, rel=0.01)

    @pytest.mark.parametrize("spacing", [0.05, 0.2])
    def test_is_spread_evenly(self, solids, blobs, spacing):
        fine = flockstep.WorldBuilder()  # in row order, the points of its cells would lie one above the other
        fine.heightfield(np.zeros((81, 101)), fine.material("ground"), cell_m=0.2 * spacing)
        for world in (solids, blobs, fine.build()):
            whole, _ = as_trimesh(world, spacing / 100)
            cloud = world.point_cloud(spacing)["points"]
            assert len(cloud) == pytest.approx(whole.area / spacing**2, abs=1)
            samples, _ = trimesh.sample.sample_surface(whole, 20_000, seed=1)
            nearest, _ = cKDTree(cloud).query(samples)
            assert nearest.max() < 2 * spacing
            assert nearest.mean() < 0.5 * spacing  # random points give a half, a square lattice 0.38

    def test_is_the_same_each_time_and_bounded(self, solids, blobs):
        for name, array in blobs.point_cloud(0.1).items():
            np.testing.assert_array_equal(array, blobs.point_cloud(0.1)[name])
        with refused(ValueError, "spacing_m", "50,000,000", 0.001):
            solids.point_cloud(1e-3)
        for bad in (0, -1, np.nan, np.inf):
            with refused(ValueError, "spacing_m"):
                solids.point_cloud(bad)


class TestGrids:
    def test_occupancy_of_solids_is_that_of_closed_forms(self, solids):
        grid = solids.occupancy(0.15)
        assert grid["occupied"].shape == (54, 40, 27)
        np.testing.assert_array_equal(grid["origin"], ROOM[0])
        cells = centers(grid, "occupied")
        half = 0.5 * grid["cell_m"]

        def touched(half):
            ball = np.linalg.norm((np.abs(cells - CENTER) - half).clip(0), axis=1) <= RADIUS
            box = ((cells + half >= CORNERS[0]) & (cells - half <= CORNERS[1])).all(axis=1)
            wall = ((cells - half <= ROOM[0]) | (cells + half >= ROOM[1])).any(axis=1)
            return ball | box | wall

        surely, perhaps = touched(1.001 * half - 1e-5), touched(1.001 * half + 1e-5)
        occupied = grid["occupied"].ravel()
        assert occupied[surely].all()
        assert not occupied[~perhaps].any()
        assert (surely != perhaps).mean() < 1e-3

    def test_a_surface_between_cells_occupies_both(self):
        sheet = world_of(planes=[{"center": [0, 0, 0], "size": [2, 2]}])
        grid = sheet.occupancy(0.5, [[-1, -1, -1], [1, 1, 1]])["occupied"]
        assert grid.shape == (4, 4, 4)
        assert grid[:, :, 1:3].all()
        assert not grid[:, :, [0, 3]].any()
        assert sheet.occupancy(0.5)["occupied"].shape == (4, 4, 1)

    def test_occupancy_of_meshes_is_where_their_points_are(self, blobs):
        grid = blobs.occupancy(0.1, [[-2.03, -2.01, -2], [3, 2, 3.5]])
        cells, occupied = centers(grid, "occupied"), grid["occupied"]
        samples, _ = trimesh.sample.sample_surface(as_trimesh(blobs)[0], 200_000, seed=1)
        touched = np.zeros_like(occupied)
        touched[tuple(((samples - grid["origin"]) / grid["cell_m"]).astype(int).T)] = True
        assert not (touched & ~occupied).any()
        assert (touched & occupied).sum() > 0.9 * occupied.sum()
        near, _ = cKDTree(samples).query(cells[occupied.ravel()])
        assert near.max() < 0.1 * np.sqrt(0.75) + 0.03
        # Nothing lies between the centres of two adjacent free cells.
        free = ~occupied[:-1] & ~occupied[1:]
        origins = (grid["origin"] + 0.1 * (np.argwhere(free) + 0.5)).astype(np.float32)
        assert not np.isfinite(blobs.raycast(origins, np.tile([1.0, 0, 0], (len(origins), 1)), 0.1)["t_hit"]).any()
        assert not occupied[tuple(((np.array([2, 1, 0.5]) - grid["origin"]) / 0.1).astype(int))], "meshes are hollow"

    def test_distances_are_those_of_closed_forms(self, solids):
        grid = solids.distance(0.2, [[-4.5, -3, -0.5], [4, 3.4, 4]])
        expected = signed(centers(grid, "distance_m")).clip(0)
        np.testing.assert_allclose(grid["distance_m"].ravel(), expected, atol=2e-6)
        assert grid["distance_m"].dtype == np.float32

    def test_distances_are_those_of_trimesh(self, blobs):
        grid = blobs.distance(0.25, [[-2, -2, -2], [3, 2, 3.5]])
        triangles = as_trimesh(blobs)[0].triangles
        cells = centers(grid, "distance_m")
        for cell in np.random.default_rng(0).choice(len(cells), 300, replace=False):
            place = np.tile(cells[cell], (len(triangles), 1))
            nearest = trimesh.triangles.closest_point(triangles, place)
            expected = np.linalg.norm(nearest - place, axis=1).min()
            assert grid["distance_m"].ravel()[cell] == pytest.approx(expected, abs=2e-6)

    @pytest.mark.parametrize("name", ["occupancy", "distance"])
    @pytest.mark.parametrize(
        ("arguments", "match"),
        [
            ({"cell_m": 0}, ("cell_m",)),
            ({"cell_m": np.nan}, ("cell_m",)),
            ({"cell_m": 0.001}, ("cell_m", "134,217,728", "0.001", 8000, 6000, 4000)),
            ({"cell_m": 1, "box": [[0, 0, 0], [1, -1, 1]]}, ("box",)),
            ({"cell_m": 1, "box": [[0, 0, 0], [1, np.inf, 1]]}, ("box",)),
            ({"cell_m": 1, "box": [0, 1]}, ("box", 2, 3)),
        ],
    )
    def test_refuse_invalid_arguments(self, solids, name, arguments, match):
        with refused(ValueError, *match):
            getattr(solids, name)(**arguments)


def shell(extents, center):
    """A closed box of triangles seen from inside, like a scan of a room."""
    box = trimesh.creation.box(extents)
    box.invert()
    box.apply_translation(center)
    return box


class TestFreePlaces:
    def test_keep_clear_of_everything(self, solids):
        places = solids.free_places(500, seed=3, clearance_m=0.7).astype(float)
        assert places.shape == (500, 3)
        assert (signed(places) >= 0.7 - 1e-6).all()
        np.testing.assert_array_equal(places, solids.free_places(500, seed=3, clearance_m=0.7))
        np.testing.assert_array_equal(places[:40], solids.free_places(40, seed=3, clearance_m=0.7))
        assert (places != solids.free_places(500, seed=4, clearance_m=0.7)).all()
        assert np.ptp(places, axis=0) == pytest.approx(ROOM[1] - ROOM[0] - 1.4, rel=0.1)
        hull = np.linalg.norm(flockstep.DroneModel().hull, axis=1).max()
        assert signed(solids.free_places(500).astype(float)).min() == pytest.approx(hull, abs=0.02)
        low = solids.free_places(300, box=[[-4, -3, 0], [0, 3, 4]], max_height_m=1)
        assert (low[:, 0] <= 0).all()
        assert (low[:, 2] <= 1 + CORNERS[1, 2]).all()

    def test_lie_above_the_ground(self):
        x, y = np.meshgrid(np.arange(41), np.arange(31))
        heights = 3 * np.sin(x / 5) + 2 * np.cos(y / 4)
        builder = flockstep.WorldBuilder("hills")
        builder.heightfield(heights, builder.material("ground"))
        places = builder.build().free_places(300, max_height_m=4)
        ground = np.array([heights[round(y), round(x)] for x, y, _ in places])
        assert (places[:, 2] > ground - 0.7).all()
        assert (places[:, 2] < ground + 4.7).all()
        assert places[:, 2].max() > heights.max() + 1, "the sky is open"

    def test_lie_within_a_scan_and_in_no_closed_body(self):
        rooms = [
            shell([6, 5, 3], [3, 2.5, 1.5]),
            shell([3, 3, 6], [12, 2.5, 3]),
        ]  # the bounds include empty space beside the first
        solid = trimesh.creation.box([2, 2, 2])
        solid.apply_translation([3, 2.5, 1.5])
        world = world_of(meshes=[as_dict(mesh) for mesh in [*rooms, solid]])
        places = world.free_places(300).astype(float)
        inside = [((places > m.bounds[0]) & (places < m.bounds[1])).all(axis=1) for m in [*rooms, solid]]
        assert (inside[0] | inside[1]).all()
        assert inside[0].any()
        assert inside[1].any()
        assert not inside[2].any()
        reached = world.free_places(50, reachable_from=[1, 1, 1.5])
        assert (reached[:, 0] < 6).all()

    def test_refusals(self, solids):
        sky = world_of(
            spheres=[{"center": [0, 0, 0], "radius": 0.1}], planes=[{"center": [50, 0, 0], "size": [0.01, 0.01]}]
        )
        for world, arguments, match in [
            (solids, {"clearance_m": 2.5}, ("box", "2.5 m", "clearance_m", "none in 100032")),
            (sky, {"box": [[1, -1, -1], [40, 1, 1]]}, ("box", "none in 100032", "100032 with nothing below")),
            (solids, {"clearance_m": -1}, ("clearance_m",)),
            (solids, {"max_height_m": 0}, ("max_height_m",)),
            (solids, {"cell_m": np.nan}, ("cell_m",)),
            (solids, {"box": [[0, 0, 1], [0, 0, 0]]}, ("box",)),
            (solids, {"reachable_from": CENTER}, ("reachable_from",)),
            (solids, {"reachable_from": [0, 0, np.nan]}, ("reachable_from",)),
        ]:
            with refused(ValueError, *match):
                world.free_places(1, **arguments)


class TestMarkers:
    def test_are_replaced(self, room):
        world = room.with_markers(start=[1, 1, 1], goal=[6, 6, 2], spawn_box=[[1, 1, 1], [2, 2, 2]])
        assert (world.start.tolist(), world.goal.tolist(), len(world.waypoints)) == ([1, 1, 1], [6, 6, 2], 0)
        assert world.spawn_box.tolist() == [[1, 1, 1], [2, 2, 2]]
        assert {**world.to_dict(), "markers": 0} == {**room.to_dict(), "markers": 0}
        assert room.start.tolist() == [2, 4, 2]
        bare = world.with_markers()
        assert bare.start is bare.goal is bare.spawn_box is None
        assert room.with_markers(waypoints=[[1, 2, 3]]).waypoints.tolist() == [[1, 2, 3]]
        with refused(ValueError, "markers.goal"):
            room.with_markers(goal=[0, 0, np.inf])
        with refused(ValueError, "start", 3):
            room.with_markers(start=[[0, 0, 0]])

    def test_drawn_ones_can_be_flown(self):
        """Two rooms joined by a door, and a third one without a door."""
        wall = [{"center": [5, y, 1.5], "size": [0.2, 2.3, 3]} for y in (1.15, 4.85)]  # the door is 1.4 m wide
        closed = {"center": [10, 3, 1.5], "size": [0.2, 6, 3]}
        world = world_of(room={"min": [0, 0, 0], "max": [15, 6, 3]}, boxes=[*wall, closed])
        through = 0
        for seed in range(12):
            drawn = world.with_drawn_markers(seed, distance_m=4)
            ends = np.stack([drawn.start, drawn.goal])
            assert np.linalg.norm(ends[1] - ends[0]) >= 4
            assert len({x > 10 for x in ends[:, 0]}) == 1
            through += len({x > 5 for x in ends[:, 0]}) == 2
            assert flockstep.plan(drawn, drawn.start, [drawn.goal]) is not None
            assert drawn.check()["not_navigable"] is None
            assert len(drawn.waypoints) == 0
            guided = world.with_drawn_markers(seed, distance_m=4, waypoints=True)
            assert (guided.start.tolist(), guided.goal.tolist()) == (drawn.start.tolist(), drawn.goal.tolist())
            path = flockstep.plan(drawn, drawn.start, [drawn.goal])
            np.testing.assert_array_equal(guided.waypoints, path[1:-1])
        assert through >= 3
        assert drawn.start.tolist() == world.with_drawn_markers(11, distance_m=4).start.tolist()
        with refused(ValueError, "distance_m", "11 m: none of 1000 pairs"):
            world.with_drawn_markers(distance_m=11)

    def test_a_foreign_file_becomes_an_environment(self, tmp_path):
        furniture = [trimesh.creation.box([0.6, 2, 1.5]), trimesh.creation.cylinder(0.3, 2.8)]
        furniture[0].apply_translation([3, 2, 0.75])
        furniture[1].apply_translation([6, 4, 1.4])
        trimesh.Scene([shell([9, 6, 3], [4.5, 3, 1.5]), *furniture]).export(tmp_path / "flat.glb")
        world = flockstep.World.load(tmp_path / "flat.glb", up="z")
        assert world.start is None
        worlds = [world.with_drawn_markers(seed) for seed in range(3)]
        envs = flockstep.DroneVectorEnv(6, worlds=worlds, random_world=True)
        envs.reset(seed=0)
        for _ in range(20):
            observation, _, _, _, _ = envs.step(envs.action_space.sample())
        assert np.isfinite(observation).all()


class TestCheck:
    def test_counts_edges_as_trimesh_does(self):
        ball = trimesh.creation.icosphere(2)
        punctured = ball.submesh([np.arange(10, len(ball.faces))], append=True)
        cubes = [trimesh.creation.box([1, 1, 1]), trimesh.creation.box([1, 1, 1])]
        cubes[1].apply_translation([1, 1, 0])  # they share an edge
        for meshes in ([ball], [punctured], cubes, [punctured, *cubes]):
            soups = [
                trimesh.Trimesh(m.triangles.reshape(-1, 3), np.arange(3 * len(m.faces)).reshape(-1, 3), process=False)
                for m in meshes
            ]
            report = world_of(meshes=[as_dict(soup) for soup in soups]).check()
            whole = trimesh.util.concatenate(meshes)
            whole.merge_vertices()
            _, uses = np.unique(whole.edges_sorted, axis=0, return_counts=True)
            assert report["open_edges"] == (uses == 1).sum()
            assert report["crowded_edges"] == (uses > 2).sum()
            assert (report["open_edges"] == report["crowded_edges"] == 0) == whole.is_watertight
            assert report["triangles"] == len(whole.faces)
            assert report["objects"] == len(meshes)

    def test_reports_the_contents(self, room, tmp_path):
        report = room.check()
        assert report["name"] == "room"
        assert report["size_m"] == (8, 8, 4)
        assert (report["primitives"], report["objects"], report["triangles"]) == (2, 2, 0)
        assert report["start"] is report["goal"] is report["spawn_box"] is True
        assert report["waypoints"] == 1
        assert report["not_navigable"] is None
        large = flockstep.DroneModel(np.array(np.meshgrid([-3, 3], [-3, 3], [-1, 1])).reshape(3, -1).T)
        assert "markers.start: expected room for the drone" in room.check(large)["not_navigable"]
        assert "markers.start: expected a point, found none" in room.with_markers().check()["not_navigable"]
        forest = flockstep.World.load("outdoor/forest").check()
        assert forest["textures"] == 6
        assert forest["texture_bytes"] == 589_824

        corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], float)
        flat = trimesh.Trimesh(corners, [[0, 1, 2], [1, 3, 2], [0, 1, 1]], process=False)
        flat.export(tmp_path / "flat.glb")
        with refused(UserWarning, "flat.glb", 1):
            world = flockstep.World.load(tmp_path / "flat.glb")
        assert world.check()["not_read"] == ["1 triangle without an area"]
        assert world.with_markers(start=[0, 0, 0]).check()["not_read"] == ["1 triangle without an area"]
        assert world.check()["open_edges"] == 4
