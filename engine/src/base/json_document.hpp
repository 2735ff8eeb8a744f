// A JSON document from outside, read with care: refusals name the source, the place in it, what was expected and what came.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <initializer_list>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/require.hpp"

namespace flockstep::json {

using Json = nlohmann::json;  // finds a key among many in no time, and forgets their order

// The way to a value of the document: what a message names it by, and only then written as text. Keys outlive it: they are the
// document's or the program's own.
class Path {
 public:
  Path operator/(std::string_view key) const { return with({key, 0}); }
  Path operator/(std::size_t index) const { return with({{}, index}); }

  std::string pointer() const;  // RFC 6901

 private:
  struct Step {
    std::string_view key;  // without data where the step is an index
    std::size_t index = 0;
  };

  Path with(Step step) const {
    Path longer = *this;
    longer.steps_.at(longer.depth_++) = step;
    return longer;
  }

  static constexpr std::size_t kMaxSteps = 8;  // as a texture's offset in glTF has
  std::array<Step, kMaxSteps> steps_{};
  std::size_t depth_ = 0;
};

// A value of the document and the place it has there.
struct JsonField {
  const Json& value;
  Path path;
  const std::string& source;
};

// The value as JSON, as much of it as a message shows.
std::string excerpt_of(const Json& value);

// "source: /place/of/the/field"
std::string name_of(const JsonField& field);

[[noreturn]] void fail(const JsonField& field, const std::string& what);
[[noreturn]] void refuse(const JsonField& field, const std::string& expected);
template <class Got>
[[noreturn]] void refuse(const JsonField& field, const std::string& expected, const Got& got) {
  flockstep::refuse(name_of(field), expected, got);
}

// An element of an array, and fields of an object.
JsonField child(const JsonField& parent, std::size_t index);
JsonField child(const JsonField& parent, std::string_view key, const Json& value);
std::optional<JsonField> find(const JsonField& object, std::string_view key);
JsonField require(const JsonField& object, std::string_view key);

// Says of a field that the object may not have it, and which may be meant.
[[noreturn]] void refuse_unknown(const JsonField& object, std::string_view key, std::span<const std::string_view> known);

// Refuse what is no object, and fields that are not known.
void check_object(const JsonField& field, std::initializer_list<std::string_view> known);
const Json& require_array(const JsonField& field, const char* expected);

// For writing: the double with the fewest digits that reads back as this value; a sum or difference of float32 may need more than
// float32 digits.
double shortest(double value);

class Document {
 public:
  // source names the text in messages. Of the objects under the keys `ordered`, the order of keys is kept.
  static std::unique_ptr<const Document> parse(const std::string& text, std::string source,
                                               std::initializer_list<std::string_view> ordered = {});
  explicit Document(std::string source) : source_(std::move(source)) {}  // an empty one
  ~Document();
  Document(const Document&) = delete;
  Document& operator=(const Document&) = delete;

  JsonField root() const { return {root_, Path(), source_}; }
  std::span<const std::string> ordered_keys(std::string_view of) const;

 private:
  friend class DocumentBuilder;

  Json root_;
  std::string source_;
  std::map<std::string, std::vector<std::string>, std::less<>> ordered_keys_;
};

}  // namespace flockstep::json
