#include "base/json_document.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "base/excerpt.hpp"
#include "base/interrupt.hpp"
#include "base/nearest_name.hpp"
#include "base/require.hpp"

namespace flockstep::json {
namespace {

constexpr std::size_t kMaxDepth = 32;  // nesting of arrays and objects; a scene has 5

std::string escaped(std::string_view key) {
  std::string token;
  for (const char c : key) {
    if (c == '~') {
      token += "~0";
    } else if (c == '/') {
      token += "~1";
    } else {
      token += c;
    }
  }
  return token;
}

// Writes a value as JSON and stops once the text is long enough for a message.
void append(const Json& value, std::string& text) {
  constexpr std::size_t kEnough = 200;
  const auto list = [&](char open, char close, const auto& append_item) {
    text += open;
    for (auto item = value.begin(); item != value.end() && text.size() < kEnough; ++item) {
      if (item != value.begin()) text += ',';
      append_item(item);
    }
    text += close;
  };
  if (value.is_array()) {
    list('[', ']', [&](const auto& item) { append(*item, text); });
  } else if (value.is_object()) {
    list('{', '}', [&](const auto& item) {
      append(Json(excerpt(item.key(), kEnough)), text);
      text += ':';
      append(*item, text);
    });
  } else if (value.is_string()) {
    text += Json(excerpt(value.get_ref<const std::string&>(), kEnough)).dump();
  } else {
    text += value.dump();
  }
}

[[noreturn]] void refuse_json(const std::string& source, const std::string& what) {
  constexpr std::size_t kMaxReason = 300;
  const std::size_t prefix_end = what.find("] ");  // "[json.exception.parse_error.101] parse error at line 3, column 7: ..."
  throw std::invalid_argument(
      source + ": not valid JSON: " + excerpt(prefix_end == what.npos ? what : what.substr(prefix_end + 2), kMaxReason));
}

// Iterator over the characters of a text that polls for interrupts, because parsing may take long.
class Characters {
 public:
  using iterator_category = std::input_iterator_tag;
  using value_type = char;
  using difference_type = std::ptrdiff_t;
  using pointer = const char*;
  using reference = const char&;

  explicit Characters(const char* at) : at_(at) {}
  reference operator*() const { return *at_; }
  Characters& operator++() {
    constexpr std::uintptr_t kBetweenPolls = 1U << 16U;
    if (reinterpret_cast<std::uintptr_t>(++at_) % kBetweenPolls == 0) Interrupt::poll();
    return *this;
  }
  Characters operator++(int) {
    const Characters before = *this;
    ++*this;
    return before;
  }
  bool operator==(const Characters&) const = default;

