#include "bovw/vocabulary.hpp"
#include "detector/prior.hpp"
#include "detector/refiner.hpp"
#include "detector/window_scorer.hpp"
#include "fuzz/blob.hpp"
#include "fuzz/fuzz.hpp"
#include "slam/vocabulary.hpp"
#include "support/files.hpp"

/// Trained models.
namespace weft::fuzz {
namespace {

/// Model: has read() and write() of a path.
template <class Model>
Target target(const std::vector<Model>& models) {
  const test::TemporaryFolder folder;
  Target target{{}, through_file([](const std::string& path) { Model::read(path); }), repair_blob};
  for (const Model& model : models) {
    model.write(folder / "model");
    target.inputs.push_back(bytes_of(test::read_bytes(folder / "model")));
  }
  return target;
}

std::vector<detector::HistogramBlock> blocks() {
  return {{"sift", 7, 4, true}, {"finddd", 8, 3, false}};
}

WEFT_FUZZ_TARGET(ScoreModel) {
  detector::ScoreModel model;
  model.blocks = blocks();
  model.parts = {{"polo collar", {{1, -2, 3, 4, 5, 6}, {7, 8, 9}}, 0.5, {{60, 48}, {90, 40.5}}},
                 {"jeans hips", {{1, -2, 3, 4, 5, 6}, {7, 8, 9}}, -0.5, {{120, 48}}}};
  return target<detector::ScoreModel>({model});
}

WEFT_FUZZ_TARGET(RefineModel) {
  detector::RefineModel model;
  model.blocks = blocks();
  detector::PartSvm svm;
  svm.part = "polo collar";
  svm.shapes = {{60, 48}};
  svm.counts = {1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 8, 7, 6, 5, 4, 3, 2, 1};
  svm.coefficients = {0.5, -0.5};
  model.parts = {svm};
  return target<detector::RefineModel>({model});
}

WEFT_FUZZ_TARGET(PriorModel) {
  detector::PriorModel model;
  model.blocks = {{"sift", 7, 4, false}};
  model.parts = {{"polo collar", {0.5, -1, 2, 3}, 0.25, 0.1}};
  return target<detector::PriorModel>({model});
}

WEFT_FUZZ_TARGET(Vocabulary) {
  return target<bovw::Vocabulary>(
      {bovw::Vocabulary("sift", 4, {1, 2, 3, 4, 50, 60, 70, 80}, 9, "step_px: 6\n")});
}

WEFT_FUZZ_TARGET(BinaryVocabulary) {
  std::vector<std::vector<slam::Descriptor>> pictures(3);
  for (std::uint64_t i = 0; i < 30; ++i)
    pictures[i % 3].push_back({i * 0x9e3779b97f4a7c15u, ~i, i << 40, i});
  return target<slam::BinaryVocabulary>(
      {slam::BinaryVocabulary::train(pictures, {.branching = 3, .levels = 2})});
}

}  // namespace
}  // namespace weft::fuzz
