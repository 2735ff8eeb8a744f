#include "world/text_file.hpp"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <sstream>
#include <stdexcept>

namespace flockstep {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& what) {
  throw std::invalid_argument(path.string() + ": cannot " + what + ": " + std::strerror(errno));
}

}  // namespace

std::string read_text_file(const std::filesystem::path& path, const std::string& kind) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  const bool has_content = file && file.peek() != std::ifstream::traits_type::eof();
  if (has_content) text << file.rdbuf();  // which would fail on an empty file
  if (!file.is_open() || file.bad() || !text) fail(path, "read " + kind);
  return text.str();
}

void write_text_file(const std::filesystem::path& path, const std::string& kind, const std::string& text) {
  errno = 0;
  std::ofstream file(path, std::ios::binary);
  if (!(file << text) || !file.flush()) fail(path, "write " + kind);
}

}  // namespace flockstep