 private:
  const char* at_;
};

// Frees a value, innermost parts first. Json's own destructor allocates memory for this, and terminates the process if that
// fails.
void take_apart(Json& value) noexcept {
  if (auto* const array = value.get_ptr<Json::array_t*>()) {
    for (Json& item : *array) take_apart(item);
    array->clear();
  } else if (auto* const object = value.get_ptr<Json::object_t*>()) {
    for (auto& [key, item] : *object) take_apart(item);
    object->clear();
  }
}

}  // namespace

std::string JsonPath::pointer() const {
  std::string text;
  for (std::size_t i = 0; i < depth_; ++i) {
    text += '/';
    text += steps_[i].key.data() == nullptr ? std::to_string(steps_[i].index) : escaped(steps_[i].key);
  }
  return text;
}

std::string JsonPath::member() const {
  std::string text;
  for (std::size_t i = 0; i < depth_; ++i) {
    const auto& [key, index] = steps_[i];
    if (key.data() == nullptr) {
      text += '[' + std::to_string(index) + ']';
    } else {
      if (!text.empty()) text += '.';
      text += excerpt(key);
    }
  }
  return text;
}

std::string excerpt_of(const Json& value) {
  std::string text;
  append(value, text);
  return excerpt(text);
}

std::string name_of(const JsonField& field) {
  if (field.is_config) {
    const std::string member = field.path.member();
    if (member.empty()) return field.source.empty() ? "configuration" : field.source;
    return field.source + (field.source.empty() || member.starts_with('[') ? "" : ".") + member;
  }
  constexpr std::size_t kMaxPointer = 200;
  const std::string pointer = field.path.pointer();
  return field.source + (pointer.empty() ? "" : ": " + excerpt(pointer, kMaxPointer));
}

void fail(const JsonField& field, const std::string& what) { throw std::invalid_argument(name_of(field) + ": " + what); }

void refuse(const JsonField& field, const std::string& expected) { refuse(field, expected, excerpt_of(field.value)); }

JsonField child(const JsonField& parent, std::string_view key, const Json& value) {
  return JsonField{value, parent.path / key, parent.source, parent.is_config};
}

JsonField child(const JsonField& parent, std::size_t index) {
  return JsonField{parent.value.at(index), parent.path / index, parent.source, parent.is_config};
}

std::optional<JsonField> find(const JsonField& object, std::string_view key) {
  const auto found = object.value.find(key);
  return found != object.value.end() ? std::optional<JsonField>(child(object, key, *found)) : std::nullopt;
}

JsonField require(const JsonField& object, std::string_view key) {
  const std::optional<JsonField> field = find(object, key);
  if (!field) fail(object, "expected a field \"" + std::string(key) + "\", found none");
  return *field;
}

void check_version(const JsonField& root, std::string_view key, int version) {
  const std::optional<JsonField> given = find(root, key);
  if (!given || given->value == version) return;
  const bool is_newer = given->value.is_number_integer() && given->value > version;
  refuse(*given, "version " + std::to_string(version),
         excerpt_of(given->value) + (is_newer ? " (written for a newer flockstep: install that one)" : ""));
}

void refuse_unknown(const JsonField& object, std::string_view key, std::span<const std::string_view> known) {
  std::string names;
  for (const std::string_view name : known) names += (names.empty() ? "" : ", ") + std::string(name);
  fail(child(object, key, object.value), "unknown field; expected one of " + names + did_you_mean(key, known));
}

void check_object(const JsonField& field, std::initializer_list<std::string_view> known) {
  if (!field.value.is_object()) refuse(field, "an object");
  for (const auto& [key, value] : field.value.items()) {
    if (std::find(known.begin(), known.end(), key) != known.end()) continue;
    refuse_unknown(field, key, {known.begin(), known.size()});
  }
}

const Json& require_array(const JsonField& field, const char* expected) {
  if (!field.value.is_array()) refuse(field, expected);
  return field.value;
}

const std::string& text(const JsonField& field) {
  if (!field.value.is_string()) refuse(field, "a string");
  return field.value.get_ref<const std::string&>();
}

std::uint64_t integer(const JsonField& field, std::uint64_t least, std::uint64_t most) {
  const double value = field.value.is_number() ? field.value.get<double>() : -1.0;
  if (!(value >= static_cast<double>(least) && value <= static_cast<double>(most) && value == std::floor(value))) {
    refuse(field, "an integer in [" + std::to_string(least) + ", " + std::to_string(most) + ']');
  }
  return static_cast<std::uint64_t>(value);
}

// Builds a document from parser events. Unlike nlohmann's own builder it rejects repeated fields, which JSON allows but which
// are mistakes here, and nesting too deep for recursion.
class DocumentBuilder final : public nlohmann::json_sax<Json> {
 public:
  DocumentBuilder(Document& document, std::initializer_list<std::string_view> ordered) : document_(document) {
    for (const std::string_view key : ordered) document_.ordered_keys_[std::string(key)];
  }

  bool null() override { return add(nullptr); }
  bool boolean(bool value) override { return add(value); }
  bool number_integer(number_integer_t value) override { return add(value); }
  bool number_unsigned(number_unsigned_t value) override { return add(value); }
  bool number_float(number_float_t value, const string_t&) override { return add(value); }
  bool string(string_t& value) override { return add(std::move(value)); }
  bool binary(binary_t& value) override { return add(std::move(value)); }
  bool start_object(std::size_t) override { return open(Json::value_t::object); }
  bool end_object() override { return close(); }
  bool start_array(std::size_t) override { return open(Json::value_t::array); }
  bool end_array() override { return close(); }
  bool key(string_t& name) override {
    if (open_.size() == 1) {
      const auto found = document_.ordered_keys_.find(name);
      ordered_ = found == document_.ordered_keys_.end() ? nullptr : &found->second;
    }
    if (open_.size() == 2 && ordered_ != nullptr) ordered_->push_back(name);
    const auto [field, is_new] = open_.back()->get_ref<Json::object_t&>().try_emplace(std::move(name));
    if (!is_new) flockstep::refuse(document_.source_, "each field once", excerpt_of(Json(field->first)) + " twice in one object");
    field_ = &field->second;
    return true;
  }
  bool parse_error(std::size_t, const std::string&, const nlohmann::detail::exception& error) override {
    refuse_json(document_.source_, error.what());
  }

