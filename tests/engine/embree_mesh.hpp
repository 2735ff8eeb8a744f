// Embree by itself, to compare with: a device, and the scene of a mesh.
#pragma once

#include "flockstep/world.hpp"
#include "standard.hpp"
#include "trace/embree.hpp"

namespace flockstep::testing {

using EmbreeScene = std::unique_ptr<RTCSceneTy, decltype(&rtcReleaseScene)>;

struct EmbreeDevice {
  std::unique_ptr<RTCDeviceTy, decltype(&rtcReleaseDevice)> device{rtcNewDevice(nullptr), &rtcReleaseDevice};

  // Returns a scene of the mesh alone, which Embree traces robustly.
  EmbreeScene scene(const TriangleMesh& mesh) const {
    const RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh.vertices.size()));
    auto* corners = static_cast<std::int32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.triangles.size()));
    for (const Vec3& vertex : mesh.vertices) vertices = std::copy_n(vertex.data(), 3, vertices);
    for (const auto& triangle : mesh.triangles) corners = std::copy(triangle.begin(), triangle.end(), corners);
    rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
    rtcCommitGeometry(geometry);
    EmbreeScene scene(rtcNewScene(device.get()), &rtcReleaseScene);
    rtcAttachGeometry(scene.get(), geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
    rtcCommitScene(scene.get());
    return scene;
  }
};

}  // namespace flockstep::testing
