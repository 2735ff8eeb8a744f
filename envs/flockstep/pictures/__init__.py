"""Everything that draws. None of it is needed to fly.

- `choice`: the keywords of `DroneVectorEnv` that choose its pictures.
- `views`: the views of `DroneVectorEnv.render`, built from `top_view`, `third_person_view` and the drone's own camera.
- `picture`: one picture of a world from any viewpoint, `flockstep.render`.
- `frames`: a camera's frames as PNG files, `Camera.save_frames`.
- `stage`, `body`: pictures of a world with drones by the engine's cameras; `style`: their looks.
- `depth_canvas`: lines, spheres, cells and texts drawn into a picture, hidden by what is nearer.
- `flight_overlay`: additions to pictures of Hover and Track: the target point, the line to it, the height.
- `lines`: LiDAR beams, the visible move lines and the trails of drones.
"""