 private:
  // Stores a value at the parser's position: at the end of an array, in a field of an object, or as the whole document.
  template <class Value>
  Json& place(Value&& value) {
    if (open_.empty()) return document_.root_ = std::forward<Value>(value);
    if (auto* const array = open_.back()->get_ptr<Json::array_t*>()) return array->emplace_back(std::forward<Value>(value));
    return *field_ = std::forward<Value>(value);
  }

  template <class Value>
  bool add(Value&& value) {
    place(std::forward<Value>(value));
    return true;
  }

  bool open(Json::value_t kind) {
    if (open_.size() == kMaxDepth) {
      flockstep::refuse(document_.source_, "at most " + std::to_string(kMaxDepth) + " levels of arrays and objects", "more");
    }
    open_.push_back(&place(kind));
    return true;
  }

  bool close() {
    open_.pop_back();
    return true;
  }

  Document& document_;
  std::vector<Json*> open_;                      // arrays and objects around the parser's position
  Json* field_ = nullptr;                        // field of the innermost object whose key was read last
  std::vector<std::string>* ordered_ = nullptr;  // key order of the current top-level object, null if not kept
};

std::unique_ptr<const Document> Document::parse(const std::string& text, std::string source,
                                                std::initializer_list<std::string_view> ordered) {
  auto document = std::make_unique<Document>(std::move(source));
  DocumentBuilder builder(*document, ordered);
  Json::sax_parse(Characters(text.data()), Characters(text.data() + text.size()), &builder);
  return document;
}

double shortest(double value) {
  const auto single = static_cast<float>(value);
  if (static_cast<double>(single) != value) return value;
  std::array<char, 32> digits{};
  const auto written = std::to_chars(digits.data(), digits.data() + digits.size(), single);
  double read = value;
  std::from_chars(digits.data(), written.ptr, read);
  return static_cast<float>(read) == single ? read : value;
}

std::span<const std::string> Document::ordered_keys(std::string_view of) const {
  const auto found = ordered_keys_.find(of);
  return found == ordered_keys_.end() ? std::span<const std::string>() : std::span<const std::string>(found->second);
}

Document::~Document() { take_apart(root_); }

}  // namespace flockstep::json

namespace flockstep {
namespace {

constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
constexpr std::uint8_t kNoDigit = 64;

constexpr std::array<std::uint8_t, 256> values_of_digits() {
  std::array<std::uint8_t, 256> values{};
  values.fill(kNoDigit);
  for (std::size_t i = 0; i < kDigits.size(); ++i) values[static_cast<unsigned char>(kDigits[i])] = static_cast<std::uint8_t>(i);
  return values;
}

}  // namespace

std::string base64_of(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const auto byte = [&](std::size_t k) -> std::uint32_t {
      return i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U;
    };
    const std::uint32_t bits = byte(0) << 16U | byte(1) << 8U | byte(2);
    for (std::size_t k = 0; k < 4; ++k) text += i + k <= bytes.size() ? kDigits[bits >> (18U - 6U * k) & 63U] : '=';
  }
  return text;
}

std::string bytes_of_base64(std::string_view text, const std::string& source) {
  static constexpr std::array<std::uint8_t, 256> kValues = values_of_digits();
  for (int i = 0; i < 2 && text.ends_with('='); ++i) text.remove_suffix(1);
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3 + 3);
  std::uint32_t bits = 0;
  unsigned count = 0;
  for (const char c : text) {
    const std::uint32_t value = kValues[static_cast<unsigned char>(c)];
    if (value == kNoDigit) refuse(source, "base64", "the character \"" + excerpt({&c, 1}) + '"');
    bits = bits << 6U | value;
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes += static_cast<char>(bits >> count & 0xffU);
  }
  require(count < 6, source, "base64", "one character too few");
  return bytes;
}

}  // namespace flockstep
