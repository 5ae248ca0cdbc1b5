#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "bovw/histogram.hpp"
#include "bovw/word_grid.hpp"

/// First layer of the detector (garment-parts.txt section 3.2): logistic regression over every
/// window of a frame's word grids, by the efficient histogram-based sliding window (Wei and Tao
/// 2010). Weights are fixed point, so that the incremental sums are exact.
namespace weft::detector {

/// How a block of word counts h becomes the classifier's input.
enum class HistogramNorm {
  kSqrtL2,  // sqrt(h) divided by its L2 norm, which is sqrt(sum h)
  kL1,      // h / sum h
  kRaw,     // h
};

struct WindowShape {
  double width_px = 0.0;  // view px
  double height_px = 0.0;
};

/// One descriptor's histogram within the classifier's input. Blocks are normalised one by one and
/// concatenated.
struct HistogramBlock {
  std::string descriptor;
  std::uint64_t vocabulary_hash = 0;
  int words = 0;
  /// Two more entries count the window's points inside the mask without a word (plain cloth) and
  /// those outside it (table): where in the garment a window lies, whatever the cloth looks like.
  bool context = false;

  int entries() const { return context ? words + 2 : words; }
};

/// Logistic regression of one part.
struct PartClassifier {
  std::string part;
  std::vector<std::vector<std::int32_t>> weights;  // a block, a word; units of 2^-kWeightBits
  double bias = 0.0;
  std::vector<WindowShape> shapes;  // of the sliding windows
};

constexpr int kWeightBits = 16;
constexpr std::int32_t kMaxWeight = 1 << 26;  // 1024 before scaling

/// round(weight * 2^kWeightBits); throws Error when one is not finite or beyond kMaxWeight.
std::vector<std::int32_t> quantise_weights(std::span<const double> weights);

struct ScoreModel {
  HistogramNorm norm = HistogramNorm::kSqrtL2;
  std::vector<HistogramBlock> blocks;
  std::vector<PartClassifier> parts;
  int min_words = 4;       // windows with fewer words, all blocks together, are dropped
  std::uint64_t hash = 0;  // set by read()

  /// Throws Error naming `where` on sizes that do not agree or values out of range.
  void validate(const std::string& where) const;
  static ScoreModel read(const std::string& path);
  void write(const std::string& path) const;
};

/// Score of one window: sum over blocks of w . x, plus the bias. counts: one histogram a block. The
/// definition that the sliding window reproduces bit for bit. NaN when the window has fewer than
/// min_words words.
double window_score(const ScoreModel& model, int part,
                    std::span<const std::vector<std::int32_t>> counts);

/// Scores of all windows of one shape whose centre cell, first + size / 2 rounded down, lies in the
/// bounds of the mask. Windows may overhang the grid.
struct WindowScores {
  int window_columns = 0;  // size of the window in grid points
  int window_rows = 0;
  bovw::CellBox positions;     // of the windows' first cells
  std::vector<double> scores;  // positions.columns * positions.rows, row-major; NaN: dropped
};

/// Memory that score() works in, kept from one call to the next.
struct WindowScratch {
  struct Word {
    std::int32_t weight;
    std::int32_t count;
  };
  std::vector<Word> words;
  std::vector<std::int64_t> sums;
  std::vector<std::int32_t> counts, totals;
};

/// The word grids of one frame, laid out for sliding windows.
class WindowScorer {
 public:
  /// model and grids must outlive the scorer. One grid a block of the model, all over the same
  /// points; throws Error when they are not, or hold words that do not exist.
  WindowScorer(const ScoreModel& model, std::span<const bovw::WordGrid* const> grids);

  /// shape is at most as large as the largest of the model. May be called from several threads at
  /// once. The time does not depend on the vocabulary size but for clearing one histogram.
  WindowScores score(int part, const WindowShape& shape) const;
  void score(int part, const WindowShape& shape, WindowScratch& scratch,
             WindowScores& result) const;

  const ScoreModel& model() const { return model_; }
  const bovw::WordGrid& grid() const { return *grids_.front(); }
  /// Whether a cell (row * columns + column) is inside the mask in any of the grids.
  bool in_mask(std::size_t cell) const {
    for (const auto* each : grids_) {
      if (each->cells[cell] != bovw::WordGrid::kOutsideMask) return true;
    }
    return false;
  }
  /// The smallest box that holds the cells inside the mask.
  const bovw::CellBox& bounds() const { return bounds_; }

 private:
  // A block's words inside the mask's bounds, padded with "no word" so that windows may overhang.
  struct Layout {
    std::vector<std::uint16_t> by_row, by_column;
    std::vector<std::int32_t> counts;  // summed-area table
  };
  const ScoreModel& model_;
  std::vector<const bovw::WordGrid*> grids_;
  bovw::CellBox bounds_;                  // of the mask
  int pad_columns_ = 0, pad_rows_ = 0;    // around the bounds: the largest window
  int columns_ = 0, rows_ = 0;            // of the layouts: bounds and padding
  std::vector<Layout> layouts_;           // a block each
  std::vector<std::int32_t> root_steps_;  // sqrt(h + 1) - sqrt(h), fixed point
};

}  // namespace weft::detector
