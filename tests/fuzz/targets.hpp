// The fuzz targets. Each accepts any bytes, and must either process them correctly or throw a documented exception. Anything
// else is a finding: a signal, a sanitizer report, another exception, or a broken invariant (std::abort).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace flockstep::fuzz {

using Bytes = std::span<const std::uint8_t>;

void scene(Bytes input);     // a scene file
void obj(Bytes input);       // an OBJ file, optionally followed by a line "#mtl" and its material file m.mtl
void ply(Bytes input);       // a PLY file
void gltf(Bytes input);      // a glTF file, text or binary
void snapshot(Bytes input);  // a snapshot with edited bytes and a valid checksum
void calls(Bytes input);     // a sequence of calls on a batch
void messages(Bytes input);  // messages of two clients to a server

struct Target {
  const char* name;
  void (*run)(Bytes input);
};
inline const std::vector<Target>& targets() {
  static const std::vector<Target> all{{"scene", scene},       {"obj", obj},     {"ply", ply},          {"gltf", gltf},
                                       {"snapshot", snapshot}, {"calls", calls}, {"messages", messages}};
  return all;
}

}  // namespace flockstep::fuzz
