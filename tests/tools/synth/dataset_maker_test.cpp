#include "synth/dataset_maker.hpp"

#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>

#include "dataset/iri.hpp"
#include "support/files.hpp"
#include "tools/synth/procedural.hpp"

namespace weft::synth {
namespace {

namespace fs = std::filesystem;

std::map<std::string, std::string> contents(const std::string& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) {
      out[fs::relative(entry.path(), folder).string()] = test::read_bytes(entry.path().string());
    }
  }
  return out;
}

SynthProgress make(const std::string& in, const std::string& out, int jobs = 1) {
  SynthOptions options;
  options.views = 1;
  options.samples = 1;
  return make_dataset(in, out, options, jobs, [](const SynthProgress&) {});
}

TEST(DatasetMaker, SameBytesAgainAndAfterAKill) {
  const test::TemporaryFolder in, out;
  write_simulation(in / "a.wsim", test::procedural_sack("a", 0.004f));
  write_simulation(in / "b.wsim", test::procedural_sack("b"));
  EXPECT_EQ(make(in.string(), out / "one").done, 2);
  EXPECT_EQ(make(in.string(), out / "two", 2).done, 2);
  const auto first = contents(out / "one");
  EXPECT_EQ(first, contents(out / "two"));

  // What a kill leaves: no annotation, a half-written file, no manifest.
  fs::remove(out / "two/annotations/tshirt-a-v0.txt");
  fs::remove(out / "two/manifest.jsonl");
  test::write_bytes(out / "two/png/tshirt-a-v0.png", "half");
  const auto progress = make(in.string(), out / "two");
  EXPECT_EQ(progress.done, 1);
  EXPECT_EQ(progress.skipped, 1);
  EXPECT_EQ(first, contents(out / "two"));

  // A simulation that changed is rendered again, the other one is not.
  write_simulation(in / "b.wsim", test::procedural_sack("b", 0.006f));
  EXPECT_EQ(make(in.string(), out / "two").done, 1);
  const auto second = contents(out / "two");
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
}

TEST(DatasetMaker, KeepsReservedCutsApartAndCountsFailures) {
  const test::TemporaryFolder in, out;
  Simulation s = test::procedural_sack("c");
  s.held_out = true;
  write_simulation(in / "c.wsim", s);
  test::write_bytes(in / "d.wsim", "not a simulation\n");
  const auto progress = make(in.string(), out / "set");
  EXPECT_EQ(progress.done, 1);
  EXPECT_EQ(progress.failed, 1);
  const auto entry = nlohmann::json::parse(test::read_bytes(out / "set/manifest.jsonl"));
  EXPECT_EQ(entry["split"], "test-held-out");
  EXPECT_TRUE(entry["fabric_held_out"].get<bool>());
}

TEST(DatasetMaker, RefusesAFolderOfOtherOptions) {
  const test::TemporaryFolder in, out;
  write_simulation(in / "a.wsim", test::procedural_sack("a"));
  fs::create_directories(out / "set");
  test::write_bytes(out / "set/dataset.json", "{}\n");
  const auto error = test::error_of([&] { make(in.string(), out / "set"); });
  EXPECT_NE(error.find("other options"), std::string::npos) << error;
  const auto empty = test::error_of([&] { make(out.string(), out / "none"); });
  EXPECT_NE(empty.find("no .wsim file"), std::string::npos) << empty;
}

}  // namespace
}  // namespace weft::synth
