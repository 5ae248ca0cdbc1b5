#include <CLI/CLI.hpp>
#include <cstdio>

#include "base/error.hpp"
#include "base/settings.hpp"
#include "synth/dataset_maker.hpp"

int main(int argc, char** argv) {
  using namespace weft::synth;
  CLI::App app("Render simulated garments (.wsim) into an annotated RGB-D data set");
  std::string simulations, out, settings_file, sheet;
  std::vector<std::string> overrides;
  int jobs = 1;
  app.add_option("simulations", simulations, "folder of .wsim files")->required();
  app.add_option("--out", out, "folder of the data set; finished scenes in it are kept")
      ->required();
  app.add_option("--settings", settings_file, "YAML file of options");
  app.add_option("--set", overrides,
                 "option=value: seed, views, samples, double_share, test_share");
  app.add_option("--jobs", jobs, "scenes rendered at the same time")->check(CLI::Range(1, 256));
  app.add_option("--contact-sheet", sheet, "PNG to write with a choice of the scenes");
  CLI11_PARSE(app, argc, argv);
  try {
    auto settings = settings_file.empty() ? weft::Settings::empty("command line")
                                          : weft::Settings::from_file(settings_file);
    for (const auto& assignment : overrides) settings.set(assignment);
    SynthOptions options;
    settings.read(options);
    const auto result = make_dataset(simulations, out, options, jobs, [](const SynthProgress& p) {
      const int left = p.total - p.done - p.skipped - p.failed;
      const double each = p.done > 0 ? p.seconds / p.done : 0.0;
      std::fprintf(stderr, "%d of %d scenes (%d kept, %d failed), %.0f s left: %s\n",
                   p.done + p.skipped, p.total, p.skipped, p.failed, each * left, p.last.c_str());
    });
    if (!sheet.empty()) write_contact_sheet(out, sheet, 48);
    return result.failed == 0 ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "weft-synth-render: %s\n", error.what());
    return 2;
  }
}
