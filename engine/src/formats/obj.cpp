#include "formats/obj.hpp"

#include <tiny_obj_loader.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <istream>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <streambuf>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "base/srgb.hpp"
#include "base/text_file.hpp"
#include "formats/solid_names.hpp"
#include "formats/text_lines.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

constexpr long kMaxIndex = std::numeric_limits<std::int32_t>::max();
constexpr int kMaxCorners = 1000;  // of a face: cutting it into triangles takes their number squared
constexpr long kWorkOfPart = 1'000'000;

// The numbers of a vt line, of which the second may be missing.
std::string checked_uv(std::string_view line) {
  std::string kept;
  for (int axis = 0; axis < 2; ++axis) {
    const std::string_view word = next_word(line);
    double value = 0.0;
    if (!word.empty() && !(parse_number(word, value) && std::abs(value) <= kMaxCoordinate)) return "0 1";  // (0, 0), from above
    if (axis == 0 && word.empty()) return "0 1";
    kept += word.empty() ? "0" : word;
    kept += ' ';
  }
  return kept;
}

bool has_objects(std::string_view text) {
  for (std::size_t number = 1; !text.empty(); ++number) {
    if (number % 4096 == 0) Interrupt::poll();
    std::string_view line = next_line(text);
    if (next_word(line) == "o") return true;
  }
  return false;
}

// tinyobjloader reads a malformed number as 0, lets indices run out of range, and believes any size that a line states. So it is
// given a text that has been checked and has nothing but vertices, places in textures, faces, and numbers in place of the names
// of their objects and materials; and now and then the same object once more, at which it cuts the faces so far into triangles,
// so that it never does so for long.
class ObjChecker {
 public:
  ObjChecker(std::string_view text, const std::string& source, ObjMesh& out)
      : text_(text), source_(source), object_keyword_(has_objects(text) ? "o" : "g"), out_(out) {}

  std::string check() {
    long work = 0;  // for tinyobjloader, since the last part began
    for (number_ = 1; !text_.empty(); ++number_) {
      if (work > kWorkOfPart) {
        if (shown_object_ != kNone) kept_ += "o " + std::to_string(shown_object_) + '\n';
        Interrupt::poll();
        work = 0;
      }
      ++work;
      line_ = next_line(text_);
      std::string_view rest = line_;
      const std::string_view keyword = next_word(rest);
      if (keyword == "v") {
        check_vertex(rest);
      } else if (keyword == "vt" && num_uv_ < kMaxIndex) {
        ++num_uv_;
        kept_ += "vt " + checked_uv(rest) + '\n';
      } else if (keyword == "f") {
        show_names();
        const int corners = check_face(rest);
        work += corners * corners;
      } else if (keyword == object_keyword_) {
        object_ = trimmed(rest);
      } else if (keyword == "usemtl") {
        material_ = trimmed(rest);
      } else if (keyword == "mtllib") {
        out_.names.libraries.emplace_back(trimmed(rest));
      } else if (keyword == "l" || keyword == "p") {
        ++num_lines_;
      }
    }
    if (num_lines_ > 0) {
      out_.ignored.push_back(counted(num_lines_, "line or point", "lines and points"));
    }
    return std::move(kept_);
  }

  bool has_colors() const { return has_colors_; }

 private:
  [[noreturn]] void refuse(const std::string& expected, std::string_view got) const {
    flockstep::refuse(source_ + ':' + std::to_string(number_), expected, '"' + excerpt(got) + '"');
  }

