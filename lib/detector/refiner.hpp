#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "bovw/word_grid.hpp"
#include "detector/types.hpp"

/// The detector's second layer (papers/garment-parts.txt section 3.3): a chi-squared SVM on windows
/// of several shapes and offsets around each peak of the probability map.
namespace weft::detector {

struct RefinerOptions {
  int offset_steps = 2;
  int offset_stride = 2;
  double max_overlap = 0.5;
  int max_candidates = 64;

  void visit(OptionVisitor& v) {
    v.field("offset_steps", offset_steps, {0, 8}, "",
            "windows are shifted by -n .. n strides in x and in y; 2 makes 25 offsets");
    v.field("offset_stride", offset_stride, {1, 16}, "grid points",
            "length of one stride; 2 and two steps reach 24 px at grid step 6");
    v.field("max_overlap", max_overlap, {0.0, 1.0}, "",
            "of two detections of a part that overlap more (Jaccard index) the better one stays");
    v.field("max_candidates", max_candidates, {1, 4096}, "",
            "peaks refined in one frame; more are refused as impossible input");
  }
  void validate() const { validate_fields(*this, "RefinerOptions"); }
};

/// Size of a window in grid points.
struct GridShape {
  int columns = 0;
  int rows = 0;
  bool operator==(const GridShape&) const = default;
};

/// A part's SVM. A histogram is L1-normalised within each descriptor (per block: depth holes make
/// the counts of two descriptors differ), then
///   f(x) = sum_i coefficients[i] exp(-gamma D(x, t_i)) - rho,  D = sum (x-t)^2 / (x+t),
///   P = 1 / (1 + exp(platt_a f + platt_b)).
struct RefineModel {
  std::string part;
  std::vector<GridShape> shapes;
  std::vector<int> block_words;       // vocabulary size of each descriptor
  std::vector<std::uint16_t> counts;  // word counts of the support vectors, one after the other
  std::vector<double> coefficients;   // alpha_i y_i
  double gamma = 1.0;
  double rho = 0.0;
  double platt_a = -1.0;
  double platt_b = 0.0;

  int words() const;
  int support_vectors() const { return static_cast<int>(coefficients.size()); }
  /// Throws Error naming the part and the rule that is broken.
  void validate() const;
};

/// A window on the grid: points column .. column + shape.columns - 1, likewise rows.
struct GridWindow {
  int column = 0;
  int row = 0;
  GridShape shape;
};

/// Word counts in the part of a window that lies on the grids, descriptor after descriptor.
std::vector<int> count_words(const std::vector<const bovw::WordGrid*>& grids,
                             const GridWindow& window);

/// D = sum (x-t)^2 / (x+t) of the L1-normalised (per block) histograms of two count vectors;
/// an empty block counts as zeros. Double precision, for training and tests.
double chi2_distance(const std::uint16_t* a, const std::uint16_t* b,
                     const std::vector<int>& block_words);

/// The box a window covers in the view: half a step beyond its outermost grid points.
Box window_box(const bovw::WordGrid& grid, const GridWindow& window);

/// Jaccard index of two boxes.
double overlap(const Box& a, const Box& b);

/// Throws Error unless the grids (one a descriptor) cover the same points of the same view.
void check_same_grid(const std::vector<const bovw::WordGrid*>& grids);

class Refiner {
 public:
  /// Throws Error when a model is not usable.
  Refiner(std::vector<RefineModel> models, RefinerOptions options);

  /// For each candidate the best window whose centre is a point of the mask, scored by its Platt
  /// probability times the candidate's prior; candidates without such a window, or whose windows
  /// hold no words, vanish. Best first; equal scores in the order of the candidates. The same bits
  /// for any number of threads. Throws Error for grids that do not fit the models, unknown parts
  /// and candidates off the grid.
  std::vector<Detection> refine(const std::vector<const bovw::WordGrid*>& grids,
                                const std::vector<Candidate>& candidates, int threads = 1) const;

  /// Decision value f(x) of a part's SVM for word counts; -infinity for no words at all.
  double decide(int model, const std::vector<int>& counts) const;
  double probability(int model, double decision) const;

  const std::vector<RefineModel>& models() const { return models_; }

 private:
  struct Packed {  // as chi2_kernel.hpp wants it
    std::vector<float> shares, sums, coefficients;
    int blocks = 0;
  };
  std::vector<RefineModel> models_;
  std::vector<Packed> packed_;
  RefinerOptions options_;
};

}  // namespace weft::detector
