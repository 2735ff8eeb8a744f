#include <limits>

#include "base/interrupt.hpp"
#include "flockstep/survey.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

ObjectList objects(const World& world) {
  ObjectList list;
  for (const Primitive& primitive : world.primitives()) {
    list.boxes.push_back(bounds(primitive));
    list.materials.push_back(primitive.material);
    list.visibility.push_back(primitive.visibility);
  }
  const TriangleMesh& mesh = world.triangles();
  const std::size_t num_primitives = world.primitives().size();
  for (std::size_t first = 0; first < mesh.triangles.size();) {  // triangles are sorted by object
    Interrupt::poll();
    Eigen::AlignedBox3f box;
    std::int32_t material = mesh.materials[first];
    std::size_t last = first;
    for (; last < mesh.triangles.size() && mesh.objects[last] == mesh.objects[first]; ++last) {
      for (const std::int32_t vertex : mesh.triangles[last]) box.extend(mesh.vertices[static_cast<std::size_t>(vertex)]);
      if (mesh.materials[last] != material) material = -1;
    }
    const Vec3 none = Vec3::Constant(std::numeric_limits<float>::quiet_NaN());
    list.boxes.resize(num_primitives + mesh.objects[first], {none, none});
    list.materials.resize(list.boxes.size(), -1);
    list.boxes.push_back({box.min(), box.max()});
    list.materials.push_back(material);
    first = last;
  }
  list.visibility.resize(list.boxes.size(), Visibility::full);
  for (std::size_t i = 0; i < mesh.visibility.size(); ++i) list.visibility[num_primitives + i] = mesh.visibility[i];
  return list;
}

}  // namespace flockstep
