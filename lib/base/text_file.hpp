#pragma once

#include <filesystem>
#include <string>

namespace weft {

/// Everything in a file, byte for byte; empty when it cannot be read.
std::string read_text_file(const std::filesystem::path& file);

/// Writes a file, making its folder. It appears whole or not at all: written beside its place,
/// then renamed; a device or pipe is written to as it is. Throws Error when it cannot be written.
void write_text_file(const std::filesystem::path& file, const std::string& text);

}  // namespace weft
