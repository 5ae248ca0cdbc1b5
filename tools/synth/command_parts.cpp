#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <filesystem>
#include <memory>

#include "base/project.hpp"
#include "base/text_file.hpp"
#include "synth/blender.hpp"
#include "synth/commands.hpp"
#include "synth/dataset_maker.hpp"
#include "synth/recipe_command.hpp"
#include "synth/run_control.hpp"

namespace weft::synth {
namespace {

PartsRecipe parts_recipe(const RecipeCommand& command) {
  return read_recipe<PartsRecipe>(
      command, command.recipe.empty() ? find_in_project("config/synth/parts.yaml") : "");
}

int make(const RecipeCommand& command, SimulationSource& simulations, const MakeOptions& options) {
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
  fmt::print("{}", read_text_file(std::filesystem::path(command.out) / "summary.txt"));
  return progress.failed == 0 ? 0 : 1;
}

}  // namespace

void add_parts_command(CLI::App& app, Chosen& chosen) {
  const auto command = std::make_shared<RecipeCommand>();
  auto* sub = add_recipe_command(
      app, "parts", "the garment parts set: simulates garments (with Blender) and renders them",
      "render.views=2", *command);
  sub->add_option("--scenes", command->scenes, "scenes in all; default: the recipe's")
      ->check(CLI::Range(1, 100000));
  sub->callback([&chosen, command] {
    chosen = [command] {
      const auto recipe = parts_recipe(*command);
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
                       without_explanations(options_to_yaml(recipe.simulation)) +
                       without_explanations(options_to_yaml(recipe.render)),
           .jobs = command->jobs});
    };
  });
}

void add_render_command(CLI::App& app, Chosen& chosen) {
  const auto command = std::make_shared<RecipeCommand>();
  auto* sub =
      add_recipe_command(app, "render", "a set of all views of simulations that are there already",
                         "render.views=2", *command);
  sub->add_option("simulations", command->simulations, "folder of .wsim files")->required();
  sub->callback([&chosen, command] {
    chosen = [command] {
      const auto recipe = parts_recipe(*command);
      return make(*command, *simulations_of_folder(command->simulations),
                  {.seed = recipe.seed,
                   .scenes = 0,
                   .render = recipe.render,
                   .settings = fmt::format("seed: {}\n", recipe.seed) +
                               without_explanations(options_to_yaml(recipe.render)),
                   .jobs = command->jobs});
    };
  });
}

}  // namespace weft::synth
