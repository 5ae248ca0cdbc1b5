#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <sstream>
#include <thread>

#include "base/settings.hpp"
#include "synth/blender.hpp"
#include "synth/commands.hpp"
#include "synth/run_control.hpp"
#include "synth/states_maker.hpp"
#include "synth/text_file.hpp"

namespace weft::synth {
namespace {

struct Command {
  std::string out, recipe, simulations;
  std::vector<std::string> overrides;
  int jobs = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  int scenes = 0, seed = -1;
};

template <class Recipe>
Recipe read_recipe(const Command& command) {
  auto settings = command.recipe.empty() ? Settings::empty("command line")
                                         : Settings::from_file(command.recipe);
  for (const auto& assignment : command.overrides) settings.set(assignment);
  Recipe recipe;
  settings.read(recipe);
  if (command.scenes > 0) recipe.scenes = command.scenes;
  if (command.seed >= 0) recipe.seed = command.seed;
  return recipe;
}

/// Values without their explanations, whose wording changes no scene.
template <class Options>
std::string values(const Options& options) {
  std::istringstream in(options_to_yaml(options));
  std::string out;
  for (std::string line; std::getline(in, line);) out += line.substr(0, line.find("  # ")) + "\n";
  return out;
}

template <class Recipe, class Make>
int run(const Command& command, Make make) {
  const auto recipe = read_recipe<Recipe>(command);
  recipe.validate();
  const auto simulations =
      command.simulations.empty()
          ? tshirt_states_by_blender((std::filesystem::path(command.out) / "simulations").string(),
                                     recipe.seed, recipe.simulations, recipe.attempts)
          : simulations_of_folder(command.simulations);
  const auto settings =
      (command.simulations.empty() ? "simulator: " + blender_version() + "\n" : "") +
      values(recipe);
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
  fmt::print("{}", read_text(std::filesystem::path(command.out) / "summary.txt"));
  return 0;
}

std::shared_ptr<Command> add(CLI::App& app, const char* name, const char* summary, CLI::App*& sub) {
  const auto command = std::make_shared<Command>();
  sub = app.add_subcommand(name, summary);
  sub->add_option("--out", command->out, "folder of the set; what is finished in it is kept")
      ->required();
  sub->add_option("--scenes", command->scenes, "images or sequences in all; default: the recipe's")
      ->check(CLI::Range(1, 100000));
  sub->add_option("--seed", command->seed, "of everything that is drawn; default: the recipe's")
      ->check(CLI::Range(0, 1 << 30));
  sub->add_option("--jobs", command->jobs, "processes and threads; changes no byte of the set")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  sub->add_option("--simulations", command->simulations,
                  "folder of simulated T-shirts; default: Blender makes them");
  sub->add_option("--recipe", command->recipe, "YAML file of options");
  sub->add_option("--set", command->overrides, "an option of the recipe, e.g. samples=1")
      ->type_name("KEY=VALUE");
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
