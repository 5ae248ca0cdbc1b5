#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <functional>
#include <memory>

#include "synth/commands.hpp"
#include "synth/statistics.hpp"

namespace weft::synth {
namespace {

struct Row {
  const char* name;
  std::function<double(const ScanStatistics&)> value;
  bool of_parts = false;  // scenes without parts say nothing
};

const std::vector<Row>& rows() {
  static const std::vector<Row> table = {
      {"colour mean, grey levels", [](const auto& s) { return s.colour_mean; }},
      {"saturated pixels, %", [](const auto& s) { return 100 * s.saturated_share; }},
      {"colour noise, grey levels", [](const auto& s) { return s.colour_noise; }},
      {"SIFT norm decile 1, x1000", [](const auto& s) { return 1000 * s.gradient[0]; }},
      {"SIFT norm median, x1000", [](const auto& s) { return 1000 * s.gradient[1]; }},
      {"SIFT norm decile 9, x1000", [](const auto& s) { return 1000 * s.gradient[2]; }},
      {"  on parts, decile 1", [](const auto& s) { return 1000 * s.gradient_of_parts[0]; }, true},
      {"  on parts, median", [](const auto& s) { return 1000 * s.gradient_of_parts[1]; }, true},
      {"  on parts, decile 9", [](const auto& s) { return 1000 * s.gradient_of_parts[2]; }, true},
      {"depth median, m", [](const auto& s) { return s.depth_median_m; }},
      {"depth noise, mm", [](const auto& s) { return s.depth_noise_mm; }},
      {"depth noise / z^2, mm/m^2",
       [](const auto& s) {
         return s.depth_noise_mm / std::max(1e-6, s.depth_median_m * s.depth_median_m);
       }},
      {"depth step / z^2, mm/m^2",
       [](const auto& s) {
         return s.depth_step_mm / std::max(1e-6, s.depth_median_m * s.depth_median_m);
       }},
      {"noise correlation at 1 px", [](const auto& s) { return s.depth_correlation[0]; }},
      {"noise correlation at 4 px", [](const auto& s) { return s.depth_correlation[1]; }},
      {"noise correlation at 8 px", [](const auto& s) { return s.depth_correlation[2]; }},
      {"missing depth, %", [](const auto& s) { return 100 * s.missing_share; }},
      {"missing depth on parts, %", [](const auto& s) { return 100 * s.missing_of_parts; }, true},
  };
  return table;
}

constexpr double kOracle = 0.97;  // below it not even a perfect detector could score well

int print_statistics(const std::vector<std::string>& folders, std::size_t limit, bool check) {
  int bad = 0;
  std::vector<std::vector<ScanStatistics>> all;
  for (const auto& folder : folders) {
    std::vector<ScanStatistics> scenes;
    std::map<std::string, PartCount> parts;
    const auto dataset = dataset::open_dataset(folder);
    const std::size_t total = dataset->names().size(),
                      count = limit == 0 ? total : std::min(limit, total);
    for (std::size_t k = 0; k < count; ++k) {
      const auto scene = dataset->read(k * total / count);
      scenes.push_back(scan_statistics(scene));
      count_parts(scene, parts);
    }
    std::printf("%s: %zu scenes\n", folder.c_str(), scenes.size());
    for (const auto& [part, counted] : parts) {
      const double oracle =
          counted.usable > 0 ? static_cast<double>(counted.centred) / counted.usable : 1.0;
      const bool low = check && oracle < kOracle;
      bad += low ? 1 : 0;
      std::printf("  %-20s %4d usable, %4d ignored, oracle R@1 %.3f%s\n", part.c_str(),
                  counted.usable, counted.ignored, oracle, low ? " TOO LOW" : "");
    }
    all.push_back(std::move(scenes));
  }
  for (const auto& row : rows()) {
    std::printf("%-28s", row.name);
    for (const auto& scenes : all) {
      std::vector<double> values;
      for (const auto& s : scenes) {
        if (!row.of_parts || s.gradient_of_parts[2] > 0.0) values.push_back(row.value(s));
      }
      if (values.empty()) values.push_back(0.0);
      std::sort(values.begin(), values.end());
      const auto at = [&](double share) {
        return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) +
                                               0.5)];
      };
      std::printf(" | %7.2f %7.2f %7.2f", at(0.1), at(0.5), at(0.9));
    }
    std::printf("\n");
  }
  return bad == 0 ? 0 : 1;
}

}  // namespace

void add_statistics_command(CLI::App& app, Chosen& chosen) {
  struct Command {
    std::vector<std::string> folders;
    std::size_t limit = 100;
    bool check = false;
  };
  const auto command = std::make_shared<Command>();
  auto* sub = app.add_subcommand(
      "statistics",
      "compare data sets, synthetic and real: per scene, then the 10 %, 50 % and 90 % quantiles "
      "over the scenes");
  sub->add_option("folders", command->folders, "data sets")->required();
  sub->add_option("--limit", command->limit, "scenes read of each, evenly chosen; 0: all")
      ->capture_default_str();
  sub->add_flag("--check", command->check,
                "fail where the true boxes of a part have an oracle R@1 below 0.97");
  sub->callback([&chosen, command] {
    chosen = [command] {
      return print_statistics(command->folders, command->limit, command->check);
    };
  });
}

}  // namespace weft::synth
