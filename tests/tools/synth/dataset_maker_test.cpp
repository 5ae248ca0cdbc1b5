#include "synth/dataset_maker.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/settings.hpp"
#include "dataset/iri.hpp"
#include "support/files.hpp"
#include "support/folder_contents.hpp"
#include "synth/statistics.hpp"
#include "tools/synth/procedural.hpp"

namespace weft::synth {
namespace {

namespace fs = std::filesystem;

MakeOptions small(int scenes = 0, int jobs = 1) {
  MakeOptions options;
  options.scenes = scenes;
  options.render.views = 1;
  options.render.samples = 1;
  options.jobs = jobs;
  return options;
}

bool never() { return false; }

SynthProgress make(const std::string& in, const std::string& out, int jobs = 1) {
  return make_dataset(
      *simulations_of_folder(in), out, small(0, jobs), [](const SynthProgress&) {}, never);
}

/// As the simulator does, but copying: some indices are given up, and later ones finish first.
class SlowSource : public SimulationSource {
 public:
  SlowSource(std::string ready, std::string folder, int count)
      : ready_(std::move(ready)), folder_(std::move(folder)), count_(count) {
    fs::create_directories(folder_);
  }
  int wanted() const override { return count_; }
  std::optional<std::string> get(int index, const std::function<bool()>& stopped) override {
    const std::string name = std::to_string(index) + ".wsim", to = folder_ + "/" + name;
    if (fs::exists(to)) return to;
    std::this_thread::sleep_for(std::chrono::milliseconds(index % 2 == 0 ? 30 : 1));
    if (!fs::exists(ready_ + "/" + name) || stopped()) return std::nullopt;
    fs::copy_file(ready_ + "/" + name, to + ".tmp", fs::copy_options::overwrite_existing);
    fs::rename(to + ".tmp", to);
    ++made;
    return to;
  }
  std::atomic<int> made = 0;

