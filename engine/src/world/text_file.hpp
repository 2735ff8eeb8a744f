// Whole files as text.
#pragma once

#include <filesystem>
#include <string>

namespace flockstep {

// kind says in messages what the file was taken for ("a scene file"). Throw std::invalid_argument naming the file and the cause.
std::string read_text_file(const std::filesystem::path& path, const std::string& kind);
void write_text_file(const std::filesystem::path& path, const std::string& kind, const std::string& text);

}  // namespace flockstep
