"""The mesh that shows a drone in pictures, and the convex hull that collides in its place."""

from __future__ import annotations

import base64
import importlib
import io
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flockstep import quadrotor_mesh
from flockstep._core import DroneModel, World, WorldBuilder
from flockstep.hull_simplify import simplified_hull, thickness

if TYPE_CHECKING:
    from typing import Literal

Floats: TypeAlias = npt.NDArray[np.floating[Any]]
Ints: TypeAlias = npt.NDArray[np.integer[Any]]

_SUFFIXES = (".gltf", ".glb", ".obj", ".ply")
_SIZE = 1000.0  # size of a mesh during simplification: the library's thresholds are lengths
_CELLS = (0, 2, 4, 8, 16, 32, 64, 128, 256)  # edge lengths of the grid cells whose vertices are merged first
_FINE = 8  # cells up to this size are always tried, larger ones only if nothing fits yet
_SAMPLES = 20_000  # minimum number of sample points on a surface: neighbours are about 1 % of its size apart
_TURN = 0.02  # fraction of the size: opposite normals add twice this to the distance of two points
_WHITE = (0.8, 0.8, 0.8)
_LEAST_M = 1e-4  # minimum thickness of a hull, required by `DroneModel`
_MOST_CORNERS = 32  # maximum number of hull corners, also required by `DroneModel`


