#include "world/obj.hpp"

#include <tiny_obj_loader.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
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
#include "world/text_file.hpp"

namespace flockstep {
namespace {

constexpr long kMaxIndex = std::numeric_limits<std::int32_t>::max();
constexpr int kMaxCorners = 1000;  // of a face: cutting it into triangles takes their number squared
constexpr long kWorkOfPart = 1'000'000;

[[noreturn]] void refuse_line(const std::string& source, std::size_t line, const std::string& expected, std::string_view got) {
  flockstep::refuse(source + ':' + std::to_string(line), expected, '"' + excerpt(got) + '"');
}

// The next line of a text, which it is removed from. Lines end with \n, \r\n or \r.
std::string_view next_line(std::string_view& text) {
  const std::string_view line = text.substr(0, text.find_first_of("\r\n"));
  text.remove_prefix(line.size());
  text.remove_prefix(text.starts_with("\r\n") ? 2 : std::min<std::size_t>(text.size(), 1));
  return line;
}

// The next word of a line, which it is removed from; empty at the end.
std::string_view next_word(std::string_view& line) {
  constexpr std::string_view kSpace = " \t";
  line.remove_prefix(std::min(line.find_first_not_of(kSpace), line.size()));
  const std::string_view word = line.substr(0, line.find_first_of(kSpace));
  line.remove_prefix(word.size());
  return word;
}

template <class Number>
bool parse(std::string_view word, Number& value) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);  // which from_chars does not take
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size();
}

// The numbers of a vt line, of which the second may be missing.
std::string checked_uv(std::string_view line) {
  std::string kept;
  for (int axis = 0; axis < 2; ++axis) {
    const std::string_view word = next_word(line);
    double value = 0.0;
    if (!word.empty() && !(parse(word, value) && std::abs(value) <= kMaxCoordinate)) return "0 1";  // (0, 0), from above
    if (axis == 0 && word.empty()) return "0 1";
    kept += word.empty() ? "0" : word;
    kept += ' ';
  }
  return kept;
}

// tinyobjloader reads a malformed number as 0, lets indices run out of range, and believes any size that a line states. So it is
// given a text that has been checked and has nothing but vertices, places in textures where these are wanted, and faces; and now
// and then a new object, at which it cuts the faces so far into triangles, so that it never does so for long.
std::string checked(std::string_view text, const std::string& source, bool with_uv) {
  std::string kept;
  long num_vertices = 0;
  long num_uv = 0;
  long work = 0;  // for tinyobjloader, since the last part began
  for (std::size_t number = 1; !text.empty(); ++number) {
    if (work > kWorkOfPart) {
      kept += "o part\n";
      Interrupt::poll();
      work = 0;
    }
    ++work;
    const std::string_view line = next_line(text);
    std::string_view rest = line;
    const std::string_view keyword = next_word(rest);
    if (keyword == "v") {
      require(num_vertices < kMaxIndex, source, "at most 2147483647 vertices", "more");
      ++num_vertices;
      kept += 'v';
      for (int axis = 0; axis < 3; ++axis) {
        const std::string_view word = next_word(rest);
        double value = 0.0;
        const bool is_good = parse(word, value) && std::abs(value) <= std::numeric_limits<float>::max();
        if (!is_good) refuse_line(source, number, "three finite coordinates after v", line);
        kept += ' ';
        kept += word;
      }
      kept += '\n';
    } else if (keyword == "vt" && with_uv && num_uv < kMaxIndex) {
      ++num_uv;
      kept += "vt " + checked_uv(rest) + '\n';
    } else if (keyword == "f") {
      int corners = 0;
      kept += 'f';
      for (std::string_view word = next_word(rest); !word.empty(); word = next_word(rest), ++corners) {
        const std::string_view vertex = word.substr(0, word.find('/'));
        long index = 0;  // from 1, or counted back from the last vertex so far when negative
        if (!parse(vertex, index)) refuse_line(source, number, "vertex indices after f", line);
        if (index == 0 || index > num_vertices || index < -num_vertices) {
          refuse_line(source, number, "a vertex index within the " + std::to_string(num_vertices) + " vertices so far", word);
        }
        if (corners == kMaxCorners) refuse_line(source, number, "at most 1000 corners after f", line);
        kept += ' ';
        kept += std::to_string(index > 0 ? index : num_vertices + 1 + index);
        if (!with_uv || vertex.size() == word.size()) continue;
        const std::string_view rest_of_word = word.substr(vertex.size() + 1);
        long uv = 0;
        if (!parse(rest_of_word.substr(0, rest_of_word.find('/')), uv)) continue;
        if (uv < 0) uv += num_uv + 1;
        if (uv >= 1 && uv <= num_uv) kept += '/' + std::to_string(uv);
      }
      work += corners * corners;
      if (corners < 3) refuse_line(source, number, "at least three corners after f", line);
      kept += '\n';
    }
  }
  return kept;
}

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

TriangleMesh parse_obj(std::string_view text, const std::string& source, bool with_uv) {
  PolledText polled(checked(text, source, with_uv));
  std::istream stream(&polled);
  stream.exceptions(std::ios::badbit);  // passes on what poll() throws
  tinyobj::attrib_t attributes;
  std::vector<tinyobj::shape_t> shapes;
  std::string warning, error;
  if (!tinyobj::LoadObj(&attributes, &shapes, nullptr, &warning, &error, &stream)) {
    throw std::invalid_argument(source + ": " + error);
  }

  TriangleMesh mesh;
  const std::vector<tinyobj::real_t>& coordinates = attributes.vertices;
  for (std::size_t i = 0; i + 2 < coordinates.size(); i += 3) {
    mesh.vertices.emplace_back(static_cast<float>(coordinates[i]), static_cast<float>(coordinates[i + 1]),
                               static_cast<float>(coordinates[i + 2]));
  }
  std::optional<UvVertices> uv_vertices;
  if (with_uv && !attributes.texcoords.empty()) uv_vertices.emplace(mesh, attributes.texcoords);
  const auto vertex = [&](const tinyobj::index_t& corner) { return uv_vertices ? (*uv_vertices)(corner) : corner.vertex_index; };
  for (const tinyobj::shape_t& shape : shapes) {
    const std::vector<tinyobj::index_t>& corners = shape.mesh.indices;
    for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
      mesh.triangles.push_back({vertex(corners[i]), vertex(corners[i + 1]), vertex(corners[i + 2])});
    }
  }
  require(!mesh.triangles.empty(), source, "at least one face", "none");
  return mesh;
}

TriangleMesh load_obj(const std::filesystem::path& path, bool with_uv) {
  return parse_obj(read_text_file(path, "an OBJ file"), path.string(), with_uv);
}

}  // namespace flockstep
