#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <memory>
#include <sstream>
#include <thread>

#include "base/project.hpp"
#include "base/settings.hpp"
#include "synth/blender.hpp"
#include "synth/commands.hpp"
#include "synth/dataset_maker.hpp"
#include "synth/run_control.hpp"
#include "synth/text_file.hpp"

namespace weft::synth {
namespace {

struct Command {
  std::string out, recipe, simulations;
  std::vector<std::string> overrides;
  int jobs = std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
  int scenes = 0, seed = -1;
};

PartsRecipe read_recipe(const Command& command) {
  auto settings = Settings::from_file(
      command.recipe.empty() ? find_in_project("config/synth/parts.yaml") : command.recipe);
  for (const auto& assignment : command.overrides) settings.set(assignment);
  PartsRecipe recipe;
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

int make(const Command& command, SimulationSource& simulations, const MakeOptions& options) {
  catch_stop_signals();
  ProgressLine line;
  const auto start = std::chrono::steady_clock::now();
  const auto report = [&](const SynthProgress& p) {
    if (!p.error.empty()) line.note("failed: " + p.error);
    std::string text = fmt::format("{}/{} simulations, {}/{} scenes", p.simulations,
                                   p.simulations_total, p.done + p.skipped, p.total);
    if (p.skipped > 0) text += fmt::format(" ({} kept)", p.skipped);
    if (p.given_up > 0) text += fmt::format(", {} garments given up", p.given_up);
    if (p.failed > 0) text += fmt::format(", {} scenes failed", p.failed);
    if (p.seconds_left >= 0) text += ", " + time_text(p.seconds_left) + " left";
    line.show(text);
  };
  const auto progress = make_dataset(simulations, command.out, options, report, stop_requested);
  if (progress.stopped) {
    line.note(fmt::format("stopped with {} of {} scenes; the same command goes on from here",
                          progress.done + progress.skipped, progress.total));
    return 130;
  }
  const double seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  line.note(fmt::format("{}: {} scenes, {} made now in {}, {} failed", command.out,
                        progress.done + progress.skipped, progress.done, time_text(seconds),
                        progress.failed));
  fmt::print("{}", read_text(std::filesystem::path(command.out) / "summary.txt"));
  return progress.failed == 0 ? 0 : 1;
}

CLI::App* add_common(CLI::App& app, const char* name, const char* summary,
                     const std::shared_ptr<Command>& command) {
  auto* sub = app.add_subcommand(name, summary);
  sub->add_option("--out", command->out, "folder of the data set; what is finished in it is kept")
      ->required();
  sub->add_option("--seed", command->seed, "of everything that is drawn; default: the recipe's")
      ->check(CLI::Range(0, 1 << 30));
  sub->add_option("--jobs", command->jobs, "processes and threads; changes no byte of the set")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  sub->add_option("--recipe", command->recipe, "YAML file; default: config/synth/parts.yaml");
  sub->add_option("--set", command->overrides, "an option of the recipe, e.g. render.views=3")
      ->type_name("KEY=VALUE");
  return sub;
}

}  // namespace

void add_parts_command(CLI::App& app, Chosen& chosen) {
  const auto command = std::make_shared<Command>();
  auto* sub = add_common(
      app, "parts", "the garment parts set: simulates garments (with Blender) and renders them",
      command);
  sub->add_option("--scenes", command->scenes, "scenes in all; default: the recipe's")
      ->check(CLI::Range(1, 100000));
  sub->callback([&chosen, command] {
    chosen = [command] {
      const auto recipe = read_recipe(*command);
      const int views = recipe.render.views;
      const auto simulations = simulations_by_blender(
          (std::filesystem::path(command->out) / "simulations").string(), recipe.seed,
          (recipe.scenes + views - 1) / views, recipe.simulation);
      return make(
          *command, *simulations,
          {.seed = recipe.seed,
           .scenes = recipe.scenes,
           .render = recipe.render,
           .settings = fmt::format("simulator: {}\nseed: {}\n", blender_version(), recipe.seed) +
                       values(recipe.simulation) + values(recipe.render),
           .jobs = command->jobs});
    };
  });
}

void add_render_command(CLI::App& app, Chosen& chosen) {
  const auto command = std::make_shared<Command>();
  auto* sub = add_common(app, "render", "a set of all views of simulations that are there already",
                         command);
  sub->add_option("simulations", command->simulations, "folder of .wsim files")->required();
  sub->callback([&chosen, command] {
    chosen = [command] {
      const auto recipe = read_recipe(*command);
      return make(*command, *simulations_of_folder(command->simulations),
                  {.seed = recipe.seed,
                   .scenes = 0,
                   .render = recipe.render,
                   .settings = fmt::format("seed: {}\n", recipe.seed) + values(recipe.render),
                   .jobs = command->jobs});
    };
  });
}

}  // namespace weft::synth