class DroneMesh:
    """An immutable triangle mesh in the body frame, for pictures of a drone.

    Parameters
    ----------
    vertices
        (V, 3) m: x forward, y left, z up, around the centre of mass.
    triangles
        (T, 3) indices of vertices, counter-clockwise seen from outside. They are drawn from both sides.
    colors
        (T, 3) linear RGB in [0, 1], one for each triangle, or (3,), one for all. None: light grey.
    name
        Shown in messages.

    Raises
    ------
    ValueError
        An argument is invalid; the message names it, the expected value and the value given.
    """

    vertices: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
    colors: npt.NDArray[np.float32]
    #: Number of triangles before simplification.
    triangles_in_file: int

    def __init__(
        self, vertices: npt.ArrayLike, triangles: npt.ArrayLike, colors: npt.ArrayLike | None = None, name: str = ""
    ) -> None:
        places, corners = np.asarray(vertices), np.asarray(triangles)
        if places.ndim != 2 or places.shape[1] != 3 or places.dtype.kind not in "fiu":
            raise ValueError(f"vertices: expected numbers of shape (V, 3), got {places.dtype} {places.shape}")
        places = places.astype(np.float32)
        if not np.isfinite(places).all():
            raise ValueError("vertices: expected finite coordinates, got NaN or infinity")
        if corners.ndim != 2 or corners.shape[1] != 3 or not len(corners) or corners.dtype.kind not in "iu":
            raise ValueError(f"triangles: expected integers of shape (T, 3), got {corners.dtype} {corners.shape}")
        if corners.min() < 0 or corners.max() >= len(places):
            got = corners.min() if corners.min() < 0 else corners.max()
            raise ValueError(f"triangles: expected indices of {len(places)} vertices, got {got}")
        shades = np.asarray(_WHITE if colors is None else colors)
        if shades.shape not in ((3,), (len(corners), 3)) or shades.dtype.kind not in "fiu":
            raise ValueError(
                f"colors: expected numbers of shape ({len(corners)}, 3) or (3,), got {shades.dtype} {shades.shape}"
            )
        if not ((shades >= 0) & (shades <= 1)).all():
            raise ValueError("colors: expected linear RGB in [0, 1], got a value outside this range")
        self.vertices = _frozen(places)
        self.triangles = _frozen(corners.astype(np.int32))
        self.colors = _frozen(np.broadcast_to(shades.astype(np.float32), corners.shape))
        self.triangles_in_file = len(corners)
        self._name = name
        self._outermost = self.vertices  # the points that the hull has to enclose

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        *,
        triangles: int = 5000,
        scale: float = 1.0,
        up: Literal["y", "z"] | None = None,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        yaw_deg: float = 0.0,
        meshes_anywhere: bool = False,
    ) -> DroneMesh:
        """Load a ``.gltf``, ``.glb``, ``.obj`` or ``.ply`` file like `World.load`, all visible parts as one mesh.

        Needs the extra ``mesh``: fast-simplification and SciPy if the file has more triangles than ``triangles``, and
        Pillow if it has textures. Each triangle gets the mean of its colours.

        Parameters
        ----------
        path
            The file.
        triangles
            Maximum number of triangles. A smaller mesh stays unchanged; a larger one is simplified, after vertices at
            the same position are merged. Each new triangle has the dominant colour of the triangles it replaces.
        scale, up, origin, meshes_anywhere
            As in `World.load`, with the body frame in place of the world frame: ``origin`` is the position of the
            file's origin in the body frame, in metres.
        yaw_deg
            Rotation about z through the file's origin, counter-clockwise seen from above, applied before ``origin``.
            Models in glTF files usually face +z; they face -y here, and forward with 90.

        Raises
        ------
        ValueError
            An argument or the content of the file is invalid; the message names it.
        ModuleNotFoundError
            A library of the extra is not installed.
        """
        if Path(path).suffix.lower() not in _SUFFIXES:
            raise ValueError(f"path: expected a name that ends with {', '.join(_SUFFIXES)}, got {fspath(path)!r}")
        _require_count("triangles", triangles, 4)
        if not isinstance(yaw_deg, (int, float, np.number)) or not np.isfinite(yaw_deg):
            raise ValueError(f"yaw_deg: expected a finite number, got {yaw_deg!r}")
        world = World.load(path, scale=scale, up=up, origin=origin, meshes_anywhere=meshes_anywhere)
        vertices, corners, colors = _visible(world, fspath(path))
        if yaw_deg:
            turn, moved = np.radians(yaw_deg), np.asarray(origin, float)
            axes = np.array([[np.cos(turn), np.sin(turn), 0], [-np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
            vertices = ((vertices - moved) @ axes + moved).astype(np.float32)
        whole = cls(vertices, corners, colors, Path(path).name)
        if len(corners) <= triangles:
            return whole
        simplified = cls(*_simplified(vertices, corners, colors, int(triangles)), Path(path).name)
        simplified.triangles_in_file = whole.triangles_in_file
        simplified._outermost = _outermost(vertices)
        return simplified

    @classmethod
    def quadrotor(cls, drone: DroneModel) -> DroneMesh:
        """Make a mesh from the numbers of a drone's file: body, arms, motors, propellers and legs.

        It is the look of the drone in `DroneVectorEnv.render`. The propellers stand still, turned so that the hull
        encloses them, if it can.

        Parameters
        ----------
        drone
            A model with rotors, such as ``DroneModel.load("t650")``.

        Raises
        ------
        ValueError
            The model has no rotors.
        """
        if drone.to_dict().get("rotors") is None:
            raise ValueError(f"drone: expected a model with rotors, got {drone!r}")
        return cls._quadrotor(drone, quadrotor_mesh.COLORS)

    @classmethod
    def _quadrotor(
        cls, drone: DroneModel, colors: Mapping[str, quadrotor_mesh.Rgb], *, propellers: bool = True
    ) -> DroneMesh:
        solids = quadrotor_mesh.quadrotor(drone, colors, propellers=propellers)
        starts = np.cumsum([0, *(len(corners) for corners, _, _ in solids)])
        return cls(
            np.concatenate([corners for corners, _, _ in solids]),
            np.concatenate([triangles + start for (_, triangles, _), start in zip(solids, starts, strict=False)]),
            np.concatenate([np.tile(color, (len(triangles), 1)) for _, triangles, color in solids]),
            drone.name,
        )

    @classmethod
    def _of_world(cls, world: World) -> DroneMesh:
        """Return the visible triangles of a world; the inverse of `world`. Textures need Pillow."""
        return cls(*_visible(world, world.name), world.name)

    def hull(self, points: int = 32) -> npt.NDArray[np.float32]:
        """Return the corners (V, 3) m of a convex body that encloses the whole mesh, before simplification.

        If the convex hull has at most ``points`` corners, it is the result; otherwise the result is the smallest body
        found around it. Pass it to `flockstep.DroneModel`. Needs SciPy, which the extra ``mesh`` installs.

        Parameters
        ----------
        points
            Maximum number of corners, 4 to 32.

        Raises
        ------
        ValueError
            The mesh is thinner than 0.1 mm in some direction.
        ModuleNotFoundError
            SciPy is not installed.
        """
        _require_count("points", points, 4, _MOST_CORNERS)
        spatial = _library("scipy.spatial", "scipy", "DroneMesh.hull")
        outermost = self._outermost.astype(float)
        try:
            thick_m = thickness(outermost, _LEAST_M)
        except spatial.QhullError:
            thick_m = 0.0
        if thick_m < _LEAST_M:
            raise ValueError(
                f"{self!r}: expected a mesh at least {_LEAST_M:g} m thick in every direction, so that it has a hull, "
                f"got one of {thick_m:.2g} m"
            )
        return simplified_hull(outermost, points)

    def world(self) -> World:
        """Return the mesh as a `World`, for a body: ``BodyConfig(shape="mesh", mesh=mesh.world())``."""
        builder = WorldBuilder(self._name or "drone")
        corners = self.vertices[self.triangles].reshape(-1, 3)
        builder.mesh(
            corners,
            np.arange(len(corners)).reshape(-1, 3),
            builder.material("paint", (1.0, 1.0, 1.0)),
            colors=np.repeat(self.colors, 3, axis=0),
        )
        return builder.build()

    def to_dict(self) -> dict[str, Any]:
        """Return the mesh as lists and numbers, for `from_dict`."""
        arrays = {"vertices": self.vertices, "triangles": self.triangles, "colors": self.colors}
        lists = {name: array.tolist() for name, array in arrays.items()}
        of_file = {"triangles_in_file": self.triangles_in_file, "outermost": self._outermost.tolist()}
        return {"name": self._name, **lists, **of_file}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> DroneMesh:
        """Make a mesh from the output of `to_dict`."""
        mesh = cls(data["vertices"], data["triangles"], data["colors"], data["name"])
        mesh.triangles_in_file = data["triangles_in_file"]
        mesh._outermost = _frozen(np.asarray(data["outermost"], np.float32))
        return mesh

    def __repr__(self) -> str:
        count = f"{len(self.triangles):,}"
        if self.triangles_in_file > len(self.triangles):
            count += f" of {self.triangles_in_file:,}"
        size = " x ".join(f"{length:.2f}" for length in np.ptp(self.vertices[self.triangles].reshape(-1, 3), axis=0))
        return f"<DroneMesh {self._name!r}, {count} triangle{'s' * (count != '1')}, {size} m>"


def _frozen(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    array = array.copy()
    array.flags.writeable = False
    return array


def _require_count(name: str, value: Any, least: int, most: int | None = None) -> None:
    is_count = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    if not is_count or value < least or (most is not None and value > most):
        expected = f">= {least}" if most is None else f"from {least} to {most}"
        raise ValueError(f"{name}: expected an integer {expected}, got {value!r}")


def _library(module: str, package: str, caller: str) -> Any:
    """Return an optional module, or raise an error that names its package."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            f"{caller} needs {package}, which is not installed: pip install 'flockstep[mesh]'", name=module
        ) from error


def _visible(world: World, path: str) -> tuple[Floats, Ints, Floats]:
    """Return the vertices, the triangles and the triangles' colours of everything visible in a world."""
    mesh, scene, objects = world.mesh(), world.to_dict(), world.objects()
    tints = np.ones(mesh["vertices"].shape, np.float32)
    end = len(tints)
    for part in reversed(scene.get("meshes", [])):  # their vertices come last, in the same order
        begin = end - len(part["vertices"])
        if "colors" in part:
            tints[begin:end] = part["colors"]
        end = begin
    seen = objects["visible"][mesh["objects"]]
    if not seen.any():
        raise ValueError(f"{path}: expected something visible, got only solids without a surface to see")
    corners, uv, materials = mesh["triangles"][seen], mesh["uv"], mesh["materials"][seen]

    base = np.array([material["base_color"] for material in world.materials])
    glow = np.array([material["emissive"] for material in world.materials])
    colors = (base + glow)[materials]
    images = dict(_images(scene))
    # Sample points, so that a triangle that shows a whole picture gets its mean colour.
    triangle, weights = _spread(mesh["vertices"], corners)
    shades = (tints[corners[triangle]] * weights[:, :, None]).sum(axis=1)
    places = (uv[corners[triangle]] * weights[:, :, None]).sum(axis=1)
    for index, material in enumerate(world.materials):
        texture = scene["materials"][material["name"]].get("texture")
        if texture is not None:
            mine = materials[triangle] == index
            shades[mine] *= images[texture](places[mine])
    counts = np.bincount(triangle, minlength=len(corners))
    means = np.stack([np.bincount(triangle, shade, len(corners)) / counts for shade in shades.T], axis=1)
    used, corners = np.unique(corners, return_inverse=True)
    return mesh["vertices"][used], corners.reshape(-1, 3), np.clip(colors * means, 0, 1)


class _Texture:
    """An image (H, W, 3) in sRGB with its wrap modes."""

    def __init__(self, png: bytes, wrap: Sequence[str]) -> None:
        image = _library("PIL.Image", "Pillow, for textures", "DroneMesh.load")
        self._levels = np.asarray(image.open(io.BytesIO(png)).convert("RGB"))
        self._wrap = wrap

    def __call__(self, uv: Floats) -> Floats:
        """Return the linear colours (K, 3) at places (K, 2)."""
        size = self._levels.shape[1::-1]
        at = []
        for place, wrap, pixels in zip(uv.T, self._wrap, size, strict=True):
            if wrap == "repeat":
                place = place % 1
            elif wrap == "mirror":
                place = 1 - np.abs(place % 2 - 1)
            at.append(np.clip((place * pixels).astype(int), 0, pixels - 1))
        srgb = self._levels[at[1], at[0]] / 255
        linear: Floats = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        return linear


def _images(scene: Mapping[str, Any]) -> Iterator[tuple[str, _Texture]]:
    for name, texture in scene.get("textures", {}).items():
        yield name, _Texture(base64.b64decode(texture["png_base64"]), texture.get("wrap", ("repeat", "repeat")))


def _spread(vertices: Floats, triangles: Ints) -> tuple[Ints, Floats]:
    """Return points spread evenly over triangles, at least one on each: triangle indices (K,) and weights (K, 3)."""
    a, b, c = vertices[triangles].astype(float).transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    counts = np.maximum(np.ceil(areas / max(areas.sum(), 1e-300) * _SAMPLES).astype(int), 1)
    triangle = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(triangle)) - np.repeat(np.cumsum(counts) - counts, counts)
    # A sequence that fills the unit square evenly (Roberts' R2), with its upper half folded onto the lower.
    u, v = (0.5 + step * 0.7548776662466927) % 1, (0.5 + step * 0.5698402909980532) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    single = counts[triangle] == 1
    u, v = np.where(single, 1 / 3, u), np.where(single, 1 / 3, v)
    return triangle, np.stack([1 - u - v, u, v], axis=1)


def _outermost(vertices: Floats) -> npt.NDArray[np.float32]:
    """Return the corners of the vertices' convex hull, or all vertices if they have no volume."""
    spatial = _library("scipy.spatial", "scipy", "DroneMesh.load")
    try:
        kept = vertices[spatial.ConvexHull(vertices.astype(float)).vertices]
    except spatial.QhullError:
        kept = vertices
    return _frozen(kept.astype(np.float32))


def _simplified(vertices: Floats, triangles: Ints, colors: Floats, most: int) -> tuple[Floats, Ints, Floats]:
    """Return a similar mesh with at most this many triangles."""
    simplify = _library("fast_simplification", "fast-simplification", "DroneMesh.load").simplify
    spatial = _library("scipy.spatial", "scipy", "DroneMesh.load")
    low = vertices.min(axis=0).astype(float)
    size = float(np.ptp(vertices, axis=0).max()) / _SIZE
    places = (vertices - low) / size
    old = _Surface(places, triangles)
    some = old.points[:: max(len(old.points) // _SAMPLES, 1)]
    tree = spatial.cKDTree(some)
    found: list[tuple[float, Floats, _Surface]] = []
    # The best of these methods depends on the mesh: on its number of borders, sheets and small parts.
    for cell in _CELLS:
        if found and cell > _FINE:
            break
        welded = _welded(places, triangles, cell)
        for preserve_border in (True, False):
            points, faces = welded
            if len(faces) > most:
                points, faces = simplify(points, faces, target_count=most, preserve_border=preserve_border)
                points, faces = _welded(points, faces, 0)
            if 0 < len(faces) <= most:
                new = _Surface(points, faces)
                apart = spatial.cKDTree(new.points).query(some)[0], tree.query(new.points)[0]
                found.append((max((distances**2).mean() for distances in apart), points, new))
    if not found:
        raise ValueError(f"triangles: expected more than {most}: simplification leaves nothing of this mesh")
    _, points, new = min(found, key=lambda one: one[0])
    # Among the nearest old colours of a triangle's points, take the one closest to their mean, which is the dominant
    # colour.
    below = colors[old.triangle[spatial.cKDTree(old.facing()).query(new.facing())[1]]]
    counts = np.bincount(new.triangle)
    means = np.stack([np.bincount(new.triangle, color) / counts for color in below.T], axis=1)
    order = np.lexsort([np.linalg.norm(below - means[new.triangle], axis=1), new.triangle])
    return points * size + low, new.triangles, below[order[np.cumsum(counts) - counts]]


class _Surface:
    """Triangles (T, 3), points (K, 3) spread evenly over them, and each point's triangle (K,)."""

    def __init__(self, vertices: Floats, triangles: Ints) -> None:
        self.triangles = triangles
        self.triangle, weights = _spread(vertices, triangles)
        corners = vertices[triangles]
        self.points = (corners[self.triangle] * weights[:, :, None]).sum(axis=1)
        self._corners = corners

    def facing(self) -> Floats:
        """Return points (K, 6) extended by scaled normals, so that surfaces facing different ways are far apart."""
        a, b, c = self._corners.transpose(1, 0, 2)
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        return np.concatenate([self.points, _TURN * _SIZE * normals[self.triangle]], axis=1)


def _welded(vertices: Floats, triangles: Ints, cell: float) -> tuple[Floats, Ints]:
    """Return a mesh in which vertices at the same position, or in the same grid cell, are merged."""
    keys = vertices + 0.0 if cell == 0 else np.floor(vertices / cell)
    _, joined = np.unique(keys, axis=0, return_inverse=True)
    joined = joined.reshape(-1)
    counts = np.bincount(joined)
    places = np.stack([np.bincount(joined, axis) / counts for axis in vertices.T], axis=1)
    corners = joined[triangles].astype(np.int32)
    corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]  # drop triangles without area
    if cell > 0:  # sheets that now coincide
        corners = corners[np.unique(np.sort(corners, axis=1), axis=0, return_index=True)[1]]
    return places, np.ascontiguousarray(corners)
