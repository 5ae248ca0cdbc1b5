#include "base/project.hpp"

#include "base/error.hpp"

namespace weft {
namespace fs = std::filesystem;

fs::path program_folder() { return fs::read_symlink("/proc/self/exe").parent_path(); }

std::string find_in_project(const std::string& file) {
  for (const auto& start : {fs::current_path(), program_folder()}) {
    for (auto folder = start; !folder.empty(); folder = folder.parent_path()) {
      if (fs::exists(folder / file)) return (folder / file).string();
      if (folder == folder.root_path()) break;
    }
  }
  throw Error(file + " is not there; run weft in the project's folder, or name the file");
}

}  // namespace weft
