// The members of Batch that concern move lines and pictures.
#include <cstdint>
#include <utility>
#include <vector>

#include "batch/call_guard.hpp"
#include "batch/checks.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "flockstep/batch.hpp"
#include "render/move_line.hpp"

namespace flockstep {

void Batch::set_move_line_visible(bool visible, DroneMask mask) {
  const CallGuard guard(*lock_);
  checks::mask(*sim_, mask);
  std::vector<DroneIndex> drones;
  for_each_selected(*sim_, mask, [&](DroneIndex drone) { drones.push_back(drone); });
  sim_->move_lines.set_visible(visible, drones);
}

const MoveLineState& Batch::move_lines() const { return sim_->move_lines.flags(); }

std::vector<Vec3> Batch::move_line(std::int64_t index) const {
  const CallGuard guard(*lock_);
  checks::index(*sim_, index);
  const std::span<const Vec3> rows = sim_->move_lines.rows(DroneIndex(index));
  return {rows.begin(), rows.end()};
}

std::vector<std::uint8_t> Batch::picture(std::size_t camera, std::int64_t index) const {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "picture");  // its frames and tracers may be in use
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  const DroneIndex drone(index);
  std::vector<std::uint8_t> rgb = sim_->cameras.rgb(camera, drone);
  if (!sim_->move_lines.is_any_visible()) return rgb;
  // A line in the current world does not belong into the frame of another.
  if (sim_->cameras[camera].taken_world(drone) != sim_->state.world_index[sim_->env_of(drone)]) return rgb;
  const render::RenderRequest view = sim_->cameras.retake(camera, drone);
  const CameraConfig& config = sim_->cameras[camera].config();
  render::LinePainter painter(view, config.image_width_px(), config.image_height_px(), sim_->scratches[0]->tracer);
  for (std::size_t member = 0; member < sim_->drones_per_env(); ++member) {
    painter.add(sim_->move_lines.rows(sim_->drone_of(sim_->env_of(drone), member)));
  }
  painter.draw(rgb);
  return rgb;
}

}  // namespace flockstep
