"""The drawn shape of a drone: a given mesh; otherwise one made from its rotors, or its hull without rotors."""

from __future__ import annotations

import numpy as np

from flockstep._core import BodyConfig, DroneModel, World
from flockstep.drone_mesh import DroneMesh, Floats
from flockstep.pictures.style import STYLES
from flockstep.quadrotor_mesh import hull_edges, hull_faces

_HULL = (0.03, 0.09, 0.42)  # linear RGB
_PALE = np.array([0.6, 0.7, 0.85])
DRONE = "drone"  # the body's name


class Body:
    """Shows a drone model as a body.

    Parameters
    ----------
    drone
        The model. With rotors it is a quadrotor with orange front propellers, otherwise its hull.
    mesh
        Shown instead of the model. None: the model.
    style
        A name of `STYLES`.
    """

    def __init__(self, drone: DroneModel, mesh: DroneMesh | None = None, style: str = "bright") -> None:
        hull = np.asarray(drone.hull, float)
        is_hull = mesh is None and drone.to_dict().get("rotors") is None
        self._mesh = mesh or (
            DroneMesh(hull, hull_faces(hull), _HULL) if is_hull else DroneMesh._quadrotor(drone, STYLES[style].drone)
        )
        #: Points (K, 3) m, body frame, that the hull and the mesh lie between.
        self.corners = hull if mesh is None else np.concatenate([hull, mesh.vertices])
        #: Ends of the edges (K, 2, 3) m, body frame, of a hull without a mesh and without rotors.
        self.edges = hull_edges(hull) if is_hull else np.zeros((0, 2, 3))
        self._worlds: dict[bool, World] = {}  # by pale

    def at(self, position: Floats, quat_wxyz: Floats, *, pale: bool = False) -> BodyConfig:
        """Return it at a pose, in pale colours for other drones."""
        if pale not in self._worlds:
            mesh = self._mesh
            colors = 0.35 * mesh.colors + 0.65 * _PALE if pale else mesh.colors
            self._worlds[pale] = DroneMesh(mesh.vertices, mesh.triangles, colors).world()
        return BodyConfig(
            name=DRONE,
            shape="mesh",
            mesh=self._worlds[pale],
            position_m=np.asarray(position, float).tolist(),
            quat_wxyz=np.asarray(quat_wxyz, float).tolist(),
            visibility="visual",
        )
