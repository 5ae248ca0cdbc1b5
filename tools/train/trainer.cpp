#include "train/trainer.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string_view>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/parallel.hpp"
#include "base/random.hpp"
#include "base/text_file.hpp"
#include "bovw/histogram.hpp"
#include "detector/model.hpp"
#include "detector/prior.hpp"
#include "evaluation/part_metrics.hpp"
#include "train/logistic.hpp"

namespace weft::train {
namespace {

namespace fs = std::filesystem;
using detector::kParts;
using nlohmann::ordered_json;

constexpr int kPartCount = static_cast<int>(kParts.size());
// Part of the names of finished steps: one more whenever a step's file or meaning changes.
constexpr int kRecipe = 2;
constexpr double kIgnoreOverlap = 0.1;  // a window that touches a polygon to ignore proves nothing

/// Items of unequal cost, one after the other as threads become free; each writes to its own place.
void for_each(int count, int threads, const std::function<void(int)>& body) {
  std::atomic<int> next{0};
  parallel_for(std::min(count, threads), threads, [&](int, int) {
    for (int i = next++; i < count; i = next++) body(i);
  });
}

/// A view with its words.
struct View {
  std::vector<bovw::WordGrid> grids;
  std::vector<const bovw::WordGrid*> pointers;
  std::vector<ViewPart> parts;
  int fold = 0;

  const bovw::WordGrid& grid() const { return grids.front(); }
  bool shows(int part) const {
    return std::any_of(parts.begin(), parts.end(),
                       [&](const ViewPart& p) { return p.part == part && !p.ignore; });
  }
  bool hides(int part) const {  // only instances to be ignored
    return !shows(part) && std::any_of(parts.begin(), parts.end(),
                                       [&](const ViewPart& p) { return p.part == part; });
  }
};

/// Whether an annotation is a positive of the part, given what kindred parts are.
bool teaches(const ViewPart& p, int part, Kindred kindred) {
  return !p.ignore && (p.part == part || (kindred == Kindred::kPositive &&
                                          are_kindred(kParts[static_cast<std::size_t>(p.part)],
                                                      kParts[static_cast<std::size_t>(part)])));
}

std::uint64_t part_seed(const TrainOptions& options, int part, int purpose) {
  Hash64 hash;
  hash.add(static_cast<std::uint64_t>(options.seed));
  hash.add(static_cast<std::uint64_t>(purpose));
  hash.add(std::string_view(kParts[static_cast<std::size_t>(part)]));
  return hash.value();
}

class Trainer {
 public:
  Trainer(const dataset::Dataset& data, std::string models, std::string work,
          const TrainOptions& options, int threads, const Report& report, const Note& note)
      : data_(data),
        models_(std::move(models)),
        work_(std::move(work)),
        options_(options),
        threads_(threads),
        report_(report),
        note_(note),
        describe_{options.describe} {
    if (!options.combined) return;
    describe_.push_back(options.describe);
    describe_.back().descriptor = options.second;
    if (options.second.kind == options.describe.descriptor.kind)
      throw Error("second.kind is describe.descriptor.kind; combine two different descriptors");
  }

  void run();

 private:
  void describe_scenes();
  void make_vocabulary(const bovw::DescribeOptions& describe);
  void make_words();
  void make_shapes();
  void train_scores();
  void find_candidates();
  void train_refinement();
  void train_priors();
  void write_models();

  bool may_be_negative(const View& view, int part, const bovw::CellBox& window,
                       Kindred kindred) const;
  std::vector<float> features(const View& view, const bovw::CellBox& window) const;
  int words_in(const View& view, const bovw::CellBox& window) const;
  Samples score_samples(int part, const detector::ScoreModel* first_model) const;
  void mine(int part, const detector::ScoreModel& model, const View& view,
            std::vector<bovw::CellBox>& hard) const;
  SvmResult refine_part(int part) const;
  ordered_json calibrate(int part, SvmResult& result) const;
  fs::path cached(const std::string& step, std::uint64_t key, const std::string& ending) const {
    return fs::path(work_) / (step + "-" + to_hex(key) + ending);
  }
  std::uint64_t scene_key(std::uint64_t data_hash, const bovw::DescribeOptions& describe) const {
    Hash64 key;
    key.add(static_cast<std::uint64_t>(kRecipe));
    key.add(data_hash);
    key.add(options_hash(describe));
    key.add(options_hash(options_.augment));
    return key.value();
  }
  /// Counts one item of a step as done.
  void step_done(const std::string& step, std::atomic<int>& done, int total) {
    const std::lock_guard lock(mutex_);
    report_(step, ++done, total);
  }

  const dataset::Dataset& data_;
  const std::string models_, work_;
  const TrainOptions& options_;
  const int threads_;
  const Report& report_;
  const Note& note_;
  std::vector<bovw::DescribeOptions> describe_;  // one a descriptor
  std::mutex mutex_;

