// Whole files as text.
#pragma once

#include <cstddef>
#include <filesystem>
#include <ios>
#include <string>

namespace flockstep {

inline constexpr std::streamoff kMaxFileBytes = std::streamoff{1} << 30;                                // larger ones are refused
inline constexpr std::size_t kMaxReadBytes = std::size_t{4} * static_cast<std::size_t>(kMaxFileBytes);  // of those one file names

// kind says in messages what the file was taken for ("a scene file"). Throw std::invalid_argument naming the file and the cause:
// it is missing, a folder or a device, or too large. A file is written beside its place and then renamed, so that it is there as
// a whole or as it was before.
std::string read_text_file(const std::filesystem::path& path, const std::string& kind);
void write_text_file(const std::filesystem::path& path, const std::string& kind, const std::string& text);

// ".obj" of a/b.OBJ.
std::string extension_of(const std::filesystem::path& path);

// Whether a path is that of a folder or of what is in it, links followed. What does not exist is taken by its name.
bool is_below(const std::filesystem::path& path, const std::filesystem::path& folder);

}  // namespace flockstep