 private:
  std::string ready_, folder_;
  int count_;
};

TEST(DatasetMaker, SameBytesAgainAndAfterAKill) {
  const test::TemporaryFolder in, out;
  write_simulation(in / "a.wsim", test::procedural_sack("a", 0.004f));
  write_simulation(in / "b.wsim", test::procedural_sack("b"));
  EXPECT_EQ(make(in.string(), out / "one").done, 2);
  EXPECT_EQ(make(in.string(), out / "two", 2).done, 2);
  const auto first = test::folder_contents(out / "one");
  EXPECT_EQ(first, test::folder_contents(out / "two"));

  // What a kill leaves: no annotation, a half-written file, no manifest.
  fs::remove(out / "two/annotations/tshirt-a-v0.txt");
  fs::remove(out / "two/manifest.jsonl");
  test::write_bytes(out / "two/png/tshirt-a-v0.png", "half");
  const auto progress = make(in.string(), out / "two");
  EXPECT_EQ(progress.done, 1);
  EXPECT_EQ(progress.skipped, 1);
  EXPECT_EQ(first, test::folder_contents(out / "two"));

  // A simulation that changed is rendered again, the other one is not.
  write_simulation(in / "b.wsim", test::procedural_sack("b", 0.006f));
  EXPECT_EQ(make(in.string(), out / "two").done, 1);
  const auto second = test::folder_contents(out / "two");
  EXPECT_EQ(first.at("pcd/tshirt-a-v0.pcd"), second.at("pcd/tshirt-a-v0.pcd"));
  EXPECT_NE(first.at("pcd/tshirt-b-v0.pcd"), second.at("pcd/tshirt-b-v0.pcd"));

  const auto dataset = dataset::open_iri(out / "one");
  ASSERT_EQ(dataset->names().size(), 2u);
  const auto scene = dataset->read(0);
  EXPECT_EQ(scene.garment, "tshirt");
  EXPECT_EQ(scene.frame.colour.cols, 640);
  EXPECT_EQ(scene.frame.mask.size(), scene.frame.colour.size());
  std::istringstream manifest(first.at("manifest.jsonl"));
  int lines = 0;
  for (std::string line; std::getline(manifest, line); ++lines) {
    const auto entry = nlohmann::json::parse(line);
    EXPECT_EQ(entry["parts"].size(), 2u);
    EXPECT_EQ(entry["name"], lines == 0 ? "tshirt-a-v0" : "tshirt-b-v0");
  }
  EXPECT_EQ(lines, 2);
  EXPECT_NE(first.at("summary.txt").find("2 scenes of 2 simulations"), std::string::npos);
}

TEST(DatasetMaker, TrueBoxesHitTheirParts) {
  const test::TemporaryFolder in, out;
  for (const int i : {0, 1, 2}) {
    write_simulation(in / (std::to_string(i) + ".wsim"),
                     test::procedural_sack(std::to_string(i), 0.002f * static_cast<float>(i)));
  }
  MakeOptions options = small();
  options.render.views = 4;
  make_dataset(
      *simulations_of_folder(in.string()), out / "set", options, [](const SynthProgress&) {},
      never);
  const auto dataset = dataset::open_iri(out / "set");
  std::map<std::string, PartCount> parts;
  for (std::size_t i = 0; i < dataset->names().size(); ++i) count_parts(dataset->read(i), parts);
  ASSERT_EQ(parts.size(), 2u);
  for (const auto& [part, count] : parts) {
    EXPECT_GE(count.usable, 5) << part;
    EXPECT_GE(count.centred, 0.97 * count.usable) << part;
  }
}

TEST(DatasetMaker, KilledAtAnyMomentThenTakenUpAgainIsTheSameFolder) {
  const test::TemporaryFolder in, out;
  for (const int i : {0, 2, 3, 4, 6}) {  // 1 and 5 are given up
    Simulation s = test::procedural_sack(std::to_string(i), 0.001f * static_cast<float>(i));
    if (i % 2 == 0) s.garment = "polo";
    write_simulation(in / (std::to_string(i) + ".wsim"), s);
  }
  MakeOptions options = small(7, 2);
  options.render.views = 2;
  options.render.double_share = 0.5;
  const auto run = [&](const std::string& folder) {
    SlowSource source(in.string(), folder + "/simulations", 4);
    return make_dataset(
        source, folder, options, [](const SynthProgress&) {}, never);
  };
  const auto undisturbed = run(out / "one");
  EXPECT_EQ(undisturbed.done, 7);      // the last simulation has one view
  EXPECT_EQ(undisturbed.given_up, 1);  // index 1
  const auto expected = test::folder_contents(out / "one");
  EXPECT_TRUE(expected.contains("annotations/polo-4-v0.txt"));
  EXPECT_FALSE(expected.contains("annotations/polo-4-v1.txt"));
  EXPECT_FALSE(expected.contains("simulations/6.wsim"));

  int kills = 0;
  for (const int after_ms : {60, 150, 300, 450}) {
    const pid_t child = fork();
    ASSERT_GE(child, 0);
    if (child == 0) {
      run(out / "two");
      _exit(0);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(after_ms));
    kill(child, SIGKILL);
    int status = 0;
    waitpid(child, &status, 0);
    kills += WIFSIGNALED(status) ? 1 : 0;
  }
  EXPECT_GE(kills, 1);
  const auto last = run(out / "two");
  EXPECT_EQ(last.done + last.skipped, 7);
  EXPECT_EQ(test::folder_contents(out / "two"), expected);
}

TEST(DatasetMaker, StopsBetweenScenesAndGrows) {
  const test::TemporaryFolder in, out;
  for (const char* name : {"0", "1", "2"})
    write_simulation(in / (std::string(name) + ".wsim"), test::procedural_sack(name));
  int scenes = 0;
  const auto run = [&](int count, int stop_after) {
    SlowSource source(in.string(), out / "set/simulations", count);
    return make_dataset(
        source, out / "set", small(count), [&](const SynthProgress& p) { scenes = p.done; },
        [&] { return scenes >= stop_after; });
  };
  const auto stopped = run(2, 1);
  EXPECT_TRUE(stopped.stopped);
  EXPECT_EQ(stopped.done, 1);
  EXPECT_FALSE(fs::exists(out / "set/manifest.jsonl"));
  EXPECT_EQ(run(2, 100).skipped, 1);
  const auto grown = run(3, 100);
  EXPECT_EQ(grown.skipped, 2);
  EXPECT_EQ(grown.done, 1);
  const auto error = test::error_of([&] { run(2, 100); });
  EXPECT_NE(error.find("more than the 2 asked for"), std::string::npos) << error;
}

TEST(DatasetMaker, KeepsReservedCutsApart) {
  const test::TemporaryFolder in, out;
  Simulation s = test::procedural_sack("c");
  s.held_out = true;
  write_simulation(in / "c.wsim", s);
  EXPECT_EQ(make(in.string(), out / "set").done, 1);
  const auto entry = nlohmann::json::parse(test::read_bytes(out / "set/manifest.jsonl"));
  EXPECT_EQ(entry["split"], "test-held-out");
  EXPECT_TRUE(entry["fabric_held_out"].get<bool>());
}

TEST(DatasetMaker, SaysWhatIsWrong) {
  const test::TemporaryFolder in, out;
  write_simulation(in / "a.wsim", test::procedural_sack("a"));
  fs::create_directories(out / "set");
  test::write_bytes(out / "set/dataset.json", "{}\n");
  auto error = test::error_of([&] { make(in.string(), out / "set"); });
  EXPECT_NE(error.find("other settings"), std::string::npos) << error;
  error = test::error_of([&] { make(out.string(), out / "none"); });
  EXPECT_NE(error.find("no .wsim file"), std::string::npos) << error;
  test::write_bytes(in / "b.wsim", "not a simulation\n");
  error = test::error_of([&] { make(in.string(), out / "broken"); });
  EXPECT_NE(error.find("b.wsim"), std::string::npos) << error;
  SlowSource nothing(out.string(), out / "empty", 2);
  error = test::error_of([&] {
    make_dataset(
        nothing, out / "given-up", small(2), [](const SynthProgress&) {}, never);
  });
  EXPECT_NE(error.find("given up"), std::string::npos) << error;
}

TEST(Recipe, ShippedFileNamesEveryOptionAndIsTheDefault) {
  PartsRecipe shipped;
  const auto settings = Settings::from_file(WEFT_SOURCE_DIR "/config/synth/parts.yaml");
  settings.read(shipped);
  EXPECT_EQ(options_to_yaml(shipped), options_to_yaml(PartsRecipe{}));
  const std::string text = test::read_bytes(WEFT_SOURCE_DIR "/config/synth/parts.yaml");
  std::istringstream reference(options_to_yaml(shipped));
  for (std::string line; std::getline(reference, line);) {
    const std::string key = line.substr(0, line.find(':') + 1);
    EXPECT_NE(text.find("\n" + key), std::string::npos) << key;
  }
}

TEST(Recipe, RefusesUnknownTypesAndShares) {
  PartsRecipe recipe;
  recipe.simulation.garments = {"kilt"};
  EXPECT_NE(test::error_of([&] { recipe.validate(); }).find("kilt"), std::string::npos);
  recipe = {};
  recipe.simulation.state_shares = {0.5, 0.5, 0.5, 0.0};
  EXPECT_NE(test::error_of([&] { recipe.validate(); }).find("add up to 1"), std::string::npos);
}

}  // namespace
}  // namespace weft::synth
