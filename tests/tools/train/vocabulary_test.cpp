#include "train/vocabulary.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/error.hpp"
#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::train {
namespace {

/// Grey boxes: plenty of corners.
cv::Mat draw_boxes(Random& random) {
  cv::Mat image(240, 320, CV_8UC3, cv::Scalar::all(128));
  for (int i = 0; i < 150; ++i) {
    const cv::Rect box(static_cast<int>(random.below(300)), static_cast<int>(random.below(220)),
                       6 + static_cast<int>(random.below(14)),
                       6 + static_cast<int>(random.below(14)));
    image(box).setTo(cv::Scalar::all(static_cast<double>(random.below(256))));
  }
  return image;
}

struct Pictures {
  test::TemporaryFolder folder;
  Pictures() {
    Random random(1);
    for (const char* name : {"a/rgb/1.png", "a/rgb/2.png", "b/rgb/1.png", "b/depth/1.png"}) {
      const auto file = std::filesystem::path(folder / name);
      std::filesystem::create_directories(file.parent_path());
      cv::imwrite(file.string(), draw_boxes(random));
    }
    test::write_bytes(folder / "dataset.json", R"({"format": "weft-synth-sequences"})");
  }
};

VocabularyTraining small() {
  VocabularyTraining training;
  training.features.features = 300;
  training.vocabulary.branching = 5;
  training.vocabulary.levels = 2;
  return training;
}

void train(const Pictures& pictures, const std::string& out, const VocabularyTraining& training) {
  train_vocabulary({pictures.folder.string()}, out, training, [](int, int) {});
}

TEST(TrainVocabulary, TakesColourPicturesInTheOrderOfTheirNames) {
  const Pictures pictures;
  const auto found = colour_pictures(pictures.folder.string());
  EXPECT_EQ(found, (std::vector<std::string>{pictures.folder / "a/rgb/1.png",
                                             pictures.folder / "a/rgb/2.png",
                                             pictures.folder / "b/rgb/1.png"}));
  EXPECT_THROW(colour_pictures(pictures.folder / "b/depth"), Error);
  EXPECT_THROW(colour_pictures(pictures.folder / "nothing"), Error);
}

TEST(TrainVocabulary, WritesTheSameModelTwice) {
  const Pictures pictures;
  train(pictures, pictures.folder / "one", small());
  train(pictures, pictures.folder / "two", small());
  for (const std::string file : {"vocabulary.blob", "training.yaml", "manifest.json"}) {
    const auto one = test::read_bytes(pictures.folder / ("one/" + file));
    EXPECT_FALSE(one.empty());
    EXPECT_EQ(one, test::read_bytes(pictures.folder / ("two/" + file))) << file;
  }
  const auto vocabulary = slam::BinaryVocabulary::read(pictures.folder / "one/vocabulary.blob");
  EXPECT_GT(vocabulary.words(), 15);
  EXPECT_LE(vocabulary.words(), 25);
  const auto manifest =
      nlohmann::json::parse(test::read_bytes(pictures.folder / "one/manifest.json"));
  EXPECT_EQ(manifest["data"]["pictures"], 3);
  EXPECT_EQ(manifest["words"], vocabulary.words());
  EXPECT_EQ(manifest["data"]["sets"][0]["format"], "weft-synth-sequences");
  EXPECT_EQ(manifest["files"]["vocabulary.blob"],
            std::filesystem::file_size(pictures.folder / "one/vocabulary.blob"));
}

TEST(TrainVocabulary, OtherPicturesGiveAnotherModel) {
  const Pictures pictures;
  auto training = small();
  train(pictures, pictures.folder / "one", training);
  training.every = 2;
  train(pictures, pictures.folder / "two", training);
  const auto read = [&](const char* name) {
    return nlohmann::json::parse(test::read_bytes(pictures.folder / name));
  };
  const auto one = read("one/manifest.json"), two = read("two/manifest.json");
  EXPECT_EQ(two["data"]["pictures"], 2);
  EXPECT_NE(one["hash"], two["hash"]);
  EXPECT_NE(one["data"]["hash"], two["data"]["hash"]);
  EXPECT_NE(one["settings_hash"], two["settings_hash"]);
}

}  // namespace
}  // namespace weft::train
