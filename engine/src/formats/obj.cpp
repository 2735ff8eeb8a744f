#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "base/srgb.hpp"
#include "base/text_file.hpp"
#include "formats/mesh_files.hpp"
#include "formats/names.hpp"
#include "formats/text_lines.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

constexpr long kMaxIndex = std::numeric_limits<std::int32_t>::max();

// Parses a vt line. The second number may be missing. v increases upwards.
std::array<float, 2> uv_of(std::string_view line) {
  std::array<double, 2> uv{};
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const std::string_view word = next_word(line);
    if (axis == 1 && word.empty()) break;
    if (!(parse_number(word, uv[axis]) && std::abs(uv[axis]) <= kMaxCoordinate)) return {};
  }
  return {static_cast<float>(uv[0]), static_cast<float>(1.0 - static_cast<double>(static_cast<float>(uv[1])))};
}

bool has_objects(std::string_view text) {
  for (std::size_t number = 1; !text.empty(); ++number) {
    if (number % 4096 == 0) Interrupt::poll();
    std::string_view line = next_line(text);
    if (next_word(line) == "o") return true;
  }
  return false;
}

class ObjReader {
 public:
  ObjReader(std::string_view text, const std::string& source)
      : text_(text), source_(source), object_keyword_(has_objects(text) ? "o" : "g") {}

  ObjMesh read(const WantsUv& wants_uv) {
    for (number_ = 1; !text_.empty(); ++number_) {
      if (number_ % 1024 == 0) Interrupt::poll();
      line_ = next_line(text_);
      std::string_view rest = line_;
      const std::string_view keyword = next_word(rest);
      if (keyword == "v") {
        read_vertex(rest);
      } else if (keyword == "vt" && uv_.size() < kMaxIndex) {
        uv_.push_back(uv_of(rest));
      } else if (keyword == "f") {
        read_face(rest);
      } else if (keyword == object_keyword_) {
        object_name_ = trimmed(rest);
        has_new_name_ = true;
      } else if (keyword == "usemtl") {
        material_name_ = trimmed(rest);
        has_new_name_ = true;
      } else if (keyword == "mtllib") {
        out_.names.libraries.emplace_back(trimmed(rest));
      } else if (keyword == "l" || keyword == "p") {
        ++num_lines_;
      }
    }
    if (num_lines_ > 0) out_.ignored.push_back(counted(num_lines_, "line or point", "lines and points"));
    if (wants_uv(out_.names) && !uv_.empty()) give_uv();
    require(!out_.mesh.triangles.empty(), source_, "at least one face", "none");
    return std::move(out_);
  }

 private:
  struct Corner {
    std::int32_t vertex;
    std::int32_t uv;  // kNoUv: none
  };

  [[noreturn]] void refuse(const std::string& expected, std::string_view got) const {
    flockstep::refuse(source_ + ':' + std::to_string(number_), expected, quoted_excerpt(got));
  }

