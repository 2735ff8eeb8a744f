"""Everything that draws. Nothing here is needed to fly.

- `views`: what `DroneVectorEnv.render` shows, made of `top_view`, `third_person_view` and the drone's own camera.
- `picture`: one picture of a world from anywhere, `flockstep.render`.
- `frames`: a camera's frames as PNG files, `Camera.save_frames`.
- `stage`, `depth_canvas`: the world behind a drone, and lines and solids drawn into it, each hidden by what is nearer.
- `flight_overlay`: what pictures of Hover and Track add: the point, the way there, the height.
- `beams`, `trail`: where LiDAR beams begin and end, and where drones have been.
"""