  void check_vertex(std::string_view rest) {
    require(num_vertices_ < kMaxIndex, source_, "at most 2147483647 vertices", "more");
    ++num_vertices_;
    kept_ += 'v';
    for (int axis = 0; axis < 3; ++axis) {
      const std::string_view word = next_word(rest);
      double value = 0.0;
      const bool is_good = parse_number(word, value) && std::abs(value) <= std::numeric_limits<float>::max();
      if (!is_good) refuse("three finite coordinates after v", line_);
      kept_ += ' ';
      kept_ += word;
    }
    // Three more numbers are a colour; one more is a weight.
    const std::string_view color = rest;
    int count = 0;
    bool is_color = true;
    for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest), ++count) {
      double value = 0.0;
      is_color = is_color && count < 3 && parse_number(word, value) && value >= 0.0 && value <= 1.0;
    }
    if (is_color && count == 3) {
      kept_ += color;
      has_colors_ = true;
    }
    kept_ += '\n';
  }

  int check_face(std::string_view rest) {
    int corners = 0;
    kept_ += 'f';
    for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest), ++corners) {
      const std::string_view vertex = word.substr(0, word.find('/'));
      long index = 0;  // from 1, or counted back from the last vertex so far when negative
      if (!parse_number(vertex, index)) refuse("vertex indices after f", line_);
      if (index == 0 || index > num_vertices_ || index < -num_vertices_) {
        refuse("a vertex index within the " + std::to_string(num_vertices_) + " vertices so far", word);
      }
      if (corners == kMaxCorners) refuse("at most 1000 corners after f", line_);
      kept_ += ' ';
      kept_ += std::to_string(index > 0 ? index : num_vertices_ + 1 + index);
      if (vertex.size() == word.size()) continue;
      const std::string_view rest_of_word = word.substr(vertex.size() + 1);
      long uv = 0;
      if (!parse_number(rest_of_word.substr(0, rest_of_word.find('/')), uv)) continue;
      if (uv < 0) uv += num_uv_ + 1;
      if (uv >= 1 && uv <= num_uv_) kept_ += '/' + std::to_string(uv);
    }
    if (corners < 3) refuse("at least three corners after f", line_);
    kept_ += '\n';
    return corners;
  }

  // Of the face that comes next, where they are others than of the last.
  void show_names() {
    const auto number = [](auto& numbers, std::string_view name) {
      const auto known = numbers.find(name);
      return known != numbers.end() ? known->second : numbers.emplace(name, numbers.size()).first->second;
    };
    if (const std::size_t object = number(objects_, object_); object != shown_object_) {
      if (object >= kMaxObjects) refuse("at most 65536 objects", object_);
      if (is_solid_name(object_)) {
        std::vector<Presence>& presence = out_.mesh.presence;
        presence.resize(std::max(presence.size(), object + 1), Presence::full);
        presence[object] = Presence::solid;
      }
      kept_ += "o " + std::to_string(object) + '\n';
      shown_object_ = object;
    }
    if (const std::size_t material = number(materials_, material_); material != shown_material_) {
      if (material >= kMaxMaterials) refuse("at most " + std::to_string(kMaxMaterials) + " materials", material_);
      if (material == out_.names.materials.size()) out_.names.materials.emplace_back(material_);
      kept_ += "usemtl " + std::to_string(material) + '\n';
      shown_material_ = material;
    }
  }

  static constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

  std::string_view text_;
  const std::string& source_;
  std::string_view object_keyword_;
  ObjMesh& out_;
  std::string kept_;
  std::string_view line_, object_, material_;
  std::size_t number_ = 0;
  long num_vertices_ = 0, num_uv_ = 0;
  std::size_t num_lines_ = 0;
  bool has_colors_ = false;
  std::map<std::string, std::size_t, std::less<>> objects_, materials_;  // by name
  std::size_t shown_object_ = kNone, shown_material_ = kNone;
};

// Numbers in place of names are materials of these numbers.
class SameNumbers final : public tinyobj::MaterialReader {
 public:
  explicit SameNumbers(std::size_t count) : count_(count) {}
  bool operator()(const std::string&, std::vector<tinyobj::material_t>*, std::map<std::string, int>* numbers, std::string*,
                  std::string*) override {
    for (std::size_t i = 0; i < count_; ++i) numbers->emplace(std::to_string(i), static_cast<int>(i));
    return true;
  }

 private:
  std::size_t count_;
};

// A text in parts, for a reader that may take long over it.
class PolledText final : public std::streambuf {
 public:
  explicit PolledText(std::string text) : text_(std::move(text)) {}

 protected:
  int_type underflow() override {
    Interrupt::poll();
    const std::size_t count = std::min(kPart, text_.size() - taken_);
    if (count == 0) return traits_type::eof();
    char* const begin = text_.data() + taken_;
    taken_ += count;
    setg(begin, begin, begin + count);
    return traits_type::to_int_type(*begin);
  }

 private:
  static constexpr std::size_t kPart = 1U << 16U;
  std::string text_;
  std::size_t taken_ = 0;
};

