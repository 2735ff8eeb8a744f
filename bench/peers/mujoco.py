"""MuJoCo: one drone at a time, and rays through all triangles as one geom."""

from __future__ import annotations

from importlib.metadata import version

import mujoco
import numpy as np

from peers import rate
from peers.cases import FAR_M, PHYSICS_HZ, TICKS, Array, Cast, Flown, Mode, Quadrotor, Rays


def fly(case: Quadrotor) -> Flown:
    sites = "".join(f'<site name="r{i}" pos="{" ".join(map(str, place))}"/>' for i, place in enumerate(case.position_m))
    motors = "".join(f'<motor site="r{i}" gear="0 0 1 0 0 {-case.spin[i] * case.torque_ratio_m}"/>' for i in range(4))
    inertia = " ".join(map(str, case.inertia_kgm2))
    text = f"""<mujoco><option timestep="{1 / PHYSICS_HZ}" gravity="0 0 -9.81"/><worldbody><body><freejoint/>
        <inertial pos="0 0 0" mass="{case.mass_kg}" diaginertia="{inertia}"/>{sites}</body></worldbody>
        <actuator>{motors}</actuator></mujoco>"""
    found = Flown(version("mujoco"))
    for name in ("euler", "rk4"):
        model = mujoco.MjModel.from_xml_string(text)
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}")
        data = mujoco.MjData(model)
        for told in case.told_radps:
            data.ctrl[:] = [case.thrust_n * speed**2 for speed in told]
            mujoco.mj_step(model, data, TICKS)
        found.flights[f"no lag, no drag: {name}, 2 ms"] = [*data.qpos]
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = case.mass_kg * 9.81 / 4
        call = lambda model=model, data=data: mujoco.mj_step(model, data, 1000)  # noqa: E731
        found.simulator[f"{name}, 2 ms, one drone"] = rate(call, 1000)
    return found


def trace(case: Rays) -> dict[str, Mode]:
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="mesh", uservert=case.vertices.ravel().astype(float), userface=case.triangles.ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # the mesh is not closed
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh", contype=0, conaffinity=0)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    def by_ray(origins: Array, directions: Array) -> Cast:
        count = len(directions)
        origin, along = origins[0].astype(float), directions.ravel().astype(float)
        geometry, distances = np.empty(count, np.int32), np.empty(count)

        def cast() -> Array:
            mujoco.mj_multiRay(model, data, origin, along, None, True, -1, geometry, distances, None, count, FAR_M)
            return distances

        return cast

    return {"mj_multiRay": case.by_place(by_ray)}
