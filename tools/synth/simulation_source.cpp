#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <vector>

#include "base/error.hpp"
#include "base/project.hpp"
#include "base/text_file.hpp"
#include "synth/blender.hpp"
#include "synth/dataset_maker.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

class FolderSource : public SimulationSource {
 public:
  explicit FolderSource(std::vector<std::string> paths) : paths_(std::move(paths)) {}
  int wanted() const override { return static_cast<int>(paths_.size()); }
  std::optional<std::string> get(int index, const std::function<bool()>&) override {
    return paths_.at(static_cast<std::size_t>(index));
  }

 private:
  std::vector<std::string> paths_;
};

class BlenderSource : public SimulationSource {
 public:
  /// script: in tools/synth/simulate; options: its arguments beyond those that every script has.
  BlenderSource(const std::string& folder, int seed, int count, int attempts,
                const std::string& script, std::vector<std::string> options)
      : folder_(folder),
        script_(find_in_project("tools/synth/simulate/" + script)),
        seed_(seed),
        count_(count),
        attempts_(attempts),
        options_(std::move(options)) {
    fs::create_directories(folder);
  }
  int wanted() const override { return count_; }

  std::optional<std::string> get(int index, const std::function<bool()>& stopped) override {
    const fs::path base = fs::path(folder_) / fmt::format("{}-{:05d}", seed_, index);
    const std::string file = base.string() + ".wsim";
    const auto given_up = [&] {
      const std::string rejects = read_text_file(base.string() + ".rejects.jsonl");
      return std::count(rejects.begin(), rejects.end(), '\n') >= attempts_;
    };
    if (fs::exists(file)) return file;
    if (given_up()) return std::nullopt;
    std::vector<std::string> arguments = {"--out",      folder_,
                                          "--seed",     std::to_string(seed_),
                                          "--index",    std::to_string(index),
                                          "--attempts", std::to_string(attempts_)};
    arguments.insert(arguments.end(), options_.begin(), options_.end());
    // A crash that repeats belongs to this garment; the next one takes its place.
    for (int crashes = 0; crashes < 2; ++crashes) {
      const auto end = run_blender(script_, arguments, stopped);
      if (end == BlenderEnd::kStopped) return std::nullopt;
      if (fs::exists(file)) return file;
      if (given_up()) return std::nullopt;
      if (end == BlenderEnd::kDone)
        throw Error(file + ": Blender ended without an error, but wrote no simulation");
    }
    std::string rejects;
    for (int attempt = 0; attempt < attempts_; ++attempt)
      rejects += fmt::format("{{\"seed\": {}, \"index\": {}, \"reason\": \"Blender crashed\"}}\n",
                             seed_, index);
    write_text_file(base.string() + ".rejects.jsonl", rejects);
    return std::nullopt;
  }

 private:
  std::string folder_, script_;
  int seed_, count_, attempts_;
  std::vector<std::string> options_;
};

}  // namespace

std::unique_ptr<SimulationSource> simulations_of_folder(const std::string& folder) {
  if (!fs::is_directory(folder)) throw Error(folder + ": not a folder of .wsim files");
  std::vector<std::string> paths;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() == ".wsim") paths.push_back(entry.path().string());
  }
  if (paths.empty()) throw Error(folder + ": no .wsim file is there");
  std::sort(paths.begin(), paths.end());
  return std::make_unique<FolderSource>(std::move(paths));
}

std::unique_ptr<SimulationSource> simulations_by_blender(const std::string& folder, int seed,
                                                         int count,
                                                         const SimulationOptions& options) {
  options.validate();
  return std::make_unique<BlenderSource>(
      folder, seed, count, options.attempts, "main.py",
      std::vector<std::string>{"--garments", fmt::format("{}", fmt::join(options.garments, ",")),
                               "--state-shares",
                               fmt::format("{}", fmt::join(options.state_shares, ",")),
                               "--held-out-share", fmt::format("{}", options.held_out_share),
                               "--turned-over-share", fmt::format("{}", options.turned_over_share),
                               "--vertices", std::to_string(options.vertices)});
}

std::unique_ptr<SimulationSource> tshirt_states_by_blender(const std::string& folder, int seed,
                                                           int count, int attempts) {
  return std::make_unique<BlenderSource>(folder, seed, count, attempts, "tshirts.py",
                                         std::vector<std::string>{});
}

}  // namespace weft::synth