// Gives each corner a vertex with its place in a texture: the first of a vertex gets that one, others get copies of it.
class UvVertices {
 public:
  UvVertices(TriangleMesh& mesh, const std::vector<tinyobj::real_t>& places)
      : mesh_(mesh), places_(places), first_(mesh.vertices.size(), kNone) {
    mesh_.uv.resize(mesh_.vertices.size());
  }

  std::int32_t operator()(const tinyobj::index_t& corner) {
    const auto vertex = static_cast<std::size_t>(corner.vertex_index);
    const int place = corner.texcoord_index;
    if (first_[vertex] == kNone) {
      first_[vertex] = place;
      mesh_.uv[vertex] = uv(place);
    }
    if (first_[vertex] == place) return corner.vertex_index;
    const auto [copy, is_new] =
        copies_.try_emplace({corner.vertex_index, place}, static_cast<std::int32_t>(mesh_.vertices.size()));
    if (is_new) {
      mesh_.vertices.push_back(Vec3(mesh_.vertices[vertex]));
      if (!mesh_.colors.empty()) mesh_.colors.push_back(std::array(mesh_.colors[vertex]));
      mesh_.uv.push_back(uv(place));
    }
    return copy->second;
  }

 private:
  static constexpr int kNone = -2;  // -1 is the place of corners that have none

  // The file counts upwards.
  std::array<float, 2> uv(int place) const {
    if (place < 0) return {};
    const std::size_t at = 2 * static_cast<std::size_t>(place);
    return {static_cast<float>(places_[at]), static_cast<float>(1.0 - static_cast<double>(places_[at + 1]))};
  }

  TriangleMesh& mesh_;
  const std::vector<tinyobj::real_t>& places_;
  std::vector<int> first_;  // place of each vertex
  std::map<std::pair<int, int>, std::int32_t> copies_;
};

}  // namespace

ObjMesh parse_obj(std::string_view text, const std::string& source, const WantsUv& wants_uv) {
  ObjMesh result;
  ObjChecker checker(text, source, result);
  std::string checked = checker.check();
  PolledText polled("mtllib numbers\n" + std::exchange(checked, {}));
  std::istream stream(&polled);
  stream.exceptions(std::ios::badbit);  // passes on what poll() throws
  SameNumbers numbers(result.names.materials.size());
  tinyobj::attrib_t attributes;
  std::vector<tinyobj::shape_t> shapes;
  std::vector<tinyobj::material_t> no_materials;
  std::string warning, error;
  if (!tinyobj::LoadObj(&attributes, &shapes, &no_materials, &warning, &error, &stream, &numbers)) {
    throw std::invalid_argument(source + ": " + error);
  }

  TriangleMesh& mesh = result.mesh;
  const std::vector<tinyobj::real_t>& coordinates = attributes.vertices;
  for (std::size_t i = 0; i + 2 < coordinates.size(); i += 3) {
    mesh.vertices.emplace_back(static_cast<float>(coordinates[i]), static_cast<float>(coordinates[i + 1]),
                               static_cast<float>(coordinates[i + 2]));
    if (!checker.has_colors()) continue;
    const auto color = attributes.colors.begin() + static_cast<std::ptrdiff_t>(i);
    mesh.colors.push_back({linear_of_srgb(color[0]), linear_of_srgb(color[1]), linear_of_srgb(color[2])});
  }
  std::optional<UvVertices> uv_vertices;
  if (wants_uv(result.names) && !attributes.texcoords.empty()) uv_vertices.emplace(mesh, attributes.texcoords);
  const auto vertex = [&](const tinyobj::index_t& corner) { return uv_vertices ? (*uv_vertices)(corner) : corner.vertex_index; };
  for (const tinyobj::shape_t& shape : shapes) {
    const std::vector<tinyobj::index_t>& corners = shape.mesh.indices;
    std::uint16_t object = 0;
    parse_number(std::string_view(shape.name), object);
    for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
      mesh.triangles.push_back({vertex(corners[i]), vertex(corners[i + 1]), vertex(corners[i + 2])});
      mesh.materials.push_back(static_cast<std::uint16_t>(shape.mesh.material_ids[i / 3]));
      mesh.objects.push_back(object);
    }
  }
  require(!mesh.triangles.empty(), source, "at least one face", "none");
  return result;
}

ObjMesh load_obj(const std::filesystem::path& path, const WantsUv& wants_uv) {
  return parse_obj(read_text_file(path, "an OBJ file"), path.string(), wants_uv);
}

}  // namespace flockstep
