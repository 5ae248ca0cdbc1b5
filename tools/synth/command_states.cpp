#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>

#include "base/text_file.hpp"
#include "synth/blender.hpp"
#include "synth/commands.hpp"
#include "synth/recipe_command.hpp"
#include "synth/run_control.hpp"
#include "synth/sequences_maker.hpp"
#include "synth/states_maker.hpp"

namespace weft::synth {
namespace {

template <class Recipe, class Make>
int run(const RecipeCommand& command, Make make) {
  const auto recipe = read_recipe<Recipe>(command, "");
  recipe.validate();
  const auto simulations =
      command.simulations.empty()
          ? tshirt_states_by_blender((std::filesystem::path(command.out) / "simulations").string(),
                                     recipe.seed, recipe.simulations, recipe.attempts)
          : simulations_of_folder(command.simulations);
  const auto settings =
      (command.simulations.empty() ? "simulator: " + blender_version() + "\n" : "") +
      without_explanations(options_to_yaml(recipe));
  catch_stop_signals();
  ProgressLine line;
  const auto report = [&](const StatesProgress& p) {
    std::string text = fmt::format("{}/{} {}", p.done, p.total, p.stage);
    if (p.seconds_left >= 0) text += ", " + time_text(p.seconds_left) + " left";
    line.show(text);
  };
  const auto result =
      make(*simulations, command.out, recipe, settings, command.jobs, report, stop_requested);
  if (result.stopped) {
    line.note("stopped; the same command goes on from here");
    return 130;
  }
  line.note(fmt::format("{}: {} {}, {} simulations given up", command.out, result.done,
                        result.stage, result.given_up));
  fmt::print("{}", read_text_file(std::filesystem::path(command.out) / "summary.txt"));
  return 0;
}

std::shared_ptr<RecipeCommand> add(CLI::App& app, const char* name, const char* summary,
                                   CLI::App*& sub) {
  const auto command = std::make_shared<RecipeCommand>();
  sub = add_recipe_command(app, name, summary, "samples=1", *command);
  sub->add_option("--scenes", command->scenes, "images or sequences in all; default: the recipe's")
      ->check(CLI::Range(1, 100000));
  sub->add_option("--simulations", command->simulations,
                  "folder of simulated T-shirts; default: Blender makes them");
  return command;
}

}  // namespace

void add_states_command(CLI::App& app, Chosen& chosen) {
  CLI::App* sub = nullptr;
  const auto command = add(
      app, "states", "T-shirts in six states on desks: images with instance masks, meshes", sub);
  sub->callback([&chosen, command] {
    chosen = [command] { return run<StatesRecipe>(*command, make_states); };
  });
}

void add_sequences_command(CLI::App& app, Chosen& chosen) {
  CLI::App* sub = nullptr;
  const auto command =
      add(app, "sequences", "a camera moving round a desk with T-shirts, in the TUM format", sub);
  sub->callback([&chosen, command] {
    chosen = [command] { return run<SequencesRecipe>(*command, make_sequences); };
  });
}

}  // namespace weft::synth
