#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <optional>
#include <set>
#include <type_traits>
#include <utility>

#include "base/excerpt.hpp"
#include "base/in_world.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "base/srgb.hpp"
#include "base/text_file.hpp"
#include "formats/mesh_files.hpp"
#include "formats/text_lines.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

struct PlyType {
  std::string_view name, other_name;
  std::size_t size = 0;  // bytes
  bool is_whole = false;
  double (*read)(const unsigned char* bytes) = nullptr;
};

template <class T>
constexpr PlyType type_of(std::string_view name, std::string_view other_name) {
  return {name, other_name, sizeof(T), std::is_integral_v<T>, [](const unsigned char* bytes) {
            T value;
            std::memcpy(&value, bytes, sizeof value);
            return static_cast<double>(value);
          }};
}

constexpr std::array kTypes{type_of<std::int8_t>("char", "int8"),    type_of<std::uint8_t>("uchar", "uint8"),
                            type_of<std::int16_t>("short", "int16"), type_of<std::uint16_t>("ushort", "uint16"),
                            type_of<std::int32_t>("int", "int32"),   type_of<std::uint32_t>("uint", "uint32"),
                            type_of<float>("float", "float32"),      type_of<double>("double", "float64")};

const PlyType* ply_type(std::string_view name) {
  const auto is_it = [&](const PlyType& type) { return name == type.name || name == type.other_name; };
  const auto found = std::find_if(kTypes.begin(), kTypes.end(), is_it);
  return found != kTypes.end() ? &*found : nullptr;
}

struct PlyProperty {
  std::string_view name;
  const PlyType* type = nullptr;
  const PlyType* count = nullptr;  // length type of a list
};

struct PlyElement {
  std::string_view name;
  std::size_t count = 0;
  std::vector<PlyProperty> properties;
};

enum class PlyForm : std::uint8_t { text, little, big };

class PlyReader {
 public:
  PlyReader(std::string_view bytes, const std::string& source) : rest_(bytes), source_(source) {}

  PlyMesh read() {
    read_header();
    for (const PlyElement& element : elements_) {
      if (element.name == "vertex") {
        read_vertices(element);
      } else if (element.name == "face") {
        read_faces(element);
      } else {
        skip(element);
      }
    }
    cut();
    for (const std::string_view what : ignored_) out_.ignored.emplace_back(what);
    return std::move(out_);
  }

 private:
  // ------------------------------------------------------------------------------------------------------------- header

  // All header lines end like the first one, because the first byte after the header may have any value.
  std::string_view next_header_line() {
    const std::size_t at = rest_.find(ending_);
    if (at == rest_.npos) refuse(source_, "a header that ends with end_header", "a truncated one");
    const std::string_view line = rest_.substr(0, at);
    rest_.remove_prefix(at + ending_.size());
    return line;
  }

