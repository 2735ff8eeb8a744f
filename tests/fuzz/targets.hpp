// What the fuzzers feed: each takes any bytes, and either does something right with them or throws what the interface promises.
// Everything else is a finding: a signal, a sanitizer's report, another exception, a broken promise (std::abort).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace flockstep::fuzz {

using Bytes = std::span<const std::uint8_t>;

void scene(Bytes input);     // a scene file
void obj(Bytes input);       // an OBJ file, and behind a line "#mtl" its material file m.mtl
void ply(Bytes input);       // a PLY file
void gltf(Bytes input);      // a glTF file, text or binary
void snapshot(Bytes input);  // a snapshot with bytes changed and its checksum mended
void calls(Bytes input);     // calls on a batch, one after another

struct Target {
  const char* name;
  void (*run)(Bytes input);
};
inline const std::vector<Target>& targets() {
  static const std::vector<Target> all{{"scene", scene}, {"obj", obj},           {"ply", ply},
                                       {"gltf", gltf},   {"snapshot", snapshot}, {"calls", calls}};
  return all;
}

}  // namespace flockstep::fuzz
