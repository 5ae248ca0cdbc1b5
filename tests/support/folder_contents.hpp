#pragma once

#include <filesystem>
#include <map>
#include <string>

#include "support/files.hpp"

namespace weft::test {

/// The bytes of all files in a folder and below, by their paths in it.
inline std::map<std::string, std::string> folder_contents(const std::string& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      out[std::filesystem::relative(entry.path(), folder).string()] =
          read_bytes(entry.path().string());
    }
  }
  return out;
}

}  // namespace weft::test
