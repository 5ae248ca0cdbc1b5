#include "base/text_file.hpp"

#include <fstream>
#include <sstream>

#include "base/error.hpp"

namespace weft {

namespace fs = std::filesystem;

std::string read_text_file(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void write_text_file(const fs::path& file, const std::string& text) {
  std::error_code error;
  if (file.has_parent_path()) fs::create_directories(file.parent_path(), error);
  const bool special = fs::exists(file, error) && !fs::is_regular_file(file, error);
  const fs::path written = special ? file : fs::path(file.string() + ".tmp");
  std::ofstream out(written, std::ios::binary);
  out << text;
  out.close();
  error.clear();
  if (out && !special) fs::rename(written, file, error);
  if (!out || error) {
    throw Error(file.string() +
                ": cannot be written; check the folder, its rights and the free space");
  }
}

}  // namespace weft
