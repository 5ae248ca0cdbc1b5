#include "detector/probability_map.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/det_math.hpp"

namespace weft::detector {
namespace {

constexpr std::int32_t kOne = 1 << FixedMap::kProbabilityBits;
constexpr int kTableRange = 16;  // beyond +-16 the logistic is 0 or 1 within 2^-16
constexpr int kTableSteps = 64;  // per unit of score

class LogisticTable {
 public:
  LogisticTable() {
    for (std::size_t i = 0; i < values_.size(); ++i)
      values_[i] = det::logistic(static_cast<double>(i) / kTableSteps - kTableRange) * kOne;
  }
  std::int32_t operator()(double score) const {
    const double limit = kTableRange;
    const double at = (std::clamp(score, -limit, limit) + limit) * kTableSteps;
    const auto i = static_cast<std::int32_t>(at);
    const double low = values_[static_cast<std::size_t>(i)];
    const double step = values_[static_cast<std::size_t>(i) + 1] - low;
    return static_cast<std::int32_t>(low + step * (at - i) + 0.5);
  }

 private:
  std::array<double, 2 * kTableRange * kTableSteps + 2> values_;
};

using Row = std::vector<std::int32_t>;

void add_row(const Row& probability, const Row& present, std::int64_t* __restrict sum,
             std::int32_t* __restrict cover) {
  for (std::size_t c = 0; c < probability.size(); ++c) sum[c] += probability[c];
  for (std::size_t c = 0; c < present.size(); ++c) cover[c] += present[c];
}

void subtract_row(const Row& probability, const Row& present, std::int64_t* __restrict sum,
                  std::int32_t* __restrict cover) {
  for (std::size_t c = 0; c < probability.size(); ++c) sum[c] -= probability[c];
  for (std::size_t c = 0; c < present.size(); ++c) cover[c] -= present[c];
}

// Fixed-point weights that add up to kOne.
std::vector<std::int32_t> gaussian_weights(double sigma_cells) {
  const int radius = static_cast<int>(std::ceil(3.0 * sigma_cells));
  std::vector<double> weights;
  double total = 0.0;
  for (int i = -radius; i <= radius; ++i) {
    weights.push_back(det::exp(-0.5 * i * i / (sigma_cells * sigma_cells)));
    total += weights.back();
  }
  std::vector<std::int32_t> fixed;
  std::int32_t sum = 0;
  for (const double weight : weights) {
    fixed.push_back(static_cast<std::int32_t>(std::floor(weight / total * kOne + 0.5)));
    sum += fixed.back();
  }
  fixed[static_cast<std::size_t>(radius)] += kOne - sum;
  return fixed;
}

// One pass along lines of `length` values `stride` apart; zero beyond the ends.
void smooth_lines(std::vector<std::int32_t>& values, int lines, int line_stride, int length,
                  int stride, const std::vector<std::int32_t>& weights) {
  const int radius = static_cast<int>(weights.size()) / 2;
  std::vector<std::int64_t> line(static_cast<std::size_t>(length + 2 * radius), 0);
  for (int l = 0; l < lines; ++l) {
    std::int32_t* first = values.data() + static_cast<std::ptrdiff_t>(l) * line_stride;
    for (int i = 0; i < length; ++i)
      line[static_cast<std::size_t>(i + radius)] = first[static_cast<std::ptrdiff_t>(i) * stride];
    for (int i = 0; i < length; ++i) {
      std::int64_t sum = kOne / 2;
      for (std::size_t tap = 0; tap < weights.size(); ++tap)
        sum += weights[tap] * line[static_cast<std::size_t>(i) + tap];
      first[static_cast<std::ptrdiff_t>(i) * stride] = static_cast<std::int32_t>(sum / kOne);
    }
  }
}

}  // namespace

std::int32_t fixed_probability(double score) {
  static const LogisticTable table;
  return table(score);
}

FixedMap probability_map(const WindowScorer& scorer, int part, const MapOptions& options) {
  options.validate();
  const auto& grid = scorer.grid();
  const auto& bounds = scorer.bounds();
  FixedMap map{grid.columns, grid.rows, {}};
  map.values.assign(grid.cells.size(), 0);
  if (bounds.columns == 0) return map;

  // Box splat by corner differences: a window adds its probability at two corners and takes it away
  // at the other two; one prefix sum then gives every point the sum of the windows over it. The
  // difference arrays reach a window's size beyond the bounds of the mask on each side.
  const auto& shapes = scorer.model().parts[static_cast<std::size_t>(part)].shapes;
  int pad_columns = 0, pad_rows = 0;
  for (const auto& shape : shapes) {
    pad_columns = std::max(pad_columns, bovw::window_cells(shape.width_px, grid.step_px));
    pad_rows = std::max(pad_rows, bovw::window_cells(shape.height_px, grid.step_px));
  }
  const int width = bounds.columns + 2 * pad_columns + 1;
  const int height = bounds.rows + 2 * pad_rows + 1;
  const auto size = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  std::vector<std::int64_t> sums(size, 0);
  std::vector<std::int32_t> covers(size, 0);
  Row probability(static_cast<std::size_t>(bounds.columns)), present(probability.size());
  WindowScratch scratch;
  WindowScores windows;
  for (const auto& shape : shapes) {
    scorer.score(part, shape, scratch, windows);
    const int column = windows.positions.column - bounds.column + pad_columns;
    for (int r = 0; r < bounds.rows; ++r) {
      const double* scores =
          windows.scores.data() + static_cast<std::ptrdiff_t>(r) * bounds.columns;
      for (std::size_t c = 0; c < probability.size(); ++c) {
        present[c] = std::isnan(scores[c]) ? 0 : 1;
        probability[c] = present[c] ? fixed_probability(scores[c]) : 0;
      }
      const int row = windows.positions.row - bounds.row + pad_rows + r;
      const auto at = [&](int x, int y) { return static_cast<std::ptrdiff_t>(y) * width + x; };
      const int right = column + windows.window_columns, below = row + windows.window_rows;
      add_row(probability, present, sums.data() + at(column, row), covers.data() + at(column, row));
      subtract_row(probability, present, sums.data() + at(right, row),
                   covers.data() + at(right, row));
      subtract_row(probability, present, sums.data() + at(column, below),
                   covers.data() + at(column, below));
      add_row(probability, present, sums.data() + at(right, below),
              covers.data() + at(right, below));
    }
  }
  for (int y = 0; y < height; ++y) {
    std::int64_t sum = 0;
    std::int32_t cover = 0;
    for (int x = 0; x < width; ++x) {
      const auto at = static_cast<std::size_t>(y * width + x);
      sum += sums[at];
      cover += covers[at];
      sums[at] = sum + (y > 0 ? sums[at - static_cast<std::size_t>(width)] : 0);
      covers[at] = cover + (y > 0 ? covers[at - static_cast<std::size_t>(width)] : 0);
    }
  }
  const auto apply_mask = [&] {
    for (std::size_t cell = 0; cell < map.values.size(); ++cell) {
      if (!scorer.in_mask(cell)) map.values[cell] = 0;
    }
  };
  for (int r = 0; r < bounds.rows; ++r) {
    for (int c = 0; c < bounds.columns; ++c) {
      const auto at = static_cast<std::size_t>((r + pad_rows) * width + c + pad_columns);
      const std::int64_t cover = covers[at];
      if (cover == 0) continue;
      map.values[static_cast<std::size_t>((bounds.row + r) * grid.columns + bounds.column + c)] =
          static_cast<std::int32_t>((2 * sums[at] + cover) / (2 * cover));
    }
  }
  apply_mask();
  const double sigma_cells = options.smoothing_sigma_px / grid.step_px;
  if (sigma_cells > 0.0) {
    const auto weights = gaussian_weights(sigma_cells);
    smooth_lines(map.values, map.rows, map.columns, map.columns, 1, weights);
    smooth_lines(map.values, map.columns, 1, map.rows, map.columns, weights);
    apply_mask();
  }
  for (int row = 0; row < map.rows; ++row) {
    const double y = grid.origin_y + row * grid.step_px;
    for (int column = 0; column < map.columns; ++column) {
      const double x = grid.origin_x + column * grid.step_px;
      if (std::min(std::min(x, grid.view.width - 1 - x), std::min(y, grid.view.height - 1 - y)) <
          options.margin_px) {
        map.values[static_cast<std::size_t>(row * map.columns + column)] = 0;
      }
    }
  }
  return map;
}

ProbabilityMap to_probability_map(const FixedMap& map, const std::string& part) {
  ProbabilityMap out;
  out.part = part;
  std::int32_t most = 0;
  for (const auto value : map.values) most = std::max(most, value);
  out.full_scale = most > 0 ? static_cast<double>(most) / kOne : 1.0;
  out.values.reserve(map.values.size());
  for (const auto value : map.values) {
    out.values.push_back(most > 0 ? static_cast<std::uint8_t>((510 * std::int64_t{value} + most) /
                                                              (2 * std::int64_t{most}))
                                  : 0);
  }
  return out;
}

}  // namespace weft::detector
