#include "tools/weft/text_file.hpp"

#include <fstream>
#include <sstream>

#include "base/error.hpp"

namespace weft {

std::string read_text_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void write_text_file(const std::filesystem::path& file, const std::string& text) {
  if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path());
  std::ofstream out(file, std::ios::trunc | std::ios::binary);
  out << text;
  out.close();
  if (!out) throw Error(file.string() + ": cannot write; check the folder and its permissions");
}

}  // namespace weft
