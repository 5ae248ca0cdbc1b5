#pragma once

#include <filesystem>
#include <string>

/// Where programs find their files, in a build tree or wherever it was moved to.
namespace weft {

/// Folder of the running program.
std::filesystem::path program_folder();

/// A file of the project, looked for from the working folder and from the program's folder upwards.
/// Throws Error when it is nowhere.
std::string find_in_project(const std::string& file);

}  // namespace weft
