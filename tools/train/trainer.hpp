#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "base/options.hpp"
#include "bovw/describe.hpp"
#include "bovw/vocabulary.hpp"
#include "dataset/scene.hpp"
#include "detector/part_scorer.hpp"
#include "detector/refiner.hpp"
#include "train/chi2_svm.hpp"
#include "train/samples.hpp"

/// From a dataset to a folder of models (detector/model.hpp).
namespace weft::train {

/// What the same part of a kindred garment is when a layer learns a part: a shirt's collar for the
/// collar of a polo, a T-shirt's sleeve for a polo's. Few garments of a type teach more together.
enum class Kindred { kNegative, kIgnore, kPositive };

inline void visit_kindred(OptionVisitor& v, Kindred& kindred) {
  v.choice("kindred", kindred,
           {{"negative", Kindred::kNegative},
            {"ignore", Kindred::kIgnore},
            {"positive", Kindred::kPositive}},
           "what the same part of a kindred garment teaches (collar: shirt, polo; T-shirt, dress; "
           "sleeves: T-shirt, polo; shirt, sweater): negative as in the paper, ignore: neither, "
           "positive: the same as the part itself");
}

struct ScoreTraining {
  int shapes = 5;
  int negatives_per_view = 4;
  int hard_negatives_per_view = 2;
  std::vector<double> c = {0.1, 1.0, 10.0, 100.0};
  double positive_weight = 1.0;
  Kindred kindred = Kindred::kNegative;
  int max_samples = 12000;

  void visit(OptionVisitor& v) {
    v.field("shapes", shapes, {1, 32}, "", "window shapes of each part, clusters of its boxes");
    v.field("negatives_per_view", negatives_per_view, {1, 1000}, "",
            "random windows of each view and part");
    v.field("hard_negatives_per_view", hard_negatives_per_view, {0, 1000}, "",
            "best scored false windows of each view and part, mined once with a first model");
    v.field("c", c, {1, 20}, "", "values of C tried");
    v.field("positive_weight", positive_weight, {0.01, 1000.0}, "",
            "C of positives over C of negatives");
    visit_kindred(v, kindred);
    v.field("max_samples", max_samples, {100, 1000000}, "",
            "negatives of a part at most; memory is 2 KB each");
  }
};

struct RefineTraining {
  int shapes = 7;
  Kindred kindred = Kindred::kNegative;
  int positives = 350;
  int negatives = 850;
  int rounds = 2;
  SvmOptions svm;

  void visit(OptionVisitor& v) {
    v.field("shapes", shapes, {1, 32}, "", "window shapes tried around each peak");
    v.field("positives", positives, {2, 100000}, "", "windows of a part at most");
    v.field("negatives", negatives, {2, 100000}, "", "false windows at most");
    v.field("rounds", rounds, {1, 5}, "",
            "1: false windows drawn at random around the peaks; each further round adds those the "
            "SVM of the round before ranks first");
    visit_kindred(v, kindred);
    v.group("svm", svm);
  }
};

struct PriorTraining {
  std::vector<double> c = {0.1, 1.0, 10.0, 100.0, 1000.0};
  double recall = 0.95;

  void visit(OptionVisitor& v) {
    v.field("c", c, {1, 20}, "", "values of C tried");
    v.field("recall", recall, {0.0, 1.0}, "",
            "share of the views that show a part which its threshold must keep");
  }
};

struct TrainOptions {
  bovw::DescribeOptions describe;
  bool combined = false;
  descriptor::DescriptorOptions second;
  AugmentOptions augment;
  bovw::KMeansOptions kmeans;
  int descriptors_per_view = 200;
  int folds = 5;
  int seed = 1;
  int max_scenes = 0;
  double max_negative_overlap = 0.5;
  bool negatives_inside = false;
  bool context = true;
  double min_visible = 0.0;
  ScoreTraining score;
  RefineTraining refine;
  PriorTraining prior;
  detector::ScoreOptions search;
  detector::RefinerOptions windows;

  void visit(OptionVisitor& v) {
    v.group("describe", describe);
    v.field("combined", combined,
            "with the words of a second descriptor, given like describe.descriptor in a group "
            "`second`: two histograms side by side, as in section 5.1");
    if (combined) v.group("second", second);
    v.group("augment", augment);
    v.group("kmeans", kmeans);
    v.field("descriptors_per_view", descriptors_per_view, {1, 100000}, "",
            "drawn for the vocabulary");
    v.field("folds", folds, {2, 20}, "", "of cross-validation, by simulation");
    v.field("seed", seed, {0, 1 << 30}, "", "of all random draws but k-means'");
    v.field("max_scenes", max_scenes, {0, 1000000}, "",
            "trained from, evenly spread over the dataset's; 0: all. For slow descriptors");
    v.field("max_negative_overlap", max_negative_overlap, {0.0, 1.0}, "",
            "Jaccard index of a negative window with the part's boxes at most; section 3.2: 0.5");
    v.field("negatives_inside", negatives_inside,
            "whether a window whose centre lies in the part's polygon, a hit by the paper's "
            "measure, can be a negative for its size");
    v.field("context", context,
            "windows also count their points of plain cloth and of table, like two more words: "
            "collars, cuffs and hems lie where the garment ends");
    v.field("min_visible", min_visible, {0.0, 1.0}, "",
            "parts of which less is seen are not trained from, as if marked to be ignored");
    v.group("score", score);
    v.group("refine", refine);
    v.group("prior", prior);
    v.group("search", search);
    v.group("windows", windows);
  }
  void validate() const {
    validate_fields(*this, "TrainOptions");
    describe.validate();
    if (combined) second.validate();
    augment.validate();
    search.validate();
    windows.validate();
    refine.svm.validate();
  }
};

/// Says how far a step is: name of the step, done, total.
using Report = std::function<void(const std::string& step, int done, int total)>;
/// Says something once.
using Note = std::function<void(const std::string& text)>;

/// Trains on all scenes of split "train" (all scenes, when the dataset has no splits) and writes
/// the models to `models`. `work` keeps finished steps, so that a killed run goes on where it was.
/// Same scenes, options and seed: same bytes on the same machine. Scenes that cannot be read are
/// noted and left out. Throws Error when nothing can be trained.
void train_models(const dataset::Dataset& data, const std::string& models, const std::string& work,
                  const TrainOptions& options, int threads, const Report& report, const Note& note);

/// Whether two different parts look alike: collars or sleeves of garments of similar make.
bool are_kindred(std::string_view a, std::string_view b);

/// k-means of log sizes, k-means++ start; at most `count` shapes, largest area first.
std::vector<detector::WindowShape> cluster_shapes(const std::vector<detector::Box>& boxes,
                                                  int count, std::uint64_t seed);

/// Fold of each simulation: shuffled within each garment, then dealt out, so that every fold has
/// its share of each garment.
std::vector<int> assign_folds(const std::vector<std::string>& simulations,
                              const std::vector<std::string>& garments, int folds,
                              std::uint64_t seed);

}  // namespace weft::train
