#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "slam/features.hpp"
#include "slam/vocabulary.hpp"

namespace weft::train {

struct VocabularyTraining {
  int every = 1;
  slam::FeatureOptions features;
  slam::VocabularyOptions vocabulary;

  void visit(OptionVisitor& v) {
    v.field("every", every, {1, 10000}, "", "of each folder's pictures every n-th is used");
    v.group("features", features);
    v.group("vocabulary", vocabulary);
  }
  void validate() const { validate_fields(*this, "VocabularyTraining"); }
};

/// Colour pictures below a folder in the order of their paths: the .png and .jpg files in folders
/// named rgb, images or png, where the sets of `weft synth` keep them. Throws Error when there are
/// none.
std::vector<std::string> colour_pictures(const std::string& folder);

/// Trains a vocabulary of ORB features for finding places again and writes vocabulary.blob,
/// training.yaml and manifest.json to the folder `out`. The same pictures and settings give the
/// same bytes. report(done, total) after each picture. Throws Error.
void train_vocabulary(const std::vector<std::string>& folders, const std::string& out,
                      const VocabularyTraining& training,
                      const std::function<void(int done, int total)>& report);

/// `weft train vocabulary`; exit status as run_train.
int run_train_vocabulary(int argc, char** argv);

}  // namespace weft::train
