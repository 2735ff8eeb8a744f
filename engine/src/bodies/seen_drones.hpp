// SeenDrones: the drones of a batch in the forms in which the sensors of other drones see them.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "bodies/body_model.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"
#include "trace/hulls.hpp"

namespace flockstep::bodies {

class SeenDrones {
 public:
  // state: must outlive this object, with its arrays of drones allocated. mesh: as cameras show the drones; null: their hull.
  SeenDrones(const State& state, const DroneModel& model, std::shared_ptr<const World> mesh, bool for_cameras);

  // Call it after State::active has changed.
  void update();
  void update(DroneIndex drone);  // threads may update different drones at the same time

  // Views of all drones, valid as long as this object.
  trace::Bodies hulls() const;            // for LiDARs
  render::VisibleBodies visible() const;  // for cameras; requires for_cameras

 private:
  const State& state_;
  trace::HullPlanes planes_;
  std::optional<BodyModel> mesh_;   // for cameras
  float radius_;                    // m, of a ball around the position that contains hull and mesh
  std::vector<float> seen_radius_;  // (N,), -1: not active
};

}  // namespace flockstep::bodies
