// Reads and writes whole files as text.
#pragma once

#include <cstddef>
#include <filesystem>
#include <ios>
#include <string>

namespace flockstep {

// Larger files are rejected. The second limit is for the total of all files that one file names.
inline constexpr std::streamoff kMaxFileBytes = std::streamoff{1} << 30;
inline constexpr std::size_t kMaxReadBytes = std::size_t{4} * static_cast<std::size_t>(kMaxFileBytes);

// `kind` describes the file in messages ("a scene file"). Throw std::invalid_argument that names the file and the cause: it is
// missing, a folder, a device or too large. Writing is atomic: the text goes to a temporary file, which is then renamed.
std::string read_text_file(const std::filesystem::path& path, const std::string& kind);
void write_text_file(const std::filesystem::path& path, const std::string& kind, const std::string& text);

// Returns the extension in lower case: ".obj" for a/b.OBJ.
std::string extension_of(const std::filesystem::path& path);

// Returns whether a path is the folder itself or lies in it. Links are resolved; paths that do not exist are compared by name.
bool is_below(const std::filesystem::path& path, const std::filesystem::path& folder);

}  // namespace flockstep
