#include "detector/window_scorer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/blob.hpp"
#include "base/error.hpp"
#include "detector/blocks.hpp"

namespace weft::detector {
namespace {

constexpr int kRootBits = 16;         // of the square root table
constexpr int kMaxWindowCells = 512;  // along a side
constexpr int kMaxGridCells = 1 << 22;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

std::int64_t fixed_root(int count) {
  return static_cast<std::int64_t>(
      std::floor(std::sqrt(static_cast<double>(count)) * (1 << kRootBits) + 0.5));
}

// A block's share of the score, from sum_v w_v f(h_v) and the number of words. Without words both
// are 0, and so is the share.
template <HistogramNorm kNorm>
double block_score(std::int64_t sum, std::int32_t count) {
  const auto value = static_cast<double>(sum);
  const auto words = static_cast<double>(count > 0 ? count : 1);
  if constexpr (kNorm == HistogramNorm::kSqrtL2)
    return value / std::sqrt(words) * (1.0 / (std::int64_t{1} << (kWeightBits + kRootBits)));
  if constexpr (kNorm == HistogramNorm::kL1) return value / words * (1.0 / (1 << kWeightBits));
  return value * (1.0 / (1 << kWeightBits));
}

double block_score(HistogramNorm norm, std::int64_t sum, std::int32_t count) {
  if (norm == HistogramNorm::kSqrtL2) return block_score<HistogramNorm::kSqrtL2>(sum, count);
  if (norm == HistogramNorm::kL1) return block_score<HistogramNorm::kL1>(sum, count);
  return block_score<HistogramNorm::kRaw>(sum, count);
}

template <HistogramNorm kNorm>
void add_scores(const std::int64_t* __restrict sums, const std::int32_t* __restrict counts,
                std::size_t size, double* __restrict scores) {
  for (std::size_t i = 0; i < size; ++i) scores[i] += block_score<kNorm>(sums[i], counts[i]);
}

// Sums over the boxes wide x high whose first cells are [column, column + columns) x [row, row +
// rows), from a summed-area table with `stride` values a row.
template <class T>
void box_sums(const std::vector<T>& table, int stride, int column, int row, int columns, int rows,
              int wide, int high, T* __restrict out) {
  for (int r = row; r < row + rows; ++r, out += columns) {
    const T* above = table.data() + static_cast<std::ptrdiff_t>(r) * stride + column;
    const T* below = above + static_cast<std::ptrdiff_t>(high) * stride;
    for (int c = 0; c < columns; ++c)
      out[c] = below[c + wide] - above[c + wide] - below[c] + above[c];
  }
}

// Slides a window of length_u x length_v over words laid out u-major, back and forth, and writes
// sum_v w_v sqrt(h_v) of every position to out[u * out_u + v * out_v]. steps[h] is
// sqrt(h + 1) - sqrt(h). Each step only touches the words that enter and leave, so the time does
// not depend on the vocabulary.
void slide(const std::uint16_t* cells, int stride, int positions_u, int positions_v, int length_u,
           int length_v, const std::int32_t* steps, WindowScratch::Word* words, std::int64_t* out,
           int out_u, int out_v) {
  std::int64_t sum = 0;
  const auto add = [&](std::uint16_t cell) {
    WindowScratch::Word& word = words[cell];
    sum += static_cast<std::int64_t>(word.weight) * steps[word.count++];
  };
  const auto remove = [&](std::uint16_t cell) {
    WindowScratch::Word& word = words[cell];
    sum -= static_cast<std::int64_t>(word.weight) * steps[--word.count];
  };
  for (int u = 0; u < length_u; ++u) {
    for (int v = 0; v < length_v; ++v) add(cells[u * stride + v]);
  }
  int u = 0;
  for (int v = 0;; ++v) {
    const int direction = v % 2 == 0 ? 1 : -1;
    const int last = v % 2 == 0 ? positions_u - 1 : 0;
    out[u * out_u + v * out_v] = sum;
    while (u != last) {
      const std::uint16_t* leaving = cells + (direction > 0 ? u : u + length_u - 1) * stride + v;
      const std::uint16_t* entering = cells + (direction > 0 ? u + length_u : u - 1) * stride + v;
      // Where the window overhangs the garment the same word comes as goes.
      for (int i = 0; i < length_v; ++i) {
        if (leaving[i] == entering[i]) continue;
        remove(leaving[i]);
        add(entering[i]);
      }
      u += direction;
      out[u * out_u + v * out_v] = sum;
    }
    if (v + 1 == positions_v) break;
    for (int i = 0; i < length_u; ++i) {
      const std::uint16_t* row = cells + (u + i) * stride + v;
      if (row[0] == row[length_v]) continue;
      remove(row[0]);
      add(row[length_v]);
    }
  }
}

// What the loops below rely on.
void check_cells(const bovw::WordGrid& grid) {
  if (grid.columns < 0 || grid.rows < 0 || !(grid.step_px > 0.0) ||
      static_cast<std::int64_t>(grid.columns) * grid.rows > kMaxGridCells ||
      grid.cells.size() !=
          static_cast<std::size_t>(grid.columns) * static_cast<std::size_t>(grid.rows)) {
    throw Error("the word grid of " + grid.descriptor + " has an impossible size");
  }
  for (const auto cell : grid.cells) {
    if (cell < bovw::WordGrid::kOutsideMask || cell >= grid.vocabulary_size)
      throw Error("the word grid of " + grid.descriptor + " holds a word that does not exist");
  }
}

std::vector<std::string> split_lines(const std::string& text) {
  std::vector<std::string> lines;
  std::size_t begin = 0;
  for (std::size_t end; (end = text.find('\n', begin)) != std::string::npos; begin = end + 1)
    lines.push_back(text.substr(begin, end - begin));
  return lines;
}

}  // namespace

std::vector<std::int32_t> quantise_weights(std::span<const double> weights) {
  std::vector<std::int32_t> out;
  out.reserve(weights.size());
  for (const double weight : weights) {
    const double fixed = std::floor(weight * (1 << kWeightBits) + 0.5);
    if (!(std::abs(fixed) <= kMaxWeight)) {
      throw Error("classifier weight " + std::to_string(weight) +
                  " is not within +-1024; train with a smaller C");
    }
    out.push_back(static_cast<std::int32_t>(fixed));
  }
  return out;
}

void ScoreModel::validate(const std::string& where) const {
  const auto fail = [&](const std::string& reason) { throw Error(where + ": " + reason); };
  validate_blocks(blocks, where);
  if (parts.empty() || parts.size() > 1000) fail("expected 1 to 1000 parts");
  if (min_words < 1) fail("min_words is " + std::to_string(min_words) + "; expected at least 1");
  for (const auto& part : parts) {
    const std::string name = "part '" + part.part + "'";
    if (part.part.empty() || part.part.find('\n') != std::string::npos) fail("a part has no name");
    if (part.weights.size() != blocks.size()) fail(name + " has weights of other blocks");
    for (std::size_t b = 0; b < blocks.size(); ++b) {
      if (part.weights[b].size() != static_cast<std::size_t>(blocks[b].entries()))
        fail(name + " has " + std::to_string(part.weights[b].size()) + " weights for " +
             std::to_string(blocks[b].entries()) + " entries of " + blocks[b].descriptor);
      for (const auto weight : part.weights[b]) {
        if (weight < -kMaxWeight || weight > kMaxWeight) fail(name + " has a weight beyond +-1024");
      }
    }
    if (!std::isfinite(part.bias)) fail(name + " has a bias that is not finite");
    if (part.shapes.empty() || part.shapes.size() > 1000) fail(name + " has no window shapes");
    for (const auto& shape : part.shapes) {
      if (!(shape.width_px >= 1.0 && shape.width_px <= 8192.0 && shape.height_px >= 1.0 &&
            shape.height_px <= 8192.0)) {
        fail(name + " has a window shape that is not 1 to 8192 px");
      }
    }
  }
}

ScoreModel ScoreModel::read(const std::string& path) {
  const auto blob = BlobReader::from_file(path, "score model", 1);
  ScoreModel model;
  model.hash = blob.hash();
  model.norm = static_cast<HistogramNorm>(blob.integer("norm", 0, 2));
  model.min_words = static_cast<int>(blob.integer("min_words", 1, 1 << 20));
  model.blocks = read_blocks(blob);
  const auto parts = split_lines(blob.text("parts"));
  const auto biases = blob.values<double>("biases", parts.size());
  for (std::size_t p = 0; p < parts.size(); ++p) {
    PartClassifier part;
    part.part = parts[p];
    part.bias = biases[p];
    const std::string prefix = "part/" + std::to_string(p) + "/";
    for (std::size_t b = 0; b < model.blocks.size(); ++b)
      part.weights.push_back(blob.values<std::int32_t>(prefix + "weights/" + std::to_string(b)));
    const auto shapes = blob.values<double>(prefix + "shapes");
    if (shapes.size() % 2 != 0) blob.fail("section '" + prefix + "shapes' has an odd size");
    for (std::size_t i = 0; i < shapes.size(); i += 2)
      part.shapes.push_back({shapes[i], shapes[i + 1]});
    model.parts.push_back(std::move(part));
  }
  model.validate(path);
  return model;
}

void ScoreModel::write(const std::string& path) const {
  validate(path);
  BlobWriter blob("score model", 1);
  blob.add_number("norm", static_cast<std::int64_t>(norm));
  blob.add_number("min_words", static_cast<std::int64_t>(min_words));
  write_blocks(blob, blocks);
  std::string names;
  std::vector<double> biases;
  for (std::size_t p = 0; p < parts.size(); ++p) {
    names += parts[p].part + "\n";
    biases.push_back(parts[p].bias);
    const std::string prefix = "part/" + std::to_string(p) + "/";
    for (std::size_t b = 0; b < blocks.size(); ++b)
      blob.add(prefix + "weights/" + std::to_string(b), parts[p].weights[b]);
    std::vector<double> shapes;
    for (const auto& shape : parts[p].shapes) {
      shapes.push_back(shape.width_px);
      shapes.push_back(shape.height_px);
    }
    blob.add(prefix + "shapes", shapes);
  }
  blob.add("parts", names);
  blob.add("biases", biases);
  blob.write(path);
}

double window_score(const ScoreModel& model, int part,
                    std::span<const std::vector<std::int32_t>> counts) {
  const auto& classifier = model.parts.at(static_cast<std::size_t>(part));
  if (counts.size() != model.blocks.size())
    throw Error("window_score: expected one histogram for each block");
  double score = classifier.bias;
  int total = 0;
  for (std::size_t b = 0; b < counts.size(); ++b) {
    if (counts[b].size() != classifier.weights[b].size())
      throw Error("window_score: the histogram is not of the model's vocabulary");
    std::int64_t sum = 0;
    int all = 0;
    for (std::size_t word = 0; word < counts[b].size(); ++word) {
      const int count = counts[b][word];
      all += count;
      if (static_cast<int>(word) < model.blocks[b].words) total += count;
      sum += classifier.weights[b][word] *
             (model.norm == HistogramNorm::kSqrtL2 ? fixed_root(count) : count);
    }
    score += block_score(model.norm, sum, all);
  }
  return total < model.min_words ? kNone : score;
}

WindowScorer::WindowScorer(const ScoreModel& model, std::span<const bovw::WordGrid* const> grids)
    : model_(model), grids_(grids.begin(), grids.end()) {
  check_grids(model.blocks, grids, "score model");
  for (const auto* each : grids_) check_cells(*each);
  int left = grid().columns, top = grid().rows, right = 0, bottom = 0;
  for (const auto* each : grids_) {
    const auto box = bovw::mask_bounds(*each);
    if (box.columns == 0) continue;
    left = std::min(left, box.column);
    top = std::min(top, box.row);
    right = std::max(right, box.column + box.columns);
    bottom = std::max(bottom, box.row + box.rows);
  }
  if (right == 0) return;  // nothing inside the mask, no windows
  bounds_ = {left, top, right - left, bottom - top};
  for (const auto& part : model.parts) {
    for (const auto& shape : part.shapes) {
      pad_columns_ = std::max(pad_columns_, bovw::window_cells(shape.width_px, grid().step_px));
      pad_rows_ = std::max(pad_rows_, bovw::window_cells(shape.height_px, grid().step_px));
    }
  }
  if (pad_columns_ > kMaxWindowCells || pad_rows_ > kMaxWindowCells) {
    throw Error("a window of the score model spans more than " + std::to_string(kMaxWindowCells) +
                " grid points; the grid's step does not fit the model");
  }
  columns_ = bounds_.columns + 2 * pad_columns_;
  rows_ = bounds_.rows + 2 * pad_rows_;
  const auto cells = static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  for (const auto* each : grids_) {
    Layout layout;
    // After the words: plain cloth, then what lies outside the mask.
    const int plain = each->vocabulary_size;
    layout.by_row.resize(cells);
    layout.by_column.resize(cells);
    layout.counts.assign(
        static_cast<std::size_t>(columns_ + 1) * static_cast<std::size_t>(rows_ + 1), 0);
    for (int row = 0; row < rows_; ++row) {
      std::int32_t in_row = 0;
      for (int column = 0; column < columns_; ++column) {
        const int x = bounds_.column + column - pad_columns_, y = bounds_.row + row - pad_rows_;
        const bool inside = x >= 0 && y >= 0 && x < each->columns && y < each->rows;
        int word = inside ? each->at(x, y) : bovw::WordGrid::kOutsideMask;
        in_row += word >= 0;
        if (word < 0) word = word == bovw::WordGrid::kNoWord ? plain : plain + 1;
        layout.by_row[static_cast<std::size_t>(row * columns_ + column)] =
            layout.by_column[static_cast<std::size_t>(column * rows_ + row)] =
                static_cast<std::uint16_t>(word);
        layout.counts[static_cast<std::size_t>((row + 1) * (columns_ + 1) + column + 1)] =
            layout.counts[static_cast<std::size_t>(row * (columns_ + 1) + column + 1)] + in_row;
      }
    }
    layouts_.push_back(std::move(layout));
  }
  // Counts go up to the window's size, and a column more while it moves.
  const int most = pad_columns_ * pad_rows_ + std::max(pad_columns_, pad_rows_) + 1;
  root_steps_.resize(static_cast<std::size_t>(most));
  for (int count = 0; count < most; ++count) {
    root_steps_[static_cast<std::size_t>(count)] =
        static_cast<std::int32_t>(fixed_root(count + 1) - fixed_root(count));
  }
}

WindowScores WindowScorer::score(int part, const WindowShape& shape) const {
  WindowScratch scratch;
  WindowScores result;
  score(part, shape, scratch, result);
  return result;
}

void WindowScorer::score(int part, const WindowShape& shape, WindowScratch& scratch,
                         WindowScores& result) const {
  const auto& classifier = model_.parts.at(static_cast<std::size_t>(part));
  const int wide = bovw::window_cells(shape.width_px, grid().step_px);
  const int high = bovw::window_cells(shape.height_px, grid().step_px);
  result.window_columns = wide;
  result.window_rows = high;
  result.positions = {bounds_.column - wide / 2, bounds_.row - high / 2, bounds_.columns,
                      bounds_.rows};
  const auto positions =
      static_cast<std::size_t>(bounds_.columns) * static_cast<std::size_t>(bounds_.rows);
  result.scores.assign(positions, classifier.bias);
  if (positions == 0) return;
  if (wide > pad_columns_ || high > pad_rows_)
    throw Error("the window shape is larger than those of the score model");
  scratch.sums.resize(positions);
  scratch.counts.resize(positions);
  scratch.totals.assign(positions, 0);
  // First cell of the first window in the padded layout.
  const int column0 = pad_columns_ - wide / 2, row0 = pad_rows_ - high / 2;
  for (std::size_t b = 0; b < layouts_.size(); ++b) {
    const auto& layout = layouts_[b];
    const auto& weights = classifier.weights[b];
    if (model_.norm == HistogramNorm::kSqrtL2) {
      auto& words = scratch.words;
      words.clear();
      for (const auto weight : weights) words.push_back({weight, 0});
      words.resize(static_cast<std::size_t>(model_.blocks[b].words) + 2);  // 0 without context
      // The shorter edge moves.
      if (high <= wide) {
        slide(layout.by_column.data() + column0 * rows_ + row0, rows_, bounds_.columns,
              bounds_.rows, wide, high, root_steps_.data(), words.data(), scratch.sums.data(), 1,
              bounds_.columns);
      } else {
        slide(layout.by_row.data() + row0 * columns_ + column0, columns_, bounds_.rows,
              bounds_.columns, high, wide, root_steps_.data(), words.data(), scratch.sums.data(),
              bounds_.columns, 1);
      }
    } else {
      // Linear in the counts: a summed-area table of the words' weights.
      std::vector<std::int64_t> table(layout.counts.size(), 0);
      for (int row = 0; row < rows_; ++row) {
        std::int64_t in_row = 0;
        for (int column = 0; column < columns_; ++column) {
          const auto word = layout.by_row[static_cast<std::size_t>(row * columns_ + column)];
          if (word < weights.size()) in_row += weights[word];
          table[static_cast<std::size_t>((row + 1) * (columns_ + 1) + column + 1)] =
              table[static_cast<std::size_t>(row * (columns_ + 1) + column + 1)] + in_row;
        }
      }
      box_sums(table, columns_ + 1, column0, row0, bounds_.columns, bounds_.rows, wide, high,
               scratch.sums.data());
    }
    box_sums(layout.counts, columns_ + 1, column0, row0, bounds_.columns, bounds_.rows, wide, high,
             scratch.counts.data());
    for (std::size_t i = 0; i < positions; ++i) scratch.totals[i] += scratch.counts[i];
    if (model_.blocks[b].context)
      std::fill(scratch.counts.begin(), scratch.counts.end(), wide * high);
    const auto add = model_.norm == HistogramNorm::kSqrtL2 ? add_scores<HistogramNorm::kSqrtL2>
                     : model_.norm == HistogramNorm::kL1   ? add_scores<HistogramNorm::kL1>
                                                           : add_scores<HistogramNorm::kRaw>;
    add(scratch.sums.data(), scratch.counts.data(), positions, result.scores.data());
  }
  for (std::size_t i = 0; i < positions; ++i)
    result.scores[i] = scratch.totals[i] < model_.min_words ? kNone : result.scores[i];
}

}  // namespace weft::detector
