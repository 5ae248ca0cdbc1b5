#include "detector/refiner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "base/parallel.hpp"
#include "detector/chi2_kernel.hpp"

namespace weft::detector {
namespace {

constexpr double kNever = -std::numeric_limits<double>::infinity();

/// Non-zero shares of a histogram, each block divided by its own count.
float sparse_histogram(const std::vector<int>& counts, const std::vector<int>& block_words,
                       std::vector<chi2::Entry>& entries) {
  float sum = 0.0f;
  std::size_t begin = 0;
  for (const int words : block_words) {
    const std::size_t end = begin + static_cast<std::size_t>(words);
    const int total = std::accumulate(counts.begin() + static_cast<std::ptrdiff_t>(begin),
                                      counts.begin() + static_cast<std::ptrdiff_t>(end), 0);
    for (std::size_t w = begin; w < end; ++w) {
      if (counts[w] == 0) continue;
      entries.push_back({static_cast<std::int32_t>(w),
                         static_cast<float>(static_cast<double>(counts[w]) / total)});
    }
    if (total > 0) sum += 1.0f;
    begin = end;
  }
  return sum;
}

void check_window(const bovw::WordGrid& grid, const Candidate& candidate) {
  if (candidate.column < 0 || candidate.column >= grid.columns || candidate.row < 0 ||
      candidate.row >= grid.rows) {
    throw Error("candidate of " + candidate.part + " at grid point (" +
                std::to_string(candidate.column) + ", " + std::to_string(candidate.row) +
                ") is outside the grid of " + std::to_string(grid.columns) + " x " +
                std::to_string(grid.rows));
  }
}

}  // namespace

int RefineModel::words() const {
  return std::accumulate(block_words.begin(), block_words.end(), 0);
}

void RefineModel::validate() const {
  const auto fail = [&](const std::string& what) {
    throw Error("refine model of " + part + ": " + what);
  };
  if (std::find(kParts.begin(), kParts.end(), part) == kParts.end()) fail("unknown part");
  if (shapes.empty()) fail("no window shapes");
  for (const auto& shape : shapes) {
    if (shape.columns < 1 || shape.rows < 1 || shape.columns > 1024 || shape.rows > 1024) {
      fail("window of " + std::to_string(shape.columns) + " x " + std::to_string(shape.rows) +
           " grid points");
    }
  }
  if (block_words.empty()) fail("no descriptor");
  for (const int n : block_words) {
    if (n < 1 || n > 32767) fail("vocabulary of " + std::to_string(n) + " words");
  }
  if (coefficients.empty()) fail("no support vectors");
  if (counts.size() != coefficients.size() * static_cast<std::size_t>(words())) {
    fail("counts and coefficients do not fit together");
  }
  for (const double a : coefficients) {
    if (!std::isfinite(a)) fail("a coefficient is not finite");
  }
  if (!(gamma > 0.0) || !std::isfinite(gamma) || !std::isfinite(rho) || !std::isfinite(platt_a) ||
      !std::isfinite(platt_b)) {
    fail("gamma, rho or the sigmoid is not usable");
  }
}

std::vector<int> count_words(const std::vector<const bovw::WordGrid*>& grids,
                             const GridWindow& window) {
  int words = 0;
  for (const auto* grid : grids) words += grid->vocabulary_size;
  std::vector<int> counts(static_cast<std::size_t>(words), 0);
  int* block = counts.data();
  for (const auto* grid : grids) {
    const int left = std::max(0, window.column), top = std::max(0, window.row);
    const int right = std::min(grid->columns, window.column + window.shape.columns);
    const int bottom = std::min(grid->rows, window.row + window.shape.rows);
    for (int r = top; r < bottom; ++r) {
      const std::int16_t* cells =
          grid->cells.data() + static_cast<std::ptrdiff_t>(r) * grid->columns;
      for (int c = left; c < right; ++c) {
        if (cells[c] >= 0) ++block[cells[c]];
      }
    }
    block += grid->vocabulary_size;
  }
  return counts;
}

double chi2_distance(const std::uint16_t* a, const std::uint16_t* b,
                     const std::vector<int>& block_words) {
  double distance = 0.0;
  for (const int words : block_words) {
    const double total_a = std::accumulate(a, a + words, 0),
                 total_b = std::accumulate(b, b + words, 0);
    if (total_a > 0) distance += 1.0;
    if (total_b > 0) distance += 1.0;
    // (x-t)^2 / (x+t) = x + t - 4 x t / (x+t); with x = a / total_a the last term becomes
    // 4 a b / (a total_b + b total_a).
    double common = 0.0;
    for (int w = 0; w < words; ++w) {
      if (a[w] == 0 || b[w] == 0) continue;
      common += static_cast<double>(a[w]) * b[w] / (a[w] * total_b + b[w] * total_a);
    }
    distance -= 4.0 * common;
    a += words;
    b += words;
  }
  return distance;
}

Box window_box(const bovw::WordGrid& grid, const GridWindow& window) {
  return {grid.origin_x + (window.column - 0.5) * grid.step_px,
          grid.origin_y + (window.row - 0.5) * grid.step_px, window.shape.columns * grid.step_px,
          window.shape.rows * grid.step_px};
}

double overlap(const Box& a, const Box& b) {
  const double width = std::min(a.x + a.width, b.x + b.width) - std::max(a.x, b.x);
  const double height = std::min(a.y + a.height, b.y + b.height) - std::max(a.y, b.y);
  if (width <= 0.0 || height <= 0.0) return 0.0;
  const double common = width * height;
  return common / (a.width * a.height + b.width * b.height - common);
}

void check_same_grid(const std::vector<const bovw::WordGrid*>& grids) {
  if (grids.empty()) throw Error("no word grid");
  const auto& first = *grids.front();
  for (const auto* grid : grids) {
    if (grid->columns != first.columns || grid->rows != first.rows ||
        grid->origin_x != first.origin_x || grid->origin_y != first.origin_y ||
        grid->step_px != first.step_px || grid->view.kind != first.view.kind ||
        grid->view.width != first.view.width || grid->view.height != first.view.height) {
      throw Error("the words of " + grid->descriptor + " and " + first.descriptor +
                  " lie on different grids; describe both with the same view and grid settings");
    }
  }
}

Refiner::Refiner(std::vector<RefineModel> models, RefinerOptions options)
    : models_(std::move(models)), options_(options) {
  options_.validate();
  for (const auto& model : models_) {
    model.validate();
    const int words = model.words(), count = model.support_vectors();
    Packed packed;
    packed.blocks = (count + chi2::kBlock - 1) / chi2::kBlock;
    const auto lanes = static_cast<std::size_t>(packed.blocks * chi2::kBlock);
    packed.shares.assign(lanes * static_cast<std::size_t>(words), 0.0f);
    packed.sums.assign(lanes, 0.0f);
    packed.coefficients.assign(lanes, 0.0f);
    for (int i = 0; i < count; ++i) {
      const auto* counts = model.counts.data() + static_cast<std::ptrdiff_t>(i) * words;
      std::vector<chi2::Entry> entries;
      const int block = i / chi2::kBlock, lane = i % chi2::kBlock;
      const auto at = static_cast<std::size_t>(i);
      packed.sums[at] = sparse_histogram({counts, counts + words}, model.block_words, entries);
      packed.coefficients[at] = static_cast<float>(model.coefficients[at]);
      for (const auto& e : entries) {
        packed.shares[static_cast<std::size_t>((block * words + e.word) * chi2::kBlock + lane)] =
            e.share;
      }
    }
    packed_.push_back(std::move(packed));
  }
}

double Refiner::decide(int model, const std::vector<int>& counts) const {
  const auto& m = models_.at(static_cast<std::size_t>(model));
  const auto& packed = packed_[static_cast<std::size_t>(model)];
  if (static_cast<int>(counts.size()) != m.words()) throw Error("counts do not fit the model");
  std::vector<chi2::Entry> entries;
  const float sum = sparse_histogram(counts, m.block_words, entries);
  if (entries.empty()) return kNever;
  const chi2::Histogram histogram{entries.data(), static_cast<std::int32_t>(entries.size()), sum};
  const chi2::Model kernel_model{
      packed.shares.data(), packed.sums.data(), packed.coefficients.data(),
      packed.blocks,        m.words(),          static_cast<float>(m.gamma)};
  double value = 0.0;
  chi2::best_kernel()(kernel_model, &histogram, 1, &value);
  return value - m.rho;
}

double Refiner::probability(int model, double decision) const {
  if (decision == kNever) return 0.0;
  const auto& m = models_.at(static_cast<std::size_t>(model));
  return det::logistic(-(m.platt_a * decision + m.platt_b));
}

std::vector<Detection> Refiner::refine(const std::vector<const bovw::WordGrid*>& grids,
                                       const std::vector<Candidate>& candidates,
                                       int threads) const {
  check_same_grid(grids);
  const auto& grid = *grids.front();
  std::vector<int> block_words;
  for (const auto* each : grids) block_words.push_back(each->vocabulary_size);
  if (static_cast<int>(candidates.size()) > options_.max_candidates) {
    throw Error(std::to_string(candidates.size()) +
                " candidates in a frame, but max_candidates is " +
                std::to_string(options_.max_candidates));
  }

  // All windows of all candidates; a window that two candidates of a part share is scored once.
  struct Window {
    int model;
    GridWindow where;
    double decision = kNever;
    auto key() const {
      return std::tuple(model, where.shape.columns, where.shape.rows, where.row, where.column);
    }
  };
  std::vector<Window> windows;
  struct Use {
    int candidate;
    Window window;
  };
  std::vector<Use> uses;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    const auto& candidate = candidates[i];
    check_window(grid, candidate);
    const auto model = std::find_if(models_.begin(), models_.end(),
                                    [&](const RefineModel& m) { return m.part == candidate.part; });
    if (model == models_.end()) throw Error("no refine model for part '" + candidate.part + "'");
    if (model->block_words != block_words) {
      throw Error("the words do not fit the refine model of " + candidate.part +
                  ": other vocabulary sizes");
    }
    for (const auto& shape : model->shapes) {
      for (int dy = -options_.offset_steps; dy <= options_.offset_steps; ++dy) {
        for (int dx = -options_.offset_steps; dx <= options_.offset_steps; ++dx) {
          const int centre_column = candidate.column + dx * options_.offset_stride;
          const int centre_row = candidate.row + dy * options_.offset_stride;
          if (centre_column < 0 || centre_column >= grid.columns || centre_row < 0 ||
              centre_row >= grid.rows ||
              grid.at(centre_column, centre_row) == bovw::WordGrid::kOutsideMask) {
            continue;
          }
          Use use;
          use.candidate = static_cast<int>(i);
          use.window.model = static_cast<int>(model - models_.begin());
          use.window.where = {centre_column - shape.columns / 2, centre_row - shape.rows / 2,
                              shape};
          uses.push_back(use);
        }
      }
    }
  }
  for (const auto& use : uses) windows.push_back(use.window);
  const auto before = [](const Window& a, const Window& b) { return a.key() < b.key(); };
  std::sort(windows.begin(), windows.end(), before);
  windows.erase(std::unique(windows.begin(), windows.end(),
                            [](const Window& a, const Window& b) { return a.key() == b.key(); }),
                windows.end());

