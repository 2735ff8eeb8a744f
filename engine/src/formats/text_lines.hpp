// Splits text files into lines, words and numbers.
#pragma once

#include <algorithm>
#include <charconv>
#include <cstddef>
#include <string_view>
#include <system_error>

namespace flockstep {

// Removes the next line from the text and returns it. Lines end with \n, \r\n or \r.
inline std::string_view next_line(std::string_view& text) {
  const auto end = std::find_if(text.begin(), text.end(), [](char c) { return c == '\n' || c == '\r'; });
  const std::string_view line(text.begin(), end);
  text.remove_prefix(line.size());
  text.remove_prefix(text.starts_with("\r\n") ? 2 : std::min<std::size_t>(text.size(), 1));
  return line;
}

// Removes the next word from the line and returns it; empty at the end.
inline std::string_view next_word(std::string_view& line) {
  const auto is_space = [](char c) { return c == ' ' || c == '\t'; };
  const auto begin = std::find_if_not(line.begin(), line.end(), is_space);
  const auto end = std::find_if(begin, line.end(), is_space);
  line = {end, line.end()};
  return {begin, end};
}

// Returns the text without surrounding spaces and tabs.
inline std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kSpace = " \t";
  text.remove_prefix(std::min(text.find_first_not_of(kSpace), text.size()));
  return text.substr(0, text.find_last_not_of(kSpace) + 1);
}

// Parses a word that consists of exactly one number. Returns false if it does not, or if the number does not fit the type.
template <class Number>
bool parse_number(std::string_view word, Number& value) {
  if (word.size() > 1 && word[0] == '+' && word[1] != '-') word.remove_prefix(1);  // from_chars does not accept +
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc() && end == word.data() + word.size();
}

}  // namespace flockstep
