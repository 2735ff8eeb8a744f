#include "base/text_file.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <system_error>

#include "base/platform.hpp"
#include "base/require.hpp"

namespace flockstep {
namespace {

[[noreturn]] void fail(const std::filesystem::path& path, const std::string& what) {
  const int code = errno;
  const std::string text = path.string() + ": cannot " + what + ": " + std::strerror(code);
  if (code == ENOENT) throw MissingFile(text);
  throw std::invalid_argument(text);
}

// Rejects pipes and devices: they may be endless, and a file must not replace them.
void require_regular(const std::filesystem::path& path, const std::string& what) {
  std::error_code error;
  const std::filesystem::file_status status = std::filesystem::status(path, error);
  if (!std::filesystem::exists(status) || std::filesystem::is_regular_file(status)) return;
  throw std::invalid_argument(path.string() + ": cannot " + what + ": not a regular file");
}

}  // namespace

std::string read_text_file(const std::filesystem::path& path, const std::string& kind) {
  require_regular(path, "read " + kind);
  errno = 0;
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file.is_open()) fail(path, "read " + kind);
  const std::streamoff size = file.tellg();
  if (size < 0) fail(path, "read " + kind);
  require(size <= kMaxFileBytes, path.string(), "at most " + std::to_string(kMaxFileBytes) + " bytes", size);
  std::string text(static_cast<std::size_t>(size), '\0');
  file.seekg(0);
  file.read(text.data(), size);
  if (file.gcount() != size) fail(path, "read " + kind);
  return text;
}

void write_text_file(const std::filesystem::path& path, const std::string& kind, const std::string& text) {
  std::error_code error;
  require_regular(path, "write " + kind);
  const bool is_link = std::filesystem::is_symlink(path, error);
  error.clear();
  const std::filesystem::path place = is_link ? std::filesystem::weakly_canonical(path, error) : path;
  if (error) throw std::invalid_argument(path.string() + ": cannot write " + kind + ": " + error.message());
  std::filesystem::path beside = place;  // unique among all running processes and threads
  for (const std::string& part : {std::string("."), std::to_string(process_id()), std::string("-"),
                                  std::to_string(reinterpret_cast<std::uintptr_t>(&error)), std::string(".part")}) {
    beside += part;
  }
  try {
    errno = 0;
    std::ofstream file(beside, std::ios::binary);
    if (!(file << text) || !file.flush()) fail(path, "write " + kind);
    file.close();
    if (!file) fail(path, "write " + kind);
    std::filesystem::rename(beside, place, error);
    if (error) throw std::invalid_argument(path.string() + ": cannot write " + kind + ": " + error.message());
  } catch (...) {
    std::filesystem::remove(beside, error);
    throw;
  }
}

std::string extension_of(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return extension;
}

bool is_below(const std::filesystem::path& path, const std::filesystem::path& folder) {
  std::error_code error;
  const auto resolved = [&error](const std::filesystem::path& p) {
    if (error) return std::filesystem::path();
    const std::filesystem::path absolute = std::filesystem::absolute(p.empty() ? std::filesystem::path(".") : p, error);
    return error ? std::filesystem::path() : std::filesystem::weakly_canonical(absolute, error);
  };
  const std::filesystem::path inner = resolved(path);
  const std::filesystem::path outer = resolved(folder);
  return !error && std::mismatch(outer.begin(), outer.end(), inner.begin(), inner.end()).first == outer.end();
}

}  // namespace flockstep