  // Pieces of one model each, small enough to share evenly among threads.
  struct Piece {
    std::size_t begin, end;
  };
  std::vector<Piece> pieces;
  constexpr std::size_t kPiece = 64;
  for (std::size_t begin = 0; begin < windows.size();) {
    std::size_t end = begin;
    while (end < windows.size() && end - begin < kPiece &&
           windows[end].model == windows[begin].model) {
      ++end;
    }
    pieces.push_back({begin, end});
    begin = end;
  }
  const auto kernel = chi2::best_kernel();
  parallel_for(static_cast<int>(pieces.size()), threads, [&](int first, int last) {
    for (int p = first; p < last; ++p) {
      const auto [begin, end] = pieces[static_cast<std::size_t>(p)];
      const auto model = static_cast<std::size_t>(windows[begin].model);
      const auto& packed = packed_[model];
      std::vector<chi2::Entry> entries;
      std::vector<chi2::Histogram> histograms;
      std::vector<std::size_t> begins;
      for (std::size_t w = begin; w < end; ++w) {
        begins.push_back(entries.size());
        const float sum =
            sparse_histogram(count_words(grids, windows[w].where), block_words, entries);
        histograms.push_back(
            {nullptr, static_cast<std::int32_t>(entries.size() - begins.back()), sum});
      }
      for (std::size_t h = 0; h < histograms.size(); ++h) {
        histograms[h].entries = entries.data() + begins[h];
      }
      const chi2::Model kernel_model{
          packed.shares.data(), packed.sums.data(),     packed.coefficients.data(),
          packed.blocks,        models_[model].words(), static_cast<float>(models_[model].gamma)};
      std::vector<double> sums(histograms.size());
      kernel(kernel_model, histograms.data(), static_cast<std::int32_t>(histograms.size()),
             sums.data());
      for (std::size_t h = 0; h < histograms.size(); ++h) {
        if (histograms[h].count > 0) windows[begin + h].decision = sums[h] - models_[model].rho;
      }
    }
  });

