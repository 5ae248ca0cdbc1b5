#pragma once

#include <string>
#include <vector>

#include "base/settings.hpp"

namespace CLI {
class App;
}

/// What the commands that make a set from a recipe have in common on the command line.
namespace weft::synth {

struct RecipeCommand {
  std::string out, recipe, simulations;
  std::vector<std::string> overrides;
  int jobs = 0;               // add_recipe_command() makes it the number of cores
  int scenes = 0, seed = -1;  // 0 and -1: the recipe's
};

/// A subcommand with --out, --seed, --jobs, --recipe and --set; example: of a setting.
CLI::App* add_recipe_command(CLI::App& app, const char* name, const char* summary,
                             const char* example, RecipeCommand& command);

/// The recipe's file, `standard` where none is named (empty: all defaults), with the command
/// line's settings on top. Throws Error.
template <class Recipe>
Recipe read_recipe(const RecipeCommand& command, const std::string& standard) {
  const std::string file = command.recipe.empty() ? standard : command.recipe;
  auto settings = file.empty() ? Settings::empty("command line") : Settings::from_file(file);
  for (const auto& assignment : command.overrides) settings.set(assignment);
  Recipe recipe;
  settings.read(recipe);
  if (command.scenes > 0) recipe.scenes = command.scenes;
  if (command.seed >= 0) recipe.seed = command.seed;
  return recipe;
}

/// YAML as options_to_yaml() writes it, without the explanations, whose wording changes no scene.
std::string without_explanations(const std::string& yaml);

}  // namespace weft::synth
