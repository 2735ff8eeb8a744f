#include "world/obj.hpp"

#include <tiny_obj_loader.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <istream>
#include <limits>
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

// tinyobjloader reads a malformed number as 0, lets indices run out of range, and believes any size that a line states. So it is
// given a text that has been checked and has nothing but vertices and faces, of vertex indices alone; and now and then a new
// object, at which it cuts the faces so far into triangles, so that it never does so for long.
std::string checked(std::string_view text, const std::string& source) {
  std::string kept;
  long num_vertices = 0;
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

}  // namespace

TriangleMesh parse_obj(std::string_view text, const std::string& source) {
  PolledText polled(checked(text, source));
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
  for (const tinyobj::shape_t& shape : shapes) {
    const std::vector<tinyobj::index_t>& corners = shape.mesh.indices;
    for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
      mesh.triangles.push_back({corners[i].vertex_index, corners[i + 1].vertex_index, corners[i + 2].vertex_index});
    }
  }
  require(!mesh.triangles.empty(), source, "at least one face", "none");
  return mesh;
}

TriangleMesh load_obj(const std::filesystem::path& path) { return parse_obj(read_text_file(path, "an OBJ file"), path.string()); }

}  // namespace flockstep