  void read_header() {
    std::string_view first = rest_;
    const std::string_view word = next_line(first);
    require(trimmed(word) == "ply", source_, "a PLY file, which begins with a line ply", quoted_excerpt(word));
    ending_ = rest_.substr(word.size(), rest_.size() - word.size() - first.size());
    require(!ending_.empty(), source_, "a header that ends with end_header", "a truncated one");
    next_header_line();

    bool has_form = false;
    std::size_t size = 0;  // total of elements and properties
    for (;;) {
      Interrupt::poll();
      const std::string_view line = next_header_line();
      std::string_view words = line;
      const std::string_view keyword = next_word(words);
      const auto refuse_line = [&](const char* expected) { refuse(source_ + ": header", expected, quoted_excerpt(line)); };
      if (keyword == "end_header") break;
      if (keyword == "comment" || keyword == "obj_info" || keyword.empty()) {
        if (next_word(words) == "TextureFile") ignored_.insert("textures");
        continue;
      }
      if (keyword == "format") {
        const std::string_view form = next_word(words);
        if (form == "ascii") form_ = PlyForm::text;
        if (form == "binary_little_endian") form_ = PlyForm::little;
        if (form == "binary_big_endian") form_ = PlyForm::big;
        has_form = form == "ascii" || form == "binary_little_endian" || form == "binary_big_endian";
        if (!has_form || next_word(words) != "1.0") {
          refuse_line("format ascii, binary_little_endian or binary_big_endian, and 1.0");
        }
        continue;
      }
      require(++size <= kMaxHeader, source_ + ": header", "at most 1000 elements and properties", "more");
      if (keyword == "element") {
        PlyElement element{next_word(words)};
        if (!parse_number(next_word(words), element.count)) refuse_line("a name and a count after element");
        elements_.push_back(std::move(element));
        continue;
      }
      if (keyword != "property" || elements_.empty()) refuse_line("format, comment, element and property, and end_header");
      PlyProperty property;
      std::string_view type = next_word(words);
      if (type == "list") {
        property.count = ply_type(next_word(words));
        if (!property.count || !property.count->is_whole) refuse_line("property list, an integer type, a type, a name");
        type = next_word(words);
      }
      property.type = ply_type(type);
      property.name = next_word(words);
      if (!property.type || property.name.empty()) refuse_line("property, a type such as float or uchar, a name");
      elements_.back().properties.push_back(property);
    }
    require(has_form, source_ + ": header", "a format line", "none");
    check_elements();
  }

  void check_elements() {
    const auto count = [&](std::string_view name) {
      return std::count_if(elements_.begin(), elements_.end(), [&](const PlyElement& e) { return e.name == name; });
    };
    for (const PlyElement& element : elements_) {
      const std::string field = source_ + ": element " + excerpt(element.name);
      require(element.name != "tristrips", field, "faces", "triangle strips, which are not supported");
      require(element.name != "vertex" || element.count <= std::numeric_limits<std::int32_t>::max(), field,
              "at most 2147483647 vertices", element.count);
      // Checked before memory is allocated.
      std::size_t least = 0;
      for (const PlyProperty& property : element.properties) {
        least += form_ == PlyForm::text ? 2 : (property.count ? property.count : property.type)->size;  // a digit and a space
      }
      const std::size_t available = rest_.size() + (form_ == PlyForm::text ? 1U : 0U);
      require(least == 0 || element.count <= available / least, field, "a file that holds " + std::to_string(element.count),
              std::to_string(rest_.size()) + " bytes");
    }
    require(count("vertex") == 1 && count("face") <= 1, source_ + ": header", "one element vertex and one element face",
            count("vertex") == 0 ? "none" : "several");
    const auto faces = std::find_if(elements_.begin(), elements_.end(), [](const auto& e) { return e.name == "face"; });
    if (faces == elements_.end() || faces->count == 0) refuse(source_, "at least one face", "a point cloud");
  }

  // ------------------------------------------------------------------------------------------------------------- values

  double number(const PlyType& type, const std::string& field) {
    if (form_ == PlyForm::text) {
      constexpr std::string_view kSpace = " \t\r\n";
      rest_.remove_prefix(std::min(rest_.find_first_not_of(kSpace), rest_.size()));
      const std::string_view word = rest_.substr(0, rest_.find_first_of(kSpace));
      rest_.remove_prefix(word.size());
      double value = 0.0;
      if (!parse_number(word, value)) {
        refuse(source_ + ": " + field, "a number", word.empty() ? "the end of the file" : quoted_excerpt(word));
      }
      return value;
    }
    if (rest_.size() < type.size) refuse(source_ + ": " + field, "a number", "the end of the file");
    std::array<unsigned char, 8> bytes{};
    std::memcpy(bytes.data(), rest_.data(), type.size);
    rest_.remove_prefix(type.size);
    if ((form_ == PlyForm::big) != (std::endian::native == std::endian::big)) {
      std::reverse(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(type.size));
    }
    return type.read(bytes.data());
  }

