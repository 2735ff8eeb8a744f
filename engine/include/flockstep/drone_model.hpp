// DroneModel: the body and flight model of a drone. The convex hull is its collision body. The optional airframe holds the
// coefficients of its flight model.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "flockstep/airframe.hpp"
#include "flockstep/export.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

inline constexpr int kMaxHullVertices = 32;  // largest number of points of a hull

class FLOCKSTEP_API DroneModel {
 public:
  // Returns the default drone, the 650-class quadrotor "t650". Its extents are exactly 0.93 x 0.59 x 0.20 m, centred on the
  // body origin.
  static DroneModel quadrotor650();
  // Loads a bundled airframe by name, or a JSON file by a path that ends in .json. docs/reference/drone-files.md describes the
  // format.
  static DroneModel load(const std::string& name_or_path);
  static DroneModel from_json(const std::string& text);  // reads the format of a drone file; throws std::invalid_argument
  static std::vector<std::string> names();               // names of the bundled airframes

  // hull: 4 to 32 points in the body frame, m. Their convex hull is the collision body and must have a volume.
  explicit DroneModel(std::vector<Vec3> hull, std::optional<Airframe> airframe = {}, std::string name = {});

  const std::string& name() const { return name_; }                      // empty if none was given
  const std::optional<Airframe>& airframe() const { return airframe_; }  // none: kinematic motion only
  std::span<const Vec3> hull() const { return hull_; }                   // m, body frame
  float radius() const { return radius_; }          // m, smallest ball about the body origin that contains the hull
  const Aabb& extents() const { return extents_; }  // m, body frame

  // Returns hull and airframe in another size and mass; see Airframe::scaled.
  DroneModel scaled(double size, double mass) const;
  std::string to_json() const;  // from_json() makes an equal model of it

 private:
  std::string name_;
  std::optional<Airframe> airframe_;
  std::vector<Vec3> hull_;
  float radius_ = 0.0F;
  Aabb extents_;
};

}  // namespace flockstep
