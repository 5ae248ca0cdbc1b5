#include "train/train.hpp"

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "base/error.hpp"
#include "base/settings.hpp"
#include "dataset/scene.hpp"
#include "train/trainer.hpp"

namespace weft::train {
namespace {

/// One line a second and one at the end of each step: done, total, rate, time left.
class Progress {
 public:
  void operator()(const std::string& step, int done, int total) {
    const auto now = std::chrono::steady_clock::now();
    if (step != step_) {
      step_ = step;
      began_ = now;
      first_ = done;
      shown_ = {};
    }
    if (done < total && now - shown_ < std::chrono::seconds(1)) return;
    shown_ = now;
    const double seconds = std::chrono::duration<double>(now - began_).count();
    const double rate = seconds > 0.05 ? (done - first_) / seconds : 0.0;
    std::fprintf(stderr, "%-10s %5d / %d", step.c_str(), done, total);
    if (rate > 0.0) std::fprintf(stderr, "  %.2f/s  %.0f s left", rate, (total - done) / rate);
    std::fputc('\n', stderr);
  }

 private:
  std::string step_;
  std::chrono::steady_clock::time_point began_, shown_;
  int first_ = 0;
};

}  // namespace

int run_train(int argc, char** argv) {
  CLI::App app{
      "Trains the part detector's models from a dataset. `weft train vocabulary` makes the map's "
      "vocabulary."};
  std::string folder, out, work, settings_file;
  std::vector<std::string> assignments;
  int threads = 0;
  bool print = false;
  app.add_option("--dataset", folder, "folder of annotated scenes (weft synth parts makes one)");
  app.add_option("--out", out, "folder for the models");
  app.add_option("--work", work, "folder for finished steps; default: OUT.work");
  app.add_option("--settings", settings_file, "YAML file; see --print-settings");
  app.add_option("--set", assignments, "key=value over the settings, e.g. kmeans.words=256");
  app.add_option("--threads", threads, "0: one for each core");
  app.add_flag("--print-settings", print, "print all settings with their defaults and stop");
  try {
    app.parse(argc, argv);
    if (print) {
      std::fputs(options_to_yaml(TrainOptions{}).c_str(), stdout);
      return 0;
    }
    if (folder.empty() || out.empty()) throw CLI::RequiredError("--dataset and --out");
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    auto settings = settings_file.empty() ? Settings::empty("command line")
                                          : Settings::from_file(settings_file);
    for (const auto& assignment : assignments) settings.set(assignment);
    TrainOptions options;
    settings.read(options);
    const auto data = dataset::open_dataset(folder);
    if (work.empty()) work = out + ".work";
    Progress progress;
    train_models(
        *data, out, work, options,
        threads > 0 ? threads : static_cast<int>(std::thread::hardware_concurrency()),
        [&](const std::string& step, int done, int total) { progress(step, done, total); },
        [](const std::string& text) { std::fprintf(stderr, "note: %s\n", text.c_str()); });
    std::fprintf(stderr, "models in %s\n", out.c_str());
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "weft train: %s\n", error.what());
    return 1;
  }
}

}  // namespace weft::train
