#pragma once

#include <filesystem>
#include <string>

namespace weft {

/// Everything in a file; empty when it cannot be read.
std::string read_text_file(const std::filesystem::path& file);

/// Writes a file, making its folder. Throws Error when it cannot be written.
void write_text_file(const std::filesystem::path& file, const std::string& text);

}  // namespace weft
