#pragma once

#include <string>
#include <vector>

#include "bovw/describe.hpp"
#include "bovw/vocabulary.hpp"
#include "detector/prior.hpp"
#include "detector/refiner.hpp"
#include "detector/window_scorer.hpp"

/// A folder of models made by one training run:
///   vocabulary-NAME.blob  visual words of each descriptor, with the settings it was made with
///   score.blob            first layer: fixed-point logistic regression and window shapes
///   refine.blob           second layer: chi-squared SVMs
///   prior.blob            image-level priors
///   manifest.json         what they were trained from and how well they did
namespace weft::detector {

inline constexpr const char* kScoreFile = "score.blob";
inline constexpr const char* kRefineFile = "refine.blob";
inline constexpr const char* kPriorFile = "prior.blob";
inline constexpr const char* kManifestFile = "manifest.json";
std::string vocabulary_file(const std::string& descriptor);  // "vocabulary-sift.blob"

struct ModelBundle {
  std::vector<bovw::Vocabulary> vocabularies;   // one a descriptor, in the order of the blocks
  std::vector<bovw::DescribeOptions> describe;  // what each was trained with
  ScoreModel score;
  RefineModel refine;
  PriorModel prior;
  std::uint64_t hash = 0;  // of all models

  /// Throws Error, naming file and reason, unless every file is there and sound, all were made with
  /// the same vocabularies, and their hashes are those of the manifest.
  static ModelBundle read(const std::string& folder);
};

}  // namespace weft::detector
