#include "detector/pipeline.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgproc.hpp>

#include "base/hash.hpp"
#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::detector {
namespace {

/// A folder of models with random weights, made like the trainer makes them.
struct Models {
  explicit Models(std::uint64_t seed) {
    Random random(seed);
    describe.view.rectified = false;
    std::vector<std::uint8_t> centres;
    for (int i = 0; i < 16 * 128; ++i) {
      centres.push_back(static_cast<std::uint8_t>(random.below(120)));
    }
    const bovw::Vocabulary vocabulary("sift", 128, centres, options_hash(describe),
                                      options_to_yaml(describe));
    vocabulary.write(folder / vocabulary_file("sift"));
    ScoreModel score;
    score.blocks = {{"sift", vocabulary.hash(), 16}};
    RefineModel refine;
    PriorModel prior;
    refine.blocks = prior.blocks = score.blocks;
    for (const char* name : {"polo collar", "jeans hips"}) {
      std::vector<double> weights;
      for (int w = 0; w < 16; ++w) weights.push_back(2.0 * random.normal());
      PartClassifier classifier;
      classifier.part = name;
      classifier.weights = {quantise_weights(weights)};
      classifier.shapes = {{60, 42}, {42, 60}};
      score.parts.push_back(classifier);
      PartPriorModel part_prior;
      part_prior.part = name;
      part_prior.weights = weights;
      part_prior.threshold = 0.5;
      prior.parts.push_back(part_prior);
      PartSvm svm;
      svm.part = name;
      svm.shapes = classifier.shapes;
      for (int i = 0; i < 16 * 40; ++i) {
        svm.counts.push_back(static_cast<std::int32_t>(random.below(9)));
      }
      for (int i = 0; i < 40; ++i) svm.coefficients.push_back(random.normal());
      refine.parts.push_back(svm);
    }
    score.write(folder / kScoreFile);
    refine.write(folder / kRefineFile);
    prior.write(folder / kPriorFile);
    Hash64 hash;
    hash.add(vocabulary.hash());
    hash.add(ScoreModel::read(folder / kScoreFile).hash);
    hash.add(RefineModel::read(folder / kRefineFile).hash);
    hash.add(PriorModel::read(folder / kPriorFile).hash);
    std::ofstream(folder / kManifestFile) << "{\"hash\": \"" << to_hex(hash.value()) << "\"}";
  }
  test::TemporaryFolder folder;
  bovw::DescribeOptions describe;
};

struct Picture {
  Picture() {
    Random random(9);
    frame.camera = {320, 240, 262, 262, 159.5, 119.5};
    frame.colour.create(240, 320, CV_8UC3);
    for (int y = 0; y < 240; ++y) {
      for (int x = 0; x < 320; ++x) {
        const auto v = static_cast<std::uint8_t>(random.below(256));
        frame.colour.at<cv::Vec3b>(y, x) = {v, v, v};
      }
    }
    cv::GaussianBlur(frame.colour, frame.colour, {0, 0}, 2.0);
    frame.depth = cv::Mat(240, 320, CV_16UC1, cv::Scalar(900));
    mask = cv::Mat::zeros(240, 320, CV_8UC1);
    cv::ellipse(mask, {160, 120}, {110, 80}, 10, 0, 360, cv::Scalar(255), cv::FILLED);
  }
  rgbd::RgbdFrame frame;
  cv::Mat mask;
};

TEST(Detector, ComputesWhatTheStepsCompute) {
  const Models models(1);
  const Picture picture;
  DetectorOptions options;
  options.prior = PriorMode::kSoft;
  const Detector detector(ModelBundle::read(models.folder.string()), options);
  const auto result = detector.detect(picture.frame, picture.mask, nullptr, 2);

  const auto& bundle = detector.bundle();
  const auto descriptor = descriptor::make_descriptor(models.describe.descriptor);
  const auto grid = bovw::quantise(
      bovw::describe_frame(picture.frame, picture.mask, nullptr, models.describe, *descriptor, 1),
      "sift", bundle.vocabularies[0], 1);
  EXPECT_EQ(result.grids.at(0).cells, grid.cells);
  const bovw::WordGrid* const grids[] = {&grid};
  const auto priors = evaluate_prior(bundle.prior, grids, PriorMode::kSoft);
  const auto scores = score_parts(bundle.score, grids, priors, PriorMode::kSoft, {}, 1);
  const auto detections = Refiner(bundle.refine, {}).refine(grids, scores.candidates, 1);
  ASSERT_FALSE(detections.empty());
  ASSERT_EQ(result.detections.size(), detections.size());
  for (std::size_t i = 0; i < detections.size(); ++i) {
    EXPECT_EQ(result.detections[i].probability, detections[i].probability);
    EXPECT_EQ(result.detections[i].part, detections[i].part);
    EXPECT_EQ(result.detections[i].centre_sensor_px, detections[i].centre_sensor_px);
  }
}

TEST(ModelBundle, RefusesFilesOfDifferentTrainings) {
  const Models ours(1), others(2);
  EXPECT_EQ(ModelBundle::read(ours.folder.string()).score.parts.size(), 2u);
  const std::vector<std::string> files = {vocabulary_file("sift"), kScoreFile, kRefineFile,
                                          kPriorFile, kManifestFile};
  for (const auto& file : files) {
    const auto kept = test::read_bytes(ours.folder / file);
    test::write_bytes(ours.folder / file, test::read_bytes(others.folder / file));
    EXPECT_NE(test::error_of([&] { ModelBundle::read(ours.folder.string()); }), "") << file;
    test::write_bytes(ours.folder / file, kept.substr(0, kept.size() / 2));
    EXPECT_NE(test::error_of([&] { ModelBundle::read(ours.folder.string()); }), "") << file;
    std::filesystem::remove(ours.folder / file);
    EXPECT_NE(test::error_of([&] { ModelBundle::read(ours.folder.string()); }), "") << file;
    test::write_bytes(ours.folder / file, kept);
  }
}

}  // namespace
}  // namespace weft::detector
