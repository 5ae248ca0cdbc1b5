#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/settings.hpp"
#include "base/text_file.hpp"
#include "synth/commands.hpp"
#include "synth/invariance.hpp"
#include "synth/run_control.hpp"

namespace weft::synth {
namespace {

struct Command {
  std::string folder, plot, json;
  std::vector<std::string> descriptors = {"sift"};
  int garments = 12, threads = 0;
};

std::vector<std::string> choose(const Command& command) {
  std::vector<std::string> all, chosen;
  if (!std::filesystem::is_directory(command.folder))
    throw Error(command.folder + ": not a folder of .wsim files");
  for (const auto& entry : std::filesystem::directory_iterator(command.folder))
    if (entry.path().extension() == ".wsim") all.push_back(entry.path().string());
  if (all.empty()) throw Error(command.folder + ": no .wsim file is there");
  std::sort(all.begin(), all.end());
  const auto count = std::min(all.size(), static_cast<std::size_t>(command.garments));
  for (std::size_t i = 0; i < count; ++i) chosen.push_back(all[i * all.size() / count]);
  return chosen;
}

int run(const Command& command) {
  std::vector<bovw::DescribeOptions> describe;
  for (const bool rectified : {false, true}) {
    for (const auto& name : command.descriptors) {
      auto settings = Settings::empty("--descriptors");
      settings.set("kind=" + name);
      bovw::DescribeOptions options;
      settings.read(options.descriptor);
      options.view.rectified = rectified;
      describe.push_back(options);
    }
  }
  ProgressLine line;
  const auto results = measure_invariance(
      choose(command), describe, plotted_changes(), command.threads,
      [&](int done, int total) { line.show(fmt::format("{}/{}", done, total)); });
  line.note("");
  nlohmann::ordered_json json;
  for (std::size_t d = 0; d < results.size(); ++d) {
    const auto& name = command.descriptors[d % command.descriptors.size()];
    const char* view = describe[d].view.rectified ? "rectified" : "sensor";
    for (const auto& r : results[d]) {
      fmt::print(
          "{:<8} {:<10} {:<18} {:>6} {:<5}  stability {:.3f}  described {:.3f}  ({} points)\n",
          name, view, change_name(r.change), r.level, change_unit(r.change), r.stability,
          r.described, r.points);
      json[name][view][change_name(r.change)].push_back({{"level", r.level},
                                                         {"stability", r.stability},
                                                         {"described", r.described},
                                                         {"points", r.points}});
    }
  }
  if (!command.json.empty()) write_text_file(command.json, json.dump(1) + "\n");
  const auto middle = results.begin() + static_cast<std::ptrdiff_t>(command.descriptors.size());
  if (!command.plot.empty())
    write_text_file(command.plot, invariance_plot(command.descriptors, {results.begin(), middle},
                                                  {middle, results.end()}));
  return 0;
}

}  // namespace

void add_invariance_command(CLI::App& app, Chosen& chosen) {
  const auto command = std::make_shared<Command>();
  auto* sub = app.add_subcommand(
      "invariance",
      "how well descriptors of the same place match under noise, rotation, tilt and distance");
  sub->add_option("simulations", command->folder, "folder of .wsim files")->required();
  sub->add_option("--descriptors", command->descriptors, "kinds, with their default options")
      ->delimiter(',')
      ->capture_default_str();
  sub->add_option("--garments", command->garments, "simulations used, evenly chosen")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  sub->add_option("--threads", command->threads, "0: one for each core; the answer is the same");
  sub->add_option("--plot", command->plot, "SVG file to write");
  sub->add_option("--json", command->json, "file to write");
  sub->callback([&chosen, command] { chosen = [command] { return run(*command); }; });
}

}  // namespace weft::synth