  // Reads the length of a list. Each item has at least a byte, so a length is at most the number of bytes left.
  std::size_t length(const PlyProperty& list, const std::string& field) {
    const double value = number(*list.count, field);
    if (!(value >= 0.0 && value <= static_cast<double>(rest_.size()) && value == std::floor(value))) {
      refuse(source_ + ": " + field, "a length within the file", value);
    }
    return static_cast<std::size_t>(value);
  }

  void skip(const PlyProperty& property, const std::string& field) {
    const std::size_t count = property.count ? length(property, field) : 1;
    for (std::size_t i = 0; i < count; ++i) number(*property.type, field);
  }

  void skip(const PlyElement& element) {
    ignored_.insert("elements other than vertex and face");
    if (element.properties.empty()) return;
    const std::string field = "element " + excerpt(element.name);
    for (std::size_t i = 0; i < element.count; ++i) {
      if (i % kBetweenPolls == 0) Interrupt::poll();
      for (const PlyProperty& property : element.properties) skip(property, field);
    }
  }

  // ------------------------------------------------------------------------------------------------- vertices and faces

  // Returns which of x, y, z, red, green, blue the property is.
  static std::optional<std::size_t> channel(const PlyProperty& property) {
    constexpr std::array<std::array<std::string_view, 3>, 6> kNames{{{"x", "x", "x"},
                                                                     {"y", "y", "y"},
                                                                     {"z", "z", "z"},
                                                                     {"red", "r", "diffuse_red"},
                                                                     {"green", "g", "diffuse_green"},
                                                                     {"blue", "b", "diffuse_blue"}}};
    for (std::size_t i = 0; i < kNames.size() && !property.count; ++i) {
      if (std::find(kNames[i].begin(), kNames[i].end(), property.name) != kNames[i].end()) return i;
    }
    return std::nullopt;
  }