  struct Best {
    double decision = kNever;
    const Window* window = nullptr;
  };
  std::vector<Best> best(candidates.size());
  for (const auto& use : uses) {
    const auto found = std::lower_bound(windows.begin(), windows.end(), use.window, before);
    auto& b = best[static_cast<std::size_t>(use.candidate)];
    if (found->decision > b.decision) b = {found->decision, &*found};
  }

  std::vector<Detection> detections;
  for (std::size_t i = 0; i < candidates.size(); ++i) {
    if (best[i].window == nullptr) continue;
    Detection d;
    d.part = candidates[i].part;
    d.probability = probability(best[i].window->model, best[i].decision) * candidates[i].prior;
    d.box_view = window_box(grid, best[i].window->where);
    detections.push_back(d);
  }
  std::stable_sort(
      detections.begin(), detections.end(),
      [](const Detection& a, const Detection& b) { return a.probability > b.probability; });
  std::vector<Detection> kept;
  for (auto& d : detections) {
    const bool repeated = std::any_of(kept.begin(), kept.end(), [&](const Detection& k) {
      return k.part == d.part && overlap(k.box_view, d.box_view) > options_.max_overlap;
    });
    if (repeated) continue;
    const auto& b = d.box_view;
    d.centre_sensor_px = grid.view.to_sensor({b.x + b.width / 2, b.y + b.height / 2});
    d.corners_sensor_px = {grid.view.to_sensor({b.x, b.y}),
                           grid.view.to_sensor({b.x + b.width, b.y}),
                           grid.view.to_sensor({b.x + b.width, b.y + b.height}),
                           grid.view.to_sensor({b.x, b.y + b.height})};
    kept.push_back(std::move(d));
  }
  return kept;
}

}  // namespace weft::detector