  struct SceneFile {
    std::string name, simulation, garment;
    std::uint64_t data_hash = 0;
    int views = 0;
    int fold = 0;
  };
  fs::path scene_path(std::uint64_t data_hash, const bovw::DescribeOptions& describe) const {
    return cached("scene", scene_key(data_hash, describe), ".blob");
  }
  DescribedScene read_described(const SceneFile& file,
                                const bovw::DescribeOptions& describe) const {
    DescribedScene scene;
    const auto path = scene_path(file.data_hash, describe);
    if (!read_scene(path, scene_key(file.data_hash, describe), scene)) {
      throw Error(path.string() + " changed while training");
    }
    return scene;
  }
  std::vector<SceneFile> scenes_;
  std::uint64_t data_hash_ = 0, words_key_ = 0, score_key_ = 0;
  std::vector<bovw::Vocabulary> vocabularies_;
  std::vector<View> views_;
  std::vector<std::vector<detector::WindowShape>> score_shapes_, refine_shapes_;
  std::vector<int> trained_parts_;  // with positives in at least two folds
  detector::ScoreModel score_model_;
  detector::RefineModel refine_model_;
  detector::PriorModel prior_model_;
  std::vector<std::vector<detector::Candidate>> candidates_;  // of each view
  ordered_json parts_report_ = ordered_json::object();
};

void Trainer::run() {
  fs::create_directories(work_);
  fs::create_directories(models_);
  describe_scenes();
  for (const auto& describe : describe_) make_vocabulary(describe);
  make_words();
  make_shapes();
  train_scores();
  find_candidates();
  train_refinement();
  train_priors();
  write_models();
}

void Trainer::describe_scenes() {
  std::vector<std::string> names;
  std::vector<std::size_t> places;
  const auto all = data_.names().size();
  const auto wanted =
      options_.max_scenes > 0 ? std::min(all, static_cast<std::size_t>(options_.max_scenes)) : all;
  for (std::size_t i = 0; i < wanted; ++i) places.push_back(i * all / wanted);
  for (const auto place : places) names.push_back(data_.names()[place]);
  const int count = static_cast<int>(names.size());
  std::vector<SceneFile> found(names.size());
  std::vector<char> used(names.size(), 0), has_split(names.size(), 0), in_train(names.size(), 0);
  std::vector<std::string> problems(names.size());
  std::atomic<int> done{0};
  for_each(count, threads_, [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    try {
      const auto scene = data_.read(places[at]);
      has_split[at] = !scene.split.empty();
      in_train[at] = scene.split == "train";
      // Pictures of several garments are in neither subset of the paper (section 5.1).
      if ((scene.split.empty() || scene.split == "train") && scene.single) {
        const auto data_hash = hash_scene(scene);
        DescribedScene described;
        for (const auto& describe : describe_) {
          const auto path = scene_path(data_hash, describe).string();
          const auto key = scene_key(data_hash, describe);
          if (read_scene(path, key, described)) continue;
          described = describe_scene(scene, describe, options_.augment);
          write_scene(path, key, described);
        }
        found[at] = {described.name,
                     described.simulation,
                     described.garment,
                     described.data_hash,
                     static_cast<int>(described.views.size()),
                     0};
        used[at] = 1;
      }
    } catch (const Error& error) {
      problems[at] = error.what();
    }
    step_done("describe", done, count);
  });
  const bool splits = std::any_of(has_split.begin(), has_split.end(), [](char c) { return c; });
  Hash64 hash;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (!problems[i].empty()) note_("left out: " + problems[i]);
    if (!used[i] || (splits && !in_train[i])) continue;
    hash.add(found[i].data_hash);
    scenes_.push_back(found[i]);
  }
  if (scenes_.empty()) throw Error("no scene to train from");
  data_hash_ = hash.value();
  std::vector<std::string> simulations, garments;
  for (const auto& scene : scenes_) {
    simulations.push_back(scene.simulation);
    garments.push_back(scene.garment);
  }
  const auto folds = assign_folds(simulations, garments, options_.folds,
                                  static_cast<std::uint64_t>(options_.seed));
  for (std::size_t i = 0; i < scenes_.size(); ++i) scenes_[i].fold = folds[i];
}

void Trainer::make_vocabulary(const bovw::DescribeOptions& describe) {
  Hash64 key;
  key.add(scene_key(data_hash_, describe));
  key.add(options_hash(options_.kmeans));
  key.add(static_cast<std::uint64_t>(options_.descriptors_per_view));
  key.add(static_cast<std::uint64_t>(options_.seed));
  const auto path = cached("vocabulary", key.value(), ".blob").string();
  key.add(words_key_);
  words_key_ = key.value();
  if (!fs::exists(path)) {
    std::vector<std::uint8_t> samples;
    const auto descriptor = descriptor::make_descriptor(describe.descriptor);
    Random random(static_cast<std::uint64_t>(options_.seed));
    for (std::size_t i = 0; i < scenes_.size(); ++i) {
      const auto scene = read_described(scenes_[i], describe);
      for (const auto& view : scene.views) {
        bovw::sample_descriptors(view.described.field, options_.descriptors_per_view, random,
                                 samples);
      }
      report_("sample", static_cast<int>(i + 1), static_cast<int>(scenes_.size()));
    }
    report_("k-means", 0, 1);
    const auto result =
        bovw::train_kmeans(samples, descriptor->dimension(), options_.kmeans, threads_);
    report_("k-means", 1, 1);
    bovw::Vocabulary(descriptor->name(), descriptor->dimension(), result.centres,
                     options_hash(describe), options_to_yaml(describe))
        .write(path);
  }
  vocabularies_.push_back(bovw::Vocabulary::read(path));
}

void Trainer::make_words() {
  std::vector<std::size_t> first(scenes_.size() + 1, 0);
  for (std::size_t i = 0; i < scenes_.size(); ++i) {
    first[i + 1] = first[i] + static_cast<std::size_t>(scenes_[i].views);
  }
  views_.resize(first.back());
  std::atomic<int> done{0};
  for_each(static_cast<int>(scenes_.size()), threads_, [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    for (std::size_t d = 0; d < describe_.size(); ++d) {
      auto scene = read_described(scenes_[at], describe_[d]);
      for (std::size_t v = 0; v < scene.views.size(); ++v) {
        auto& view = views_[first[at] + v];
        view.grids.push_back(bovw::quantise(scene.views[v].described, vocabularies_[d].descriptor(),
                                            vocabularies_[d], 1));
        view.parts = std::move(scene.views[v].parts);
        for (auto& part : view.parts) {
          part.ignore = part.ignore || part.visible_share < options_.min_visible;
        }
        view.fold = scenes_[at].fold;
      }
    }
    step_done("words", done, static_cast<int>(scenes_.size()));
  });
  for (auto& view : views_) {
    for (const auto& grid : view.grids) view.pointers.push_back(&grid);
  }
  for (const auto& vocabulary : vocabularies_) {
    score_model_.blocks.push_back(
        {vocabulary.descriptor(), vocabulary.hash(), vocabulary.words(), options_.context});
  }
}

void Trainer::make_shapes() {
  score_shapes_.resize(kPartCount);
  refine_shapes_.resize(kPartCount);
  for (int part = 0; part < kPartCount; ++part) {
    std::vector<detector::Box> boxes;
    std::vector<int> folds;
    for (const auto& view : views_) {
      for (const auto& p : view.parts) {
        if (p.part != part || p.ignore) continue;
        boxes.push_back(p.box);
        folds.push_back(view.fold);
      }
    }
    std::sort(folds.begin(), folds.end());
    folds.erase(std::unique(folds.begin(), folds.end()), folds.end());
    if (folds.size() < 2) {
      note_(std::string(kParts[static_cast<std::size_t>(part)]) +
            ": not trained, its annotations are in fewer than two cross-validation folds");
      continue;
    }
    trained_parts_.push_back(part);
    const auto at = static_cast<std::size_t>(part);
    score_shapes_[at] = cluster_shapes(boxes, options_.score.shapes, part_seed(options_, part, 1));
    refine_shapes_[at] =
        cluster_shapes(boxes, options_.refine.shapes, part_seed(options_, part, 2));
    auto& report = parts_report_[kParts[at]];
    report["annotations"] = boxes.size();
  }
  if (trained_parts_.empty()) throw Error("no part has enough annotations to be trained");
}

bool Trainer::may_be_negative(const View& view, int part, const bovw::CellBox& window,
                              Kindred kindred) const {
  const auto box = detector::window_box(view.grid(), window);
  const double x = box.x + box.width / 2, y = box.y + box.height / 2;
  for (const auto& p : view.parts) {
    if (p.part != part &&
        (kindred == Kindred::kNegative || !are_kindred(kParts[static_cast<std::size_t>(p.part)],
                                                       kParts[static_cast<std::size_t>(part)])))
      continue;
    const double limit = p.ignore ? kIgnoreOverlap : options_.max_negative_overlap;
    if (detector::overlap(box, p.box) > limit) return false;
    if ((p.ignore || !options_.negatives_inside) && evaluation::inside(p.polygon, x, y)) {
      return false;
    }
  }
  return true;
}

int Trainer::words_in(const View& view, const bovw::CellBox& window) const {
  int words = 0;
  for (const auto& grid : view.grids) {
    std::vector<std::int32_t> counts(static_cast<std::size_t>(grid.vocabulary_size));
    words += bovw::count_words(grid, window, counts);
  }
  return words;
}

std::vector<float> Trainer::features(const View& view, const bovw::CellBox& window) const {
  const auto counts = detector::count_blocks(score_model_.blocks, view.pointers, window);
  std::vector<float> result;
  std::size_t begin = 0;
  for (const auto& block : score_model_.blocks) {
    const auto end = begin + static_cast<std::size_t>(block.entries());
    const int total = std::accumulate(counts.begin() + static_cast<std::ptrdiff_t>(begin),
                                      counts.begin() + static_cast<std::ptrdiff_t>(end), 0);
    for (; begin < end; ++begin) {
      result.push_back(
          total > 0 ? static_cast<float>(std::sqrt(static_cast<double>(counts[begin]) / total))
                    : 0.0f);
    }
  }
  return result;
}

/// The best scored windows of a view that may be negatives and do not overlap much.
void Trainer::mine(int part, const detector::ScoreModel& model, const View& view,
                   std::vector<bovw::CellBox>& hard) const {
  const detector::WindowScorer scorer(model, view.pointers);
  struct Scored {
    double score;
    bovw::CellBox window;
  };
  std::vector<Scored> all;
  for (const auto& shape : model.parts[0].shapes) {
    const auto scores = scorer.score(0, shape);
    for (int r = 0; r < scores.positions.rows; ++r) {
      for (int c = 0; c < scores.positions.columns; ++c) {
        const double score = scores.scores[static_cast<std::size_t>(r) *
                                               static_cast<std::size_t>(scores.positions.columns) +
                                           static_cast<std::size_t>(c)];
        if (std::isnan(score)) continue;
        const bovw::CellBox window{scores.positions.column + c, scores.positions.row + r,
                                   scores.window_columns, scores.window_rows};
        const int centre_column = window.column + window.columns / 2;
        const int centre_row = window.row + window.rows / 2;
        if (view.grid().at(centre_column, centre_row) == bovw::WordGrid::kOutsideMask) continue;
        all.push_back({score, window});
      }
    }
  }
  // A window that may not be a negative leaves room for the next one.
  const auto wanted = static_cast<std::size_t>(options_.score.hard_negatives_per_view);
  std::stable_sort(all.begin(), all.end(),
                   [](const Scored& a, const Scored& b) { return a.score > b.score; });
  std::vector<bovw::CellBox> chosen;
  for (const auto& s : all) {
    if (chosen.size() >= wanted) break;
    const auto box = detector::window_box(view.grid(), s.window);
    const bool near = std::any_of(chosen.begin(), chosen.end(), [&](const bovw::CellBox& c) {
      return detector::overlap(box, detector::window_box(view.grid(), c)) > 0.3;
    });
    if (near || !may_be_negative(view, part, s.window, options_.score.kindred)) continue;
    chosen.push_back(s.window);
  }
  hard.insert(hard.end(), chosen.begin(), chosen.end());
}

Samples Trainer::score_samples(int part, const detector::ScoreModel* first_model) const {
  const auto& shapes = score_shapes_[static_cast<std::size_t>(part)];
  Random random(part_seed(options_, part, 3));
  struct Negative {
    const View* view;
    bovw::CellBox window;
  };
  std::vector<Negative> negatives;
  Samples samples;
  samples.dimension = detector::total_entries(score_model_.blocks);
  for (const auto& view : views_) {
    const auto& grid = view.grid();
    for (const auto& p : view.parts) {
      if (!teaches(p, part, options_.score.kindred)) continue;
      const auto window = bovw::cells_in_box(grid, p.box.x, p.box.y, p.box.width, p.box.height);
      if (words_in(view, window) >= score_model_.min_words) {
        samples.add(features(view, window), true, view.fold);
      }
    }
    std::vector<int> inside;
    for (std::size_t i = 0; i < grid.cells.size(); ++i) {
      if (grid.cells[i] != bovw::WordGrid::kOutsideMask) inside.push_back(static_cast<int>(i));
    }
    if (inside.empty()) continue;
    for (int n = 0; n < options_.score.negatives_per_view; ++n) {
      const int cell = inside[random.below(inside.size())];
      const auto& shape = shapes[random.below(shapes.size())];
      const int columns = bovw::window_cells(shape.width_px, grid.step_px);
      const int rows = bovw::window_cells(shape.height_px, grid.step_px);
      const bovw::CellBox window{cell % grid.columns - columns / 2, cell / grid.columns - rows / 2,
                                 columns, rows};
      if (!may_be_negative(view, part, window, options_.score.kindred)) continue;
      if (words_in(view, window) >= score_model_.min_words) negatives.push_back({&view, window});
    }
    if (first_model == nullptr) continue;
    std::vector<bovw::CellBox> hard;
    mine(part, *first_model, view, hard);
    for (const auto& window : hard) negatives.push_back({&view, window});
  }
  random.shuffle(negatives.begin(), negatives.end());
  if (static_cast<int>(negatives.size()) > options_.score.max_samples) {
    negatives.resize(static_cast<std::size_t>(options_.score.max_samples));
  }
  for (const auto& n : negatives) samples.add(features(*n.view, n.window), false, n.view->fold);
  return samples;
}

void Trainer::train_scores() {
  Hash64 key;
  key.add(words_key_);
  TrainOptions relevant = options_;  // what this step depends on
  relevant.refine = {};
  relevant.prior = {};
  relevant.search = {};
  relevant.windows = {};
  key.add(options_hash(relevant));
  score_key_ = key.value();
  const auto path = cached("score", score_key_, ".blob"),
             report_path = cached("score", score_key_, ".json");
  if (!fs::exists(path) || !fs::exists(report_path)) {
    std::vector<detector::PartClassifier> classifiers(trained_parts_.size());
    std::vector<ordered_json> reports(trained_parts_.size());
    std::atomic<int> done{0};
    for_each(static_cast<int>(trained_parts_.size()), threads_, [&](int i) {
      const auto at = static_cast<std::size_t>(i);
      const int part = trained_parts_[at];
      const auto classifier_of = [&](const Logistic& logistic) {
        detector::PartClassifier classifier;
        classifier.part = kParts[static_cast<std::size_t>(part)];
        std::size_t begin = 0;
        for (const auto& block : score_model_.blocks) {
          classifier.weights.push_back(detector::quantise_weights(
              std::span(logistic.weights)
                  .subspan(begin, static_cast<std::size_t>(block.entries()))));
          begin += static_cast<std::size_t>(block.entries());
        }
        classifier.bias = logistic.bias;
        classifier.shapes = score_shapes_[static_cast<std::size_t>(part)];
        return classifier;
      };
      auto samples = score_samples(part, nullptr);
      if (options_.score.hard_negatives_per_view > 0) {
        detector::ScoreModel first = score_model_;
        first.parts = {classifier_of(train_logistic(samples, 1.0, options_.score.positive_weight))};
        samples = score_samples(part, &first);
      }
      double best_ap = -1.0, best_c = 0.0;
      auto& report = reports[at];
      for (const double c : options_.score.c) {
        const auto values =
            cross_validate_logistic(samples, c, options_.score.positive_weight, options_.folds);
        const double ap = ranking_ap(values, samples.positive);
        report["tried"].push_back({{"c", c}, {"ap", ap}});
        if (ap > best_ap) {
          best_ap = ap;
          best_c = c;
        }
      }
      report["positives"] = samples.positives();
      report["negatives"] = samples.rows() - samples.positives();
      report["c"] = best_c;
      report["cross_validated_window_ap"] = best_ap;
      classifiers[at] =
          classifier_of(train_logistic(samples, best_c, options_.score.positive_weight));
      step_done("score", done, static_cast<int>(trained_parts_.size()));
    });
    auto model = score_model_;
    model.parts = std::move(classifiers);
    ordered_json all;
    for (std::size_t i = 0; i < reports.size(); ++i) all[model.parts[i].part] = reports[i];
    model.write(path.string());
    write_text_file(report_path, all.dump(1) + "\n");
  }
  score_model_ = detector::ScoreModel::read(path.string());
  const auto reports = ordered_json::parse(std::ifstream(report_path));
  for (const auto& part : score_model_.parts)
    parts_report_[part.part]["score"] = reports[part.part];
}

void Trainer::find_candidates() {
  candidates_.resize(views_.size());
  std::atomic<int> done{0};
  for_each(static_cast<int>(views_.size()), threads_, [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    candidates_[at] = detector::score_parts(score_model_, views_[at].pointers, {},
                                            detector::PriorMode::kOff, options_.search, 1)
                          .candidates;
    step_done("candidates", done, static_cast<int>(views_.size()));
  });
}

SvmResult Trainer::refine_part(int part) const {
  const auto& shapes = refine_shapes_[static_cast<std::size_t>(part)];
  const std::string name = kParts[static_cast<std::size_t>(part)];
  const auto& o = options_.refine;
  Random random(part_seed(options_, part, 4));
  struct Item {
    const View* view;
    bovw::CellBox window;
    double decision = 0.0;
  };
  std::vector<Item> exact, shifted, easy, hard;
  for (std::size_t v = 0; v < views_.size(); ++v) {
    const auto& view = views_[v];
    for (const auto& p : view.parts) {
      if (!teaches(p, part, o.kindred)) continue;
      const auto window =
          bovw::cells_in_box(view.grid(), p.box.x, p.box.y, p.box.width, p.box.height);
      if (words_in(view, window) >= score_model_.min_words) exact.push_back({&view, window});
    }
    for (const auto& candidate : candidates_[v]) {
      if (candidate.part != name) continue;
      const auto windows = detector::candidate_windows(view.grid(), candidate.column, candidate.row,
                                                       shapes, options_.windows);
      if (windows.empty()) continue;
      double best = 0.6;
      const bovw::CellBox* best_window = nullptr;
      for (const auto& window : windows) {
        const auto box = detector::window_box(view.grid(), window);
        for (const auto& p : view.parts) {
          if (!teaches(p, part, o.kindred)) continue;
          const double overlap = detector::overlap(box, p.box);
          if (overlap <= best) continue;
          best = overlap;
          best_window = &window;
        }
      }
      if (best_window != nullptr && words_in(view, *best_window) >= score_model_.min_words) {
        shifted.push_back({&view, *best_window});
      }
      for (int n = 0; n < 2; ++n) {
        const auto& window = windows[random.below(windows.size())];
        if (may_be_negative(view, part, window, o.kindred) &&
            words_in(view, window) >= score_model_.min_words) {
          easy.push_back({&view, window});
        }
      }
    }
  }
  const auto keep = [&](std::vector<Item>& items, int count) {
    random.shuffle(items.begin(), items.end());
    if (static_cast<int>(items.size()) > count)
      items.resize(static_cast<std::size_t>(std::max(0, count)));
  };
  keep(exact, o.positives * 2 / 3);
  keep(shifted, o.positives - static_cast<int>(exact.size()));
  random.shuffle(easy.begin(), easy.end());

  SvmResult result;
  for (int round = 0; round < o.rounds; ++round) {
    Windows windows;
    windows.blocks = score_model_.blocks;
    const auto add = [&](const Item& item, bool positive) {
      const auto counts =
          detector::count_blocks(score_model_.blocks, item.view->pointers, item.window);
      windows.counts.insert(windows.counts.end(), counts.begin(), counts.end());
      windows.positive.push_back(positive);
      windows.fold.push_back(item.view->fold);
    };
    // Alternating classes, so that thinning keeps their shares.
    std::vector<std::pair<const Item*, bool>> chosen;
    for (const auto& item : exact) chosen.push_back({&item, true});
    for (const auto& item : shifted) chosen.push_back({&item, true});
    for (const auto& item : hard) chosen.push_back({&item, false});
    const auto room = std::max(0, o.negatives - static_cast<int>(hard.size()));
    for (std::size_t i = 0; i < easy.size() && static_cast<int>(i) < room; ++i) {
      chosen.push_back({&easy[i], false});
    }
    random.shuffle(chosen.begin(), chosen.end());
    for (const auto& [item, positive] : chosen) add(*item, positive);
    auto svm_options = o.svm;
    if (round + 1 < o.rounds) {  // good enough to find what it gets wrong
      svm_options.c = {o.svm.c[o.svm.c.size() / 2]};
      svm_options.gamma_factors = {o.svm.gamma_factors[o.svm.gamma_factors.size() / 2]};
      svm_options.max_support_vectors = 100000;
    }
    result = train_chi2_svm(windows, options_.folds, svm_options);
    result.svm.part = name;
    result.svm.shapes = shapes;
    if (round + 1 == o.rounds) break;

    detector::RefineModel model;
    model.blocks = score_model_.blocks;
    model.parts = {result.svm};
    const detector::Refiner refiner(model, options_.windows);
    hard.clear();
    for (std::size_t v = 0; v < views_.size(); ++v) {
      const auto& view = views_[v];
      for (const auto& candidate : candidates_[v]) {
        if (candidate.part != name) continue;
        Item worst{&view, {}, -1e300};
        for (const auto& window : detector::candidate_windows(
                 view.grid(), candidate.column, candidate.row, shapes, options_.windows)) {
          if (!may_be_negative(view, part, window, o.kindred)) continue;
          if (words_in(view, window) < score_model_.min_words) continue;
          const auto counts = detector::count_blocks(score_model_.blocks, view.pointers, window);
          const double decision = refiner.decide(0, counts);
          if (decision > worst.decision) worst = {&view, window, decision};
        }
        if (worst.window.columns > 0) hard.push_back(worst);
      }
    }
    std::stable_sort(hard.begin(), hard.end(),
                     [](const Item& a, const Item& b) { return a.decision > b.decision; });
    if (static_cast<int>(hard.size()) > o.negatives / 2) {
      hard.resize(static_cast<std::size_t>(o.negatives / 2));
    }
  }
  return result;
}

/// Platt's sigmoid anew, on what the layer reports: the best of some hundred windows around a peak
/// scores higher than a window drawn at random, and right ones are rarer than among the training
/// windows. Held-out views are scored without their fold; the probability is then that of the
/// detection's centre lying on the part, comparable between parts.
ordered_json Trainer::calibrate(int part, SvmResult& result) const {
  const std::string name = kParts[static_cast<std::size_t>(part)];
  std::vector<double> decisions;
  std::vector<char> hits;
  for (int fold = 0; fold < options_.folds; ++fold) {
    auto svm = result.without_fold.at(static_cast<std::size_t>(fold));
    svm.part = name;
    svm.shapes = refine_shapes_[static_cast<std::size_t>(part)];
    svm.platt_a = -1.0;
    svm.platt_b = 0.0;
    detector::RefineModel model;
    model.blocks = score_model_.blocks;
    model.parts = {std::move(svm)};
    const detector::Refiner refiner(std::move(model), options_.windows);
    for (std::size_t v = 0; v < views_.size(); ++v) {
      const auto& view = views_[v];
      if (view.fold != fold) continue;
      std::vector<detector::Candidate> candidates;
      for (const auto& candidate : candidates_[v]) {
        if (candidate.part == name) candidates.push_back(candidate);
      }
      for (const auto& detection : refiner.refine(view.pointers, candidates, 1)) {
        const auto& box = detection.box_view;
        bool hit = false, ignored = false;
        for (const auto& p : view.parts) {
          if (p.part != part ||
              !evaluation::inside(p.polygon, box.x + box.width / 2, box.y + box.height / 2)) {
            continue;
          }
          (p.ignore ? ignored : hit) = true;
        }
        if (ignored && !hit) continue;
        decisions.push_back(std::log(detection.probability / (1.0 - detection.probability)));
        hits.push_back(hit);
      }
    }
  }
  const auto right = std::count(hits.begin(), hits.end(), true);
  auto sigmoid = fit_sigmoid(decisions, hits);
  if (sigmoid.a >= 0.0) {
    // Scores that tell nothing: the share of right ones for all, ranked as the SVM does.
    const auto wrong = static_cast<double>(hits.size()) - static_cast<double>(right);
    sigmoid = {-1e-6, std::log((wrong + 1.0) / (static_cast<double>(right) + 1.0))};
    note_(name + ": held-out detections score no higher when they are right (" +
          std::to_string(right) + " of " + std::to_string(hits.size()) +
          " are): all get that share as probability; use more scenes");
  }
  result.svm.platt_a = sigmoid.a;
  result.svm.platt_b = sigmoid.b;
  ordered_json report;
  report["detections"] = hits.size();
  report["right"] = right;
  report["cross_validated_ap"] = ranking_ap(decisions, hits);
  return report;
}

void Trainer::train_refinement() {
  Hash64 key;
  key.add(score_key_);
  TrainOptions relevant = options_;
  relevant.prior = {};
  key.add(options_hash(relevant));
  refine_model_.blocks = score_model_.blocks;
  std::vector<detector::PartSvm> svms(trained_parts_.size());
  std::vector<ordered_json> reports(trained_parts_.size());
  std::atomic<int> done{0};
  for_each(static_cast<int>(trained_parts_.size()), threads_, [&](int i) {
    const auto at = static_cast<std::size_t>(i);
    const int part = trained_parts_[at];
    const auto name = "refine-" + std::to_string(part);
    const auto path = cached(name, key.value(), ".blob"),
               report_path = cached(name, key.value(), ".json");
    if (!fs::exists(path) || !fs::exists(report_path)) {
      auto result = refine_part(part);
      ordered_json report;
      report["calibration"] = calibrate(part, result);
      report["samples"] = result.samples;
      report["support_vectors"] = result.svm.support_vectors();
      report["support_vectors_before_reduction"] = result.full_support_vectors;
      report["c"] = result.c;
      report["gamma_factor"] = result.gamma_factor;
      report["cross_validated_window_ap"] = result.cross_validated_ap;
      report["cross_validated_log_loss"] = result.cross_validated_log_loss;
      for (const auto& t : result.tried) {
        report["tried"].push_back({{"c", t.c},
                                   {"gamma_factor", t.gamma_factor},
                                   {"ap", t.ap},
                                   {"support_vectors", t.support_vectors}});
      }
      auto model = refine_model_;
      model.parts = {result.svm};
      model.write(path.string());
      write_text_file(report_path, report.dump(1) + "\n");
    }
    svms[at] = detector::RefineModel::read(path.string()).parts.at(0);
    reports[at] = ordered_json::parse(std::ifstream(report_path));
    step_done("refine", done, static_cast<int>(trained_parts_.size()));
  });
  refine_model_.parts = std::move(svms);
  for (std::size_t i = 0; i < reports.size(); ++i) {
    parts_report_[refine_model_.parts[i].part]["refine"] = reports[i];
  }
}

void Trainer::train_priors() {
  prior_model_.blocks = score_model_.blocks;
  for (auto& block : prior_model_.blocks)
    block.context = false;  // the whole image has no surroundings
  int done = 0;
  for (const int part : trained_parts_) {
    Samples samples;
    samples.dimension = detector::total_entries(prior_model_.blocks);
    for (const auto& view : views_) {
      if (view.hides(part)) continue;
      const auto histogram = detector::image_histogram(view.pointers);
      samples.add({histogram.begin(), histogram.end()}, view.shows(part), view.fold);
    }
    detector::PartPriorModel model;
    model.part = kParts[static_cast<std::size_t>(part)];
    auto& report = parts_report_[model.part]["prior"];
    double best_loss = 1e300, best_c = 0.0;
    std::vector<double> held_out;
    for (const double c : options_.prior.c) {
      const auto values = cross_validate_logistic(samples, c, 1.0, options_.folds);
      const double loss = log_loss(values, samples.positive);
      if (loss >= best_loss) continue;
      best_loss = loss;
      best_c = c;
      held_out = values;
    }
    const auto logistic = train_logistic(samples, best_c, 1.0);
    model.weights = logistic.weights;
    model.bias = logistic.bias;
    std::vector<double> shown;  // probabilities of views that show the part, ascending
    for (std::size_t i = 0; i < held_out.size(); ++i) {
      if (samples.positive[i]) shown.push_back(1.0 / (1.0 + std::exp(-held_out[i])));
    }
    std::sort(shown.begin(), shown.end());
    const auto threshold_for = [&](double recall) {
      const auto lost = static_cast<std::size_t>(
          std::floor((1.0 - recall) * static_cast<double>(shown.size()) + 1e-9));
      return shown[std::min(lost, shown.size() - 1)];
    };
    model.threshold = threshold_for(options_.prior.recall);
    report["c"] = best_c;
    report["cross_validated_log_loss"] = best_loss;
    report["cross_validated_ap"] = ranking_ap(held_out, samples.positive);
    report["threshold"] = model.threshold;
    for (const double recall : {0.8, 0.9, 0.95, 0.98, 0.99, 1.0}) {
      const double threshold = threshold_for(recall);
      int searched = 0, absent = 0;
      for (std::size_t i = 0; i < held_out.size(); ++i) {
        if (samples.positive[i]) continue;
        ++absent;
        searched += 1.0 / (1.0 + std::exp(-held_out[i])) >= threshold;
      }
      report["curve"].push_back(
          {{"recall", recall},
           {"threshold", threshold},
           {"searched_without_part", absent > 0 ? static_cast<double>(searched) / absent : 0.0}});
    }
    prior_model_.parts.push_back(std::move(model));
    report_("prior", ++done, static_cast<int>(trained_parts_.size()));
  }
}

void Trainer::write_models() {
  Hash64 hash;
  const auto path = [&](const std::string& file) { return models_ + "/" + file; };
  ordered_json files;
  const auto note_file = [&](const std::string& file) { files[file] = fs::file_size(path(file)); };
  for (const auto& vocabulary : vocabularies_) {
    const auto file = detector::vocabulary_file(vocabulary.descriptor());
    vocabulary.write(path(file));
    note_file(file);
    hash.add(vocabulary.hash());
  }
  score_model_.write(path(detector::kScoreFile));
  refine_model_.write(path(detector::kRefineFile));
  prior_model_.write(path(detector::kPriorFile));
  hash.add(detector::ScoreModel::read(path(detector::kScoreFile)).hash);
  hash.add(detector::RefineModel::read(path(detector::kRefineFile)).hash);
  hash.add(detector::PriorModel::read(path(detector::kPriorFile)).hash);
  for (const char* file : {detector::kScoreFile, detector::kRefineFile, detector::kPriorFile}) {
    note_file(file);
  }

  std::map<std::string, int> garments;
  std::map<std::string, int> simulations;
  for (const auto& scene : scenes_) {
    ++garments[scene.garment.empty() ? "unknown" : scene.garment];
    ++simulations[scene.simulation];
  }
  int support_vectors = 0;
  for (const auto& svm : refine_model_.parts) support_vectors += svm.support_vectors();
  ordered_json manifest;
  manifest["format"] = "weft-models";
  manifest["version"] = 1;
  manifest["hash"] = to_hex(hash.value());
  manifest["files"] = files;
  manifest["data"] = {{"hash", to_hex(data_hash_)},
                      {"scenes", scenes_.size()},
                      {"simulations", simulations.size()},
                      {"scenes_by_garment", garments},
                      {"views", views_.size()}};
  manifest["seeds"] = {{"training", options_.seed}, {"kmeans", options_.kmeans.seed}};
  manifest["settings_hash"] = to_hex(options_hash(options_));
  manifest["settings"] = "training.yaml";
  manifest["cross_validation"] = {{"folds", options_.folds}, {"grouped_by", "simulation"}};
  manifest["support_vectors"] = support_vectors;
  manifest["parts"] = parts_report_;
  write_text_file(path(detector::kManifestFile), manifest.dump(1) + "\n");
  write_text_file(path("training.yaml"), options_to_yaml(options_));
  detector::ModelBundle::read(models_);  // what was written can be used
}

}  // namespace