  void read_vertices(const PlyElement& element) {
    constexpr std::size_t kNoChannel = 6;
    std::vector<std::size_t> channels;
    std::array<int, 7> found{};
    for (const PlyProperty& property : element.properties) {
      channels.push_back(channel(property).value_or(kNoChannel));
      ++found[channels.back()];
      const std::string_view name = property.name;
      if (name == "s" || name == "u" || name == "texture_u") ignored_.insert("texture coordinates");
    }
    require(found[0] == 1 && found[1] == 1 && found[2] == 1, source_ + ": element vertex", "one property x, one y and one z",
            "others");
    const bool has_colors = found[3] == 1 && found[4] == 1 && found[5] == 1;
    TriangleMesh& mesh = out_.mesh;
    mesh.vertices.reserve(element.count);
    if (has_colors) mesh.colors.reserve(element.count);
    for (std::size_t i = 0; i < element.count; ++i) {
      if (i % kBetweenPolls == 0) Interrupt::poll();
      std::array<double, 6> values{};
      for (std::size_t k = 0; k < channels.size(); ++k) {
        const PlyProperty& property = element.properties[k];
        if (channels[k] == kNoChannel) {
          skip(property, "element vertex");
          continue;
        }
        const double value = number(*property.type, "element vertex");
        values[channels[k]] = channels[k] < 3 ? value : linear_color(value, *property.type);
      }
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (!(std::abs(values[axis]) <= kMaxCoordinate)) {
          refuse(source_ + ": vertex " + std::to_string(i), in_world("finite coordinates"), values[axis]);
        }
      }
      const auto as_float = [&](std::size_t k) { return static_cast<float>(values[k]); };
      mesh.vertices.emplace_back(as_float(0), as_float(1), as_float(2));
      if (has_colors) mesh.colors.push_back({as_float(3), as_float(4), as_float(5)});
    }
  }

  static double linear_color(double value, const PlyType& type) {
    if (!(value > 0.0)) return 0.0;  // also for NaN
    if (type.name == "uchar") return srgb_to_linear()[static_cast<std::size_t>(std::min(value, 255.0))];
    const double most = type.is_whole ? (type.name == "ushort" ? 65535.0 : 255.0) : 1.0;
    return linear_of_srgb(std::min(value / most, 1.0));
  }

  void read_faces(const PlyElement& element) {
    const auto is_corners = [](const PlyProperty& p) {
      return p.count && (p.name == "vertex_indices" || p.name == "vertex_index");
    };
    const auto found = std::find_if(element.properties.begin(), element.properties.end(), is_corners);
    require(found != element.properties.end(), source_ + ": element face", "a list vertex_indices", "none");
    for (const PlyProperty& property : element.properties) {
      if (property.name == "red") ignored_.insert("colours of faces");
      if (property.name == "texcoord") ignored_.insert("texture coordinates");
    }
    for (std::size_t i = 0; i < element.count; ++i) {
      if (i % kBetweenPolls == 0) Interrupt::poll();
      for (auto property = element.properties.begin(); property != element.properties.end(); ++property) {
        if (property == found) {
          read_face(*property, i);
        } else {
          skip(*property, "element face");
        }
      }
    }
  }

  void read_face(const PlyProperty& property, std::size_t face) {
    const auto field = [face] { return "face " + std::to_string(face); };
    const std::size_t count = length(property, "element face");
    if (count < 3 || count > kMaxCorners) refuse(source_ + ": " + field(), "3 to 1000 corners", count);
    num_triangles_ += count - 2;
    require(num_triangles_ <= kMaxTriangles, source_, "at most " + std::to_string(kMaxTriangles) + " triangles", "more");
    lengths_.push_back(static_cast<std::uint16_t>(count));
    for (std::size_t k = 0; k < count; ++k) {
      const double corner = number(*property.type, "element face");
      if (!(corner >= 0.0 && corner <= std::numeric_limits<std::int32_t>::max() && corner == std::floor(corner))) {
        refuse(source_ + ": " + field(), "indices of vertices", corner);
      }
      corners_.push_back(static_cast<std::int32_t>(corner));
    }
  }

  // Cuts faces into triangles, once all vertices are known.
  void cut() {
    TriangleMesh& mesh = out_.mesh;
    const auto most = std::max_element(corners_.begin(), corners_.end());
    require(static_cast<std::size_t>(*most) < mesh.vertices.size(), source_ + ": element face",
            "indices of " + std::to_string(mesh.vertices.size()) + " vertices", *most);
    mesh.triangles.reserve(num_triangles_);
    std::vector<Vec3> points;
    std::size_t at = 0;
    for (std::size_t i = 0; i < lengths_.size(); ++i) {
      if (i % kBetweenPolls == 0) Interrupt::poll();
      const std::int32_t* const corners = corners_.data() + at;
      at += lengths_[i];
      if (lengths_[i] == 3) {
        mesh.triangles.push_back({corners[0], corners[1], corners[2]});
        continue;
      }
      points.clear();
      for (std::size_t k = 0; k < lengths_[i]; ++k) points.push_back(mesh.vertices[static_cast<std::size_t>(corners[k])]);
      for (const auto& [a, b, c] : cut_polygon(points)) mesh.triangles.push_back({corners[a], corners[b], corners[c]});
    }
  }

  static constexpr std::size_t kMaxHeader = 1000, kBetweenPolls = 1024;
  static constexpr std::size_t kMaxTriangles = std::size_t{1} << 25U;

  std::string_view rest_, ending_;
  const std::string& source_;
  PlyForm form_ = PlyForm::text;
  std::vector<PlyElement> elements_;
  std::set<std::string_view> ignored_;
  std::vector<std::uint16_t> lengths_;  // corners per face
  std::vector<std::int32_t> corners_;
  std::size_t num_triangles_ = 0;
  PlyMesh out_;
};

}  // namespace

PlyMesh parse_ply(std::string_view bytes, const std::string& source) { return PlyReader(bytes, source).read(); }

PlyMesh load_ply(const std::filesystem::path& path) { return parse_ply(read_text_file(path, "a PLY file"), path.string()); }

}  // namespace flockstep
