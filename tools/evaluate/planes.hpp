#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

/// `weft evaluate planes`
namespace weft::evaluate {

struct PlanesCommand {
  std::string dataset, json, pictures, settings_file;
  std::vector<std::string> assignments;
  double min_iou = 0.8;
  int min_px = 1600;  // four cells of 20 x 20 px: smaller planes are none to the extractor
};

void add_options(CLI::App& app, PlanesCommand& command);

/// Throws Error; the exit status is 0.
int evaluate_planes_command(const PlanesCommand& command);

}  // namespace weft::evaluate
