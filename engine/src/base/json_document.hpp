// Reads untrusted JSON documents. Error messages name the source, the place in it, the expected value and the actual one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
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

using Json = nlohmann::json;  // finds keys fast, does not keep their order

// Path to a value in the document, for messages; it becomes text only when a message needs it. Its keys are views of strings
// that the document or the program owns.
class JsonPath {
 public:
  JsonPath operator/(std::string_view key) const { return with({key, 0}); }
  JsonPath operator/(std::size_t index) const { return with({{}, index}); }

  std::string pointer() const;  // RFC 6901
  std::string member() const;   // "beams[0].yaw_deg"

 private:
  struct Step {
    std::string_view key;  // null data if the step is an index
    std::size_t index = 0;
  };

  JsonPath with(Step step) const {
    JsonPath longer = *this;
    longer.steps_.at(longer.depth_++) = step;
    return longer;
  }

  static constexpr std::size_t kMaxSteps = 8;  // enough for a texture's offset in glTF
  std::array<Step, kMaxSteps> steps_{};
  std::size_t depth_ = 0;
};

// A value and its path in the document.
struct JsonField {
  const Json& value;
  JsonPath path;
  const std::string& source;
  bool is_config = false;  // the field of a configuration: named "source.member[0]", and null is a value
};

// Returns the value as JSON, shortened for a message.
std::string excerpt_of(const Json& value);

// "source: /place/of/the/field", or "source.member[0]" in a configuration
std::string name_of(const JsonField& field);

[[noreturn]] void fail(const JsonField& field, const std::string& what);
[[noreturn]] void refuse(const JsonField& field, const std::string& expected);
template <class Got>
[[noreturn]] void refuse(const JsonField& field, const std::string& expected, const Got& got) {
  flockstep::refuse(name_of(field), expected, got);
}

// Access an element of an array, or a field of an object.
JsonField child(const JsonField& parent, std::size_t index);
JsonField child(const JsonField& parent, std::string_view key, const Json& value);
std::optional<JsonField> find(const JsonField& object, std::string_view key);
JsonField require(const JsonField& object, std::string_view key);

// Rejects a document whose version, the number under `key`, is not `version`. Call it before checking other fields, because
// another version may have others. Accepts a document without the number, and one that is not an object.
void check_version(const JsonField& root, std::string_view key, int version);

// Reports an unknown field, with the list of known ones and the most similar name.
[[noreturn]] void refuse_unknown(const JsonField& object, std::string_view key, std::span<const std::string_view> known);

// Reject values that are not objects or have unknown fields, and values that are not arrays.
void check_object(const JsonField& field, std::initializer_list<std::string_view> known);
const Json& require_array(const JsonField& field, const char* expected);

// Returns the value, which must be a string, or a whole number in this range, also written as 7.0.
const std::string& text(const JsonField& field);
std::uint64_t integer(const JsonField& field, std::uint64_t least, std::uint64_t most);

// Returns the double with the fewest digits that rounds to the same float32 as the value. Returns a value that is not a float32
// unchanged, such as a sum or difference that needs more digits.
double shortest(double value);

class Document {
 public:
  // `source` names the text in messages. For the objects under the top-level keys in `ordered`, the order of their keys is
  // kept.
  static std::unique_ptr<const Document> parse(const std::string& text, std::string source,
                                               std::initializer_list<std::string_view> ordered = {});
  explicit Document(std::string source) : source_(std::move(source)) {}  // an empty document
  ~Document();
  Document(const Document&) = delete;
  Document& operator=(const Document&) = delete;

  JsonField root() const { return {root_, JsonPath(), source_}; }
  std::span<const std::string> ordered_keys(std::string_view of) const;

 private:
  friend class DocumentBuilder;

  Json root_;
  std::string source_;
  std::map<std::string, std::vector<std::string>, std::less<>> ordered_keys_;
};

}  // namespace flockstep::json

namespace flockstep {

// Base64 (RFC 4648), as used for bytes in JSON.
std::string base64_of(std::string_view bytes);

// Padding is optional. Throws std::invalid_argument that names the source if a character is not in the base64 alphabet.
std::string bytes_of_base64(std::string_view text, const std::string& source);

}  // namespace flockstep
