#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

/// `weft evaluate garments`
namespace weft::evaluate {

struct GarmentsCommand {
  std::string log;
  std::string truth;  // folder of a recording with garments.json
  std::string suffix, json, settings_file;
  std::vector<std::string> assignments;
};

void add_options(CLI::App& app, GarmentsCommand& command);

/// Throws Error; the exit status is 0.
int evaluate_garments_command(const GarmentsCommand& command);

}  // namespace weft::evaluate
