#include "synth/recipe_command.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <sstream>
#include <thread>

namespace weft::synth {

CLI::App* add_recipe_command(CLI::App& app, const char* name, const char* summary,
                             const char* example, RecipeCommand& command) {
  command.jobs = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  auto* sub = app.add_subcommand(name, summary);
  sub->add_option("--out", command.out, "folder of the set; what is finished in it is kept")
      ->required();
  sub->add_option("--seed", command.seed, "of everything that is drawn; default: the recipe's")
      ->check(CLI::Range(0, 1 << 30));
  sub->add_option("--jobs", command.jobs, "processes and threads; changes no byte of the set")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  sub->add_option("--recipe", command.recipe, "YAML file of options; default: the standard recipe");
  sub->add_option("--set", command.overrides,
                  std::string("an option of the recipe, e.g. ") + example)
      ->type_name("KEY=VALUE");
  return sub;
}

std::string without_explanations(const std::string& yaml) {
  std::istringstream in(yaml);
  std::string out;
  for (std::string line; std::getline(in, line);) out += line.substr(0, line.find("  # ")) + "\n";
  return out;
}

}  // namespace weft::synth
