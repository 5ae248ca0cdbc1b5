#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "bovw/histogram.hpp"
#include "detector/blocks.hpp"
#include "detector/chi2_kernel.hpp"
#include "detector/types.hpp"
#include "detector/window_scorer.hpp"

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

/// A part's SVM. A histogram is L1-normalised within each block (depth holes make the counts of two
/// descriptors differ), then
///   f(x) = sum_i coefficients[i] exp(-gamma D(x, t_i)) - rho,  D = sum (x-t)^2 / (x+t),
///   P = 1 / (1 + exp(platt_a f + platt_b)).
struct PartSvm {
  std::string part;
  std::vector<WindowShape> shapes;   // of the windows tried around a candidate
  std::vector<std::int32_t> counts;  // of the support vectors, one histogram after the other
  std::vector<double> coefficients;  // alpha_i y_i
  double gamma = 1.0;
  double rho = 0.0;
  double platt_a = -1.0;
  double platt_b = 0.0;

  int support_vectors() const { return static_cast<int>(coefficients.size()); }
};

struct RefineModel {
  std::vector<HistogramBlock> blocks;
  std::vector<PartSvm> parts;
  std::uint64_t hash = 0;  // set by read()

  int entries() const { return total_entries(blocks); }
  /// Throws Error naming `where`, the part and the rule that is broken.
  void validate(const std::string& where) const;
  static RefineModel read(const std::string& path);
  void write(const std::string& path) const;
};

/// D = sum (x-t)^2 / (x+t) of the histograms, L1-normalised block by block, of two vectors of word
/// counts; an empty block counts as zeros. Double precision, for training and tests.
double chi2_distance(const std::int32_t* a, const std::int32_t* b,
                     const std::vector<HistogramBlock>& blocks);

/// The box a window covers in the view: half a step beyond its outermost grid points.
Box window_box(const bovw::WordGrid& grid, const bovw::CellBox& window);

/// The windows tried around a candidate: every shape at every offset whose centre is a point of the
/// mask.
std::vector<bovw::CellBox> candidate_windows(const bovw::WordGrid& grid, int column, int row,
                                             const std::vector<WindowShape>& shapes,
                                             const RefinerOptions& options);

/// Jaccard index of two boxes.
double overlap(const Box& a, const Box& b);

class Refiner {
 public:
  /// Throws Error when the model is not usable.
  Refiner(RefineModel model, const RefinerOptions& options);

  /// For each candidate the best window whose centre is a point of the mask, scored by its Platt
  /// probability times the candidate's prior; candidates without such a window, or whose windows
  /// hold no words, vanish. Best first; equal scores in the order of the candidates. The same bits
  /// for any number of threads. Throws Error for grids that do not fit the model, unknown parts
  /// and candidates off the grid. threads < 1: one for each core.
  std::vector<Detection> refine(std::span<const bovw::WordGrid* const> grids,
                                std::span<const Candidate> candidates, int threads) const;

  /// Decision value f(x) of a part's SVM for a window's counts; -infinity when all are 0.
  double decide(int part, const std::vector<std::int32_t>& counts) const;

  const RefineModel& model() const { return model_; }

 private:
  struct Packed {  // as chi2_kernel.hpp wants it
    std::vector<float> shares, sums, coefficients;
    int blocks = 0;
    chi2::Model model(int words, double gamma) const;
  };
  RefineModel model_;
  std::vector<Packed> packed_;
  RefinerOptions options_;
};

}  // namespace weft::detector
