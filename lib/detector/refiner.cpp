#include "detector/refiner.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "base/parallel.hpp"

namespace weft::detector {
namespace {

constexpr double kNever = -std::numeric_limits<double>::infinity();

/// Non-zero shares of a histogram, each block divided by its own count.
float sparse_histogram(const std::vector<std::int32_t>& counts,
                       const std::vector<HistogramBlock>& blocks,
                       std::vector<chi2::Entry>& entries) {
  float sum = 0.0f;
  std::size_t begin = 0;
  for (const auto& block : blocks) {
    const std::size_t end = begin + static_cast<std::size_t>(block.entries());
    const auto total = std::accumulate(counts.begin() + static_cast<std::ptrdiff_t>(begin),
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

void put(std::vector<std::uint8_t>& bytes, std::uint32_t value) {
  for (; value >= 128; value >>= 7) bytes.push_back(static_cast<std::uint8_t>(value | 128));
  bytes.push_back(static_cast<std::uint8_t>(value));
}

/// Word counts as bytes: of each support vector the number of words that occur, then for each the
/// words left out before it and its count; 7 bits a byte, the lowest first, the eighth bit set
/// where more follow.
std::vector<std::uint8_t> pack_counts(const std::vector<std::int32_t>& counts, int entries) {
  std::vector<std::uint8_t> bytes;
  for (auto at = counts.begin(); at != counts.end(); at += entries) {
    const auto end = at + entries;
    put(bytes, static_cast<std::uint32_t>(entries - std::count(at, end, 0)));
    std::uint32_t gap = 0;
    for (auto count = at; count != end; ++count) {
      if (*count == 0) {
        ++gap;
        continue;
      }
      put(bytes, gap);
      put(bytes, static_cast<std::uint32_t>(*count));
      gap = 0;
    }
  }
  return bytes;
}

std::vector<std::int32_t> unpack_counts(const BlobReader& blob, const std::string& section,
                                        int entries, std::size_t vectors) {
  const auto bytes = blob.values<std::uint8_t>(section);
  std::size_t next = 0;
  const auto take = [&](std::uint32_t most) {
    std::uint32_t value = 0;
    for (int shift = 0;; shift += 7) {
      if (next == bytes.size() || shift > 21) blob.fail(section + " is damaged");
      const std::uint8_t byte = bytes[next++];
      value |= static_cast<std::uint32_t>(byte & 127) << shift;
      if (byte < 128) break;
    }
    if (value > most) blob.fail(section + " holds a number that is too large");
    return value;
  };
  const auto size = vectors * static_cast<std::size_t>(entries);
  if (size > std::size_t{1} << 26) blob.fail(section + " has too many support vectors");
  std::vector<std::int32_t> counts(size, 0);
  for (std::size_t v = 0; v < vectors; ++v) {
    const auto used = take(static_cast<std::uint32_t>(entries));
    std::uint32_t word = 0;
    for (std::uint32_t k = 0; k < used; ++k, ++word) {
      word += take(static_cast<std::uint32_t>(entries));
      if (word >= static_cast<std::uint32_t>(entries)) blob.fail(section + " names no such word");
      counts[v * static_cast<std::size_t>(entries) + word] =
          static_cast<std::int32_t>(take(1 << 20));
    }
  }
  if (next != bytes.size()) blob.fail(section + " is too long");
  return counts;
}

}  // namespace

void RefineModel::validate(const std::string& where) const {
  validate_blocks(blocks, where);
  if (parts.empty()) throw Error(where + ": no parts");
  for (const auto& svm : parts) {
    validate_part(svm.part, where);
    const auto fail = [&](const std::string& what) {
      throw Error(where + ": " + svm.part + ": " + what);
    };
    if (svm.shapes.empty() || svm.shapes.size() > 64) fail("1 to 64 window shapes expected");
    for (const auto& shape : svm.shapes) {
      if (!(shape.width_px > 0.0 && shape.width_px <= 8192.0 && shape.height_px > 0.0 &&
            shape.height_px <= 8192.0)) {
        fail("a window shape is not between 0 and 8192 px");
      }
    }
    if (svm.coefficients.empty()) fail("no support vectors");
    if (svm.counts.size() != svm.coefficients.size() * static_cast<std::size_t>(entries())) {
      fail("counts and coefficients do not fit together");
    }
    for (const auto count : svm.counts) {
      if (count < 0 || count > 1 << 20) fail("a word count is out of range");
    }
    for (const double a : svm.coefficients) {
      if (!std::isfinite(a)) fail("a coefficient is not finite");
    }
    if (!(svm.gamma > 0.0) || !std::isfinite(svm.gamma) || !std::isfinite(svm.rho) ||
        !std::isfinite(svm.platt_a) || !std::isfinite(svm.platt_b)) {
      fail("gamma, rho or the sigmoid is not usable");
    }
  }
}

void RefineModel::write(const std::string& path) const {
  validate(path);
  BlobWriter blob("refine", 2);
  write_blocks(blob, blocks);
  blob.add_number("parts", static_cast<std::int64_t>(parts.size()));
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const auto& svm = parts[i];
    const std::string name = "part." + std::to_string(i) + ".";
    blob.add(name + "name", svm.part);
    std::vector<double> shapes;
    for (const auto& shape : svm.shapes) {
      shapes.push_back(shape.width_px);
      shapes.push_back(shape.height_px);
    }
    blob.add(name + "shapes", std::span<const double>(shapes));
    const auto counts = pack_counts(svm.counts, entries());
    blob.add(name + "counts", std::span<const std::uint8_t>(counts));
    blob.add(name + "coefficients", std::span<const double>(svm.coefficients));
    blob.add_number(name + "gamma", svm.gamma);
    blob.add_number(name + "rho", svm.rho);
    blob.add_number(name + "platt_a", svm.platt_a);
    blob.add_number(name + "platt_b", svm.platt_b);
  }
  blob.write(path);
}

RefineModel RefineModel::read(const std::string& path) {
  const auto blob = BlobReader::from_file(path, "refine", 2);
  if (blob.version() < 2) blob.fail("is of an earlier version of weft; train it again");
  RefineModel model;
  model.blocks = read_blocks(blob);
  model.parts.resize(
      static_cast<std::size_t>(blob.integer("parts", 1, static_cast<int>(kParts.size()))));
  for (std::size_t i = 0; i < model.parts.size(); ++i) {
    auto& svm = model.parts[i];
    const std::string name = "part." + std::to_string(i) + ".";
    svm.part = blob.text(name + "name");
    const auto shapes = blob.values<double>(name + "shapes");
    if (shapes.size() % 2 != 0) blob.fail(name + "shapes holds an odd number of values");
    for (std::size_t k = 0; k < shapes.size(); k += 2) {
      svm.shapes.push_back({shapes[k], shapes[k + 1]});
    }
    svm.coefficients = blob.values<double>(name + "coefficients");
    svm.counts = unpack_counts(blob, name + "counts", model.entries(), svm.coefficients.size());
    svm.gamma = blob.number(name + "gamma");
    svm.rho = blob.number(name + "rho");
    svm.platt_a = blob.number(name + "platt_a");
    svm.platt_b = blob.number(name + "platt_b");
  }
  model.hash = blob.hash();
  model.validate(path);
  return model;
}

double chi2_distance(const std::int32_t* a, const std::int32_t* b,
                     const std::vector<HistogramBlock>& blocks) {
  double distance = 0.0;
  for (const auto& block : blocks) {
    const double total_a = std::accumulate(a, a + block.entries(), 0);
    const double total_b = std::accumulate(b, b + block.entries(), 0);
    if (total_a > 0) distance += 1.0;
    if (total_b > 0) distance += 1.0;
    // (x-t)^2 / (x+t) = x + t - 4 x t / (x+t); with x = a / total_a the last term becomes
    // 4 a b / (a total_b + b total_a).
    double common = 0.0;
    for (int w = 0; w < block.entries(); ++w) {
      if (a[w] == 0 || b[w] == 0) continue;
      common += static_cast<double>(a[w]) * b[w] / (a[w] * total_b + b[w] * total_a);
    }
    distance -= 4.0 * common;
    a += block.entries();
    b += block.entries();
  }
  return distance;
}

Box window_box(const bovw::WordGrid& grid, const bovw::CellBox& window) {
  return {grid.origin_x + (window.column - 0.5) * grid.step_px,
          grid.origin_y + (window.row - 0.5) * grid.step_px, window.columns * grid.step_px,
          window.rows * grid.step_px};
}

std::vector<bovw::CellBox> candidate_windows(const bovw::WordGrid& grid, int column, int row,
                                             const std::vector<WindowShape>& shapes,
                                             const RefinerOptions& options) {
  std::vector<bovw::CellBox> windows;
  for (const auto& shape : shapes) {
    const int columns = bovw::window_cells(shape.width_px, grid.step_px);
    const int rows = bovw::window_cells(shape.height_px, grid.step_px);
    for (int dy = -options.offset_steps; dy <= options.offset_steps; ++dy) {
      for (int dx = -options.offset_steps; dx <= options.offset_steps; ++dx) {
        const int c = column + dx * options.offset_stride, r = row + dy * options.offset_stride;
        if (c < 0 || c >= grid.columns || r < 0 || r >= grid.rows ||
            grid.at(c, r) == bovw::WordGrid::kOutsideMask) {
          continue;
        }
        windows.push_back({c - columns / 2, r - rows / 2, columns, rows});
      }
    }
  }
  return windows;
}

double overlap(const Box& a, const Box& b) {
  const double width = std::min(a.x + a.width, b.x + b.width) - std::max(a.x, b.x);
  const double height = std::min(a.y + a.height, b.y + b.height) - std::max(a.y, b.y);
  if (width <= 0.0 || height <= 0.0) return 0.0;
  const double common = width * height;
  return common / (a.width * a.height + b.width * b.height - common);
}

chi2::Model Refiner::Packed::model(int words, double gamma) const {
  return {shares.data(), sums.data(), coefficients.data(),
          blocks,        words,       static_cast<float>(gamma)};
}

Refiner::Refiner(RefineModel model, const RefinerOptions& options)
    : model_(std::move(model)), options_(options) {
  options_.validate();
  model_.validate("refine model");
  const int words = model_.entries();
  for (const auto& svm : model_.parts) {
    const int count = svm.support_vectors();
    Packed packed;
    packed.blocks = (count + chi2::kBlock - 1) / chi2::kBlock;
    const auto lanes = static_cast<std::size_t>(packed.blocks * chi2::kBlock);
    packed.shares.assign(lanes * static_cast<std::size_t>(words), 0.0f);
    packed.sums.assign(lanes, 0.0f);
    packed.coefficients.assign(lanes, 0.0f);
    for (int i = 0; i < count; ++i) {
      const auto* counts = svm.counts.data() + static_cast<std::ptrdiff_t>(i) * words;
      std::vector<chi2::Entry> entries;
      const int block = i / chi2::kBlock, lane = i % chi2::kBlock;
      const auto at = static_cast<std::size_t>(i);
      packed.sums[at] = sparse_histogram({counts, counts + words}, model_.blocks, entries);
      packed.coefficients[at] = static_cast<float>(svm.coefficients[at]);
      for (const auto& e : entries) {
        packed.shares[static_cast<std::size_t>((block * words + e.word) * chi2::kBlock + lane)] =
            e.share;
      }
    }
    packed_.push_back(std::move(packed));
  }
}

double Refiner::decide(int part, const std::vector<std::int32_t>& counts) const {
  const auto& svm = model_.parts.at(static_cast<std::size_t>(part));
  if (static_cast<int>(counts.size()) != model_.entries()) {
    throw Error("word counts do not fit the refine model");
  }
  std::vector<chi2::Entry> entries;
  const float sum = sparse_histogram(counts, model_.blocks, entries);
  if (entries.empty()) return kNever;
  const chi2::Histogram histogram{entries.data(), static_cast<std::int32_t>(entries.size()), sum};
  double value = 0.0;
  chi2::best_kernel()(packed_[static_cast<std::size_t>(part)].model(model_.entries(), svm.gamma),
                      &histogram, 1, &value);
  return value - svm.rho;
}

std::vector<Detection> Refiner::refine(std::span<const bovw::WordGrid* const> grids,
                                       std::span<const Candidate> candidates, int threads) const {
  check_grids(model_.blocks, grids, "refine model");
  const auto& grid = *grids.front();
  if (static_cast<int>(candidates.size()) > options_.max_candidates) {
    throw Error(std::to_string(candidates.size()) +
                " candidates in a frame, but max_candidates is " +
                std::to_string(options_.max_candidates));
  }

  // All windows of all candidates; a window that two candidates of a part share is scored once.
  struct Window {
    int part;
    bovw::CellBox where;
    double decision = kNever;
    auto key() const {
      return std::tuple(part, where.columns, where.rows, where.row, where.column);
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
    if (candidate.column < 0 || candidate.column >= grid.columns || candidate.row < 0 ||
        candidate.row >= grid.rows) {
      throw Error("candidate of " + candidate.part + " at grid point (" +
                  std::to_string(candidate.column) + ", " + std::to_string(candidate.row) +
                  ") is outside the grid of " + std::to_string(grid.columns) + " x " +
                  std::to_string(grid.rows));
    }
    const auto svm = std::find_if(model_.parts.begin(), model_.parts.end(),
                                  [&](const PartSvm& p) { return p.part == candidate.part; });
    if (svm == model_.parts.end()) throw Error("no refine model for part '" + candidate.part + "'");
    for (const auto& window :
         candidate_windows(grid, candidate.column, candidate.row, svm->shapes, options_)) {
      uses.push_back(
          {static_cast<int>(i), {static_cast<int>(svm - model_.parts.begin()), window, kNever}});
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
           windows[end].part == windows[begin].part) {
      ++end;
    }
    pieces.push_back({begin, end});
    begin = end;
  }
  const auto kernel = chi2::best_kernel();
  parallel_for(static_cast<int>(pieces.size()), threads, [&](int first, int last) {
    for (int p = first; p < last; ++p) {
      const auto [begin, end] = pieces[static_cast<std::size_t>(p)];
      const auto part = static_cast<std::size_t>(windows[begin].part);
      const auto& svm = model_.parts[part];
      std::vector<chi2::Entry> entries;
      std::vector<chi2::Histogram> histograms;
      std::vector<std::size_t> begins;
      for (std::size_t w = begin; w < end; ++w) {
        begins.push_back(entries.size());
        const float sum = sparse_histogram(count_blocks(model_.blocks, grids, windows[w].where),
                                           model_.blocks, entries);
        histograms.push_back(
            {nullptr, static_cast<std::int32_t>(entries.size() - begins.back()), sum});
      }
      for (std::size_t h = 0; h < histograms.size(); ++h) {
        histograms[h].entries = entries.data() + begins[h];
      }
      std::vector<double> sums(histograms.size());
      kernel(packed_[part].model(model_.entries(), svm.gamma), histograms.data(),
             static_cast<std::int32_t>(histograms.size()), sums.data());
      for (std::size_t h = 0; h < histograms.size(); ++h) {
        if (histograms[h].count > 0) windows[begin + h].decision = sums[h] - svm.rho;
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
    const auto& svm = model_.parts[static_cast<std::size_t>(best[i].window->part)];
    d.probability =
        det::logistic(-(svm.platt_a * best[i].decision + svm.platt_b)) * candidates[i].prior;
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