void train_models(const dataset::Dataset& data, const std::string& models, const std::string& work,
                  const TrainOptions& options, int threads, const Report& report,
                  const Note& note) {
  options.validate();
  Trainer(data, models, work, options, std::max(1, threads), report, note).run();
}

bool are_kindred(std::string_view a, std::string_view b) {
  static constexpr std::array<std::array<std::string_view, 2>, 4> kPairs = {
      {{"shirt collar", "polo collar"},
       {"t-shirt collar", "dress collar"},
       {"t-shirt sleeves", "polo sleeves"},
       {"shirt sleeves", "sweater sleeves"}}};
  return std::any_of(kPairs.begin(), kPairs.end(), [&](const auto& pair) {
    return (pair[0] == a && pair[1] == b) || (pair[0] == b && pair[1] == a);
  });
}

std::vector<detector::WindowShape> cluster_shapes(const std::vector<detector::Box>& boxes,
                                                  int count, std::uint64_t seed) {
  struct Point {
    double w, h;
  };
  std::vector<Point> points;
  for (const auto& box : boxes) {
    points.push_back({std::log(std::max(1.0, box.width)), std::log(std::max(1.0, box.height))});
  }
  if (points.empty()) throw Error("no boxes to take window shapes from");
  const auto distance = [](const Point& a, const Point& b) {
    return (a.w - b.w) * (a.w - b.w) + (a.h - b.h) * (a.h - b.h);
  };
  Random random(seed);
  std::vector<Point> centres = {points[random.below(points.size())]};
  while (static_cast<int>(centres.size()) < count) {
    std::vector<double> nearest;
    for (const auto& p : points) {
      double d = 1e300;
      for (const auto& c : centres) d = std::min(d, distance(p, c));
      nearest.push_back(d);
    }
    const double total = std::accumulate(nearest.begin(), nearest.end(), 0.0);
    if (total < 1e-9) break;  // fewer distinct sizes than shapes
    double at = random.uniform() * total;
    std::size_t pick = 0;
    while (pick + 1 < points.size() && at >= nearest[pick]) at -= nearest[pick++];
    centres.push_back(points[pick]);
  }
  for (int iteration = 0; iteration < 100; ++iteration) {
    std::vector<Point> sums(centres.size(), {0.0, 0.0});
    std::vector<int> members(centres.size(), 0);
    for (const auto& p : points) {
      std::size_t best = 0;
      for (std::size_t c = 1; c < centres.size(); ++c) {
        if (distance(p, centres[c]) < distance(p, centres[best])) best = c;
      }
      sums[best].w += p.w;
      sums[best].h += p.h;
      ++members[best];
    }
    double moved = 0.0;
    for (std::size_t c = 0; c < centres.size(); ++c) {
      if (members[c] == 0) continue;
      const Point next{sums[c].w / members[c], sums[c].h / members[c]};
      moved += distance(next, centres[c]);
      centres[c] = next;
    }
    if (moved < 1e-12) break;
  }
  std::vector<detector::WindowShape> shapes;
  for (const auto& c : centres) {
    shapes.push_back({std::round(std::exp(c.w)), std::round(std::exp(c.h))});
  }
  std::stable_sort(shapes.begin(), shapes.end(), [](const auto& a, const auto& b) {
    return a.width_px * a.height_px > b.width_px * b.height_px;
  });
  return shapes;
}

std::vector<int> assign_folds(const std::vector<std::string>& simulations,
                              const std::vector<std::string>& garments, int folds,
                              std::uint64_t seed) {
  std::map<std::string, std::map<std::string, int>> by_garment;  // garment -> simulation -> fold
  for (std::size_t i = 0; i < simulations.size(); ++i) by_garment[garments[i]][simulations[i]] = 0;
  std::map<std::string, int> fold_of;
  Random random(seed);
  int next = 0;
  for (auto& [garment, members] : by_garment) {
    std::vector<std::string> names;
    for (const auto& member : members) names.push_back(member.first);
    random.shuffle(names.begin(), names.end());
    for (const auto& name : names) {
      if (!fold_of.contains(name)) fold_of[name] = next++ % folds;
    }
  }
  std::vector<int> result;
  for (const auto& simulation : simulations) result.push_back(fold_of[simulation]);
  return result;
}

}  // namespace weft::train