  void read_vertex(std::string_view rest) {
    TriangleMesh& mesh = out_.mesh;
    require(mesh.vertices.size() < kMaxIndex, source_, "at most 2147483647 vertices", "more");
    Vec3& vertex = mesh.vertices.emplace_back();
    for (float& coordinate : vertex) {
      double value = 0.0;
      const bool is_good = parse_number(next_word(rest), value) && std::abs(value) <= std::numeric_limits<float>::max();
      if (!is_good) refuse("three finite coordinates after v", line_);
      coordinate = static_cast<float>(value);
    }
    // Three extra numbers are a colour, a single one is a weight.
    std::array<float, 3> color{};
    std::size_t count = 0;
    bool is_color = true;
    for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest), ++count) {
      double value = 0.0;
      is_color = is_color && count < 3 && parse_number(word, value) && value >= 0.0 && value <= 1.0;
      if (is_color) color[count] = linear_of_srgb(static_cast<float>(value));
    }
    is_color = is_color && count == 3;
    if (!is_color && mesh.colors.empty()) return;
    mesh.colors.resize(mesh.vertices.size(), {1.0F, 1.0F, 1.0F});
    if (is_color) mesh.colors.back() = color;
  }

  void read_face(std::string_view rest) {
    if (has_new_name_) number_names();
    const TriangleMesh& mesh = out_.mesh;
    const auto num_vertices = static_cast<long>(mesh.vertices.size());
    const auto num_uv = static_cast<long>(uv_.size());
    corners_.clear();
    for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest)) {
      const std::string_view vertex = word.substr(0, word.find('/'));
      long index = 0;  // from 1; negative values count back from the last vertex so far
      if (!parse_number(vertex, index)) refuse("vertex indices after f", line_);
      if (index == 0 || index > num_vertices || index < -num_vertices) {
        refuse("a vertex index within the " + std::to_string(num_vertices) + " vertices so far", word);
      }
      if (corners_.size() == kMaxCorners) refuse("at most 1000 corners after f", line_);
      long uv = 0;
      if (vertex.size() < word.size()) {
        const std::string_view rest_of_word = word.substr(vertex.size() + 1);
        if (!parse_number(rest_of_word.substr(0, rest_of_word.find('/')), uv)) uv = 0;
      }
      if (uv < 0) uv += num_uv + 1;
      corners_.push_back({static_cast<std::int32_t>(index > 0 ? index - 1 : num_vertices + index),
                          uv >= 1 && uv <= num_uv ? static_cast<std::int32_t>(uv - 1) : kNoUv});
    }
    if (corners_.size() < 3) refuse("at least three corners after f", line_);
    if (corners_.size() == 3) {
      add({0, 1, 2});
      return;
    }
    points_.clear();
    for (const Corner& corner : corners_) points_.push_back(mesh.vertices[static_cast<std::size_t>(corner.vertex)]);
    for (const CornerTriple& triangle : cut_polygon(points_)) add(triangle);
  }

  // Adds a triangle of the face's corners.
  void add(const CornerTriple& triangle) {
    const Corner &a = corners_[triangle[0]], &b = corners_[triangle[1]], &c = corners_[triangle[2]];
    TriangleMesh& mesh = out_.mesh;
    if (!uv_.empty()) {
      uv_of_corners_.resize(mesh.triangles.size(), {kNoUv, kNoUv, kNoUv});
      uv_of_corners_.push_back({a.uv, b.uv, c.uv});
    }
    mesh.triangles.push_back({a.vertex, b.vertex, c.vertex});
    mesh.materials.push_back(material_);
    mesh.objects.push_back(object_);
  }

  // Numbers objects and materials in the order of their first faces.
  void number_names() {
    const auto number = [](auto& numbers, std::string_view name) {
      const auto known = numbers.find(name);
      return known != numbers.end() ? known->second : numbers.emplace(name, numbers.size()).first->second;
    };
    const std::size_t object = number(objects_, object_name_);
    if (object >= kMaxObjects) refuse("at most 65536 objects", object_name_);
    if (is_solid_name(object_name_)) {
      std::vector<Visibility>& visibility = out_.mesh.visibility;
      visibility.resize(std::max(visibility.size(), object + 1), Visibility::full);
      visibility[object] = Visibility::solid;
    }
    const std::size_t material = number(materials_, material_name_);
    if (material >= kMaxMaterials) refuse("at most " + std::to_string(kMaxMaterials) + " materials", material_name_);
    if (material == out_.names.materials.size()) out_.names.materials.emplace_back(material_name_);
    object_ = static_cast<std::uint16_t>(object);
    material_ = static_cast<std::uint16_t>(material);
    has_new_name_ = false;
  }

  // Each vertex gets the uv of its first corner. Corners with another uv get a copy of the vertex.
  void give_uv() {
    TriangleMesh& mesh = out_.mesh;
    constexpr std::int32_t kUnused = kNoUv - 1;
    std::vector<std::int32_t> first(mesh.vertices.size(), kUnused);
    std::map<std::pair<std::int32_t, std::int32_t>, std::int32_t> copies;
    mesh.uv.resize(mesh.vertices.size());
    const auto uv = [&](std::int32_t index) {
      return index == kNoUv ? std::array<float, 2>{} : uv_[static_cast<std::size_t>(index)];
    };
    uv_of_corners_.resize(mesh.triangles.size(), {kNoUv, kNoUv, kNoUv});
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      if (i % 1024 == 0) Interrupt::poll();
      for (std::size_t k = 0; k < 3; ++k) {
        std::int32_t& corner = mesh.triangles[i][k];
        const std::int32_t place = uv_of_corners_[i][k];
        const auto vertex = static_cast<std::size_t>(corner);
        if (first[vertex] == kUnused) {
          first[vertex] = place;
          mesh.uv[vertex] = uv(place);
        }
        if (first[vertex] == place) continue;
        const auto [copy, is_new] = copies.try_emplace({corner, place}, static_cast<std::int32_t>(mesh.vertices.size()));
        if (is_new) {
          mesh.vertices.push_back(Vec3(mesh.vertices[vertex]));
          if (!mesh.colors.empty()) mesh.colors.push_back(std::array(mesh.colors[vertex]));
          mesh.uv.push_back(uv(place));
        }
        corner = copy->second;
      }
    }
  }

  static constexpr std::int32_t kNoUv = -1;

  std::string_view text_;
  const std::string& source_;
  std::string_view object_keyword_;
  ObjMesh out_;
  std::string_view line_, object_name_, material_name_;
  std::size_t number_ = 0, num_lines_ = 0;
  std::vector<std::array<float, 2>> uv_;                                 // from vt lines
  std::vector<std::array<std::int32_t, 3>> uv_of_corners_;               // indices into uv_ by triangle; empty without vt
  std::map<std::string, std::size_t, std::less<>> objects_, materials_;  // by name
  std::uint16_t object_ = 0, material_ = 0;                              // for the next face
  bool has_new_name_ = true;
  std::vector<Corner> corners_;  // corners of one face
  std::vector<Vec3> points_;
};

}  // namespace

ObjMesh parse_obj(std::string_view text, const std::string& source, const WantsUv& wants_uv) {
  return ObjReader(text, source).read(wants_uv);
}

ObjMesh load_obj(const std::filesystem::path& path, const WantsUv& wants_uv) {
  return parse_obj(read_text_file(path, "an OBJ file"), path.string(), wants_uv);
}

}  // namespace flockstep
