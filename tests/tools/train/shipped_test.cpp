// The settings and models that ship: config/training, config/models, config/sets.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/hash.hpp"
#include "base/settings.hpp"
#include "descriptor/dense_descriptor.hpp"
#include "detector/model.hpp"
#include "train/trainer.hpp"

namespace weft::train {
namespace {

namespace fs = std::filesystem;
using Kind = descriptor::DescriptorOptions::Kind;

const std::string kConfig = WEFT_SOURCE_DIR "/config/";
const std::vector<std::string> kNine = {"sift",     "gdh",       "fpfh",     "hks",        "finddd",
                                        "gdh-sift", "fpfh-sift", "hks-sift", "finddd-sift"};

TrainOptions settings_of(const std::string& name) {
  TrainOptions options;
  Settings::from_file(kConfig + "training/parts-" + name + ".yaml").read(options);
  return options;
}

std::string name_of(const descriptor::DescriptorOptions& options) {
  return descriptor::make_descriptor(options)->name();
}

TEST(Shipped, SettingsAreOfTheDescriptorsInTheirName) {
  for (const auto& name : kNine) {
    const auto options = settings_of(name);
    std::string described = name_of(options.describe.descriptor);
    if (options.combined) described += "-" + name_of(options.second);
    EXPECT_EQ(described, name);
    EXPECT_TRUE(options.describe.view.rectified) << name;
  }
}

TEST(Shipped, ThePaperPresetHasThePapersValues) {
  const std::map<std::string, int> dimensions = {
      {"sift", 128}, {"gdh", 88}, {"fpfh", 33}, {"hks", 60}, {"finddd", 208}};
  for (const auto& [name, dimension] : dimensions) {
    const auto options = settings_of(name + "-paper");
    const auto& descriptor = options.describe.descriptor;
    EXPECT_EQ(name_of(descriptor), name);
    EXPECT_EQ(descriptor::make_descriptor(descriptor)->dimension(), dimension);
    EXPECT_FALSE(options.describe.view.rectified) << name;
    EXPECT_EQ(options.describe.grid.step_px, 6) << name;
    EXPECT_EQ(options.kmeans.words, 128) << name;
    EXPECT_FALSE(options.context) << name;
    EXPECT_FALSE(options.combined) << name;
  }
  // Section 5.1.
  const auto finddd = settings_of("finddd-paper").describe.descriptor.finddd;
  EXPECT_EQ(finddd.patch_px, 43);
  EXPECT_EQ(finddd.cells * finddd.cells, 16);
  const auto gdh = settings_of("gdh-paper").describe.descriptor.gdh;
  EXPECT_EQ(gdh.geodesic_bins, 8);
  EXPECT_EQ(gdh.depth_bins, 11);
  const auto hks = settings_of("hks-paper").describe.descriptor.hks;
  EXPECT_EQ(hks.patch_px, 60);
  EXPECT_EQ(hks.stride_px, 1);
  EXPECT_EQ(hks.frequencies, 60);
}

TEST(Shipped, ModelsAreMadeWithTheSettings) {
  auto all = kNine;
  all.push_back("sift-paper");
  for (const auto& name : all) {
    const auto folder = kConfig + "models/parts-" + name;
    const auto bundle = detector::ModelBundle::read(folder);  // checks files against the manifest
    const auto manifest = nlohmann::json::parse(std::ifstream(folder + "/manifest.json"));
    EXPECT_EQ(manifest.at("settings_hash"), to_hex(options_hash(settings_of(name)))) << name;
    EXPECT_TRUE(fs::exists(kConfig + "sets/parts-" + name + ".yaml")) << name;
    EXPECT_EQ(bundle.score.parts.size(), detector::kParts.size()) << name;
    EXPECT_EQ(bundle.refine.parts.size(), detector::kParts.size()) << name;
  }
}

}  // namespace
}  // namespace weft::train
