#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

#include "base/det_math.hpp"
#include "base/error.hpp"
#include "foreground/foreground.hpp"

namespace weft::foreground {

namespace {

// Votes are log odds for garment, in nats. All arithmetic on them is + - * / in a fixed order.
using Votes = std::vector<float>;
constexpr int kNoHeight = std::numeric_limits<int>::min();
constexpr int kBelowTable_um = -50000;
constexpr int kNeighbours[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};

using Colour = std::array<std::uint8_t, 3>;  // BGR

/// The working image: cells of factor x factor pixels.
struct Cells {
  int factor = 1, width = 0, height = 0;
  std::vector<Colour> colour;
  std::vector<double> z_m;  // mean of the valid depth; 0 where less than half is valid
  // 0: no depth and black, as outside a turned or moved image; or below the table, as the floor
  std::vector<std::uint8_t> seen;
  int count() const { return width * height; }
  bool inside(int x, int y) const { return x >= 0 && x < width && y >= 0 && y < height; }
};

Cells make_cells(const rgbd::RgbdFrame& frame) {
  Cells cells;
  cells.factor = std::max(1, (frame.camera.width + 160) / 320);
  const int f = cells.factor;
  cells.width = (frame.camera.width + f - 1) / f;
  cells.height = (frame.camera.height + f - 1) / f;
  cells.colour.resize(static_cast<std::size_t>(cells.count()));
  cells.z_m.assign(cells.colour.size(), 0.0);
  cells.seen.assign(cells.colour.size(), 1);
  for (int y = 0; y < cells.height; ++y) {
    for (int x = 0; x < cells.width; ++x) {
      const int u1 = std::min((x + 1) * f, frame.camera.width);
      const int v1 = std::min((y + 1) * f, frame.camera.height);
      int sum[3] = {0, 0, 0}, pixels = 0, with_depth = 0, brightest = 0;
      std::int64_t depth = 0;
      for (int v = y * f; v < v1; ++v) {
        const std::uint8_t* p = frame.colour.ptr(v) + 3 * x * f;
        const std::uint16_t* d = frame.depth.ptr<std::uint16_t>(v) + x * f;
        for (int u = x * f; u < u1; ++u, p += 3, ++d) {
          for (int c = 0; c < 3; ++c) {
            sum[c] += p[c];
            brightest = std::max<int>(brightest, p[c]);
          }
          ++pixels;
          depth += *d;
          with_depth += *d != 0;
        }
      }
      const std::size_t i = static_cast<std::size_t>(y) * cells.width + x;
      for (int c = 0; c < 3; ++c)
        cells.colour[i][c] = static_cast<std::uint8_t>((sum[c] + pixels / 2) / pixels);
      if (2 * with_depth >= pixels)
        cells.z_m[i] = static_cast<double>(depth) / with_depth * frame.depth_unit_m;
      else
        cells.seen[i] = with_depth > 0 || brightest > 3;
    }
  }
  return cells;
}

/// Heights above the table in micrometres, each the mean of 3x3 cells; kNoHeight where the cell has
/// no depth.
std::vector<int> cell_heights_um(const Cells& cells, const TableSurface& surface) {
  std::vector<int> raw(cells.z_m.size(), kNoHeight);
  const double middle = 0.5 * (cells.factor - 1);
  for (int y = 0; y < cells.height; ++y) {
    for (int x = 0; x < cells.width; ++x) {
      const int i = y * cells.width + x;
      if (cells.z_m[i] == 0.0) continue;
      const double h_m =
          surface.height_m(x * cells.factor + middle, y * cells.factor + middle, cells.z_m[i]);
      if (std::abs(h_m) < 2.0) raw[i] = static_cast<int>(h_m * 1e6 + (h_m < 0.0 ? -0.5 : 0.5));
    }
  }
  std::vector<int> heights(raw.size(), kNoHeight);
  // Sums of three rows, column by column, then of three columns.
  std::vector<int> sums(static_cast<std::size_t>(cells.width) + 2, 0), counts(sums);
  for (int y = 0; y < cells.height; ++y) {
    std::fill(sums.begin(), sums.end(), 0);
    std::fill(counts.begin(), counts.end(), 0);
    for (int yy = std::max(0, y - 1); yy <= std::min(cells.height - 1, y + 1); ++yy) {
      const int* row = raw.data() + static_cast<std::ptrdiff_t>(yy) * cells.width;
      for (int x = 0; x < cells.width; ++x) {
        sums[x + 1] += row[x] == kNoHeight ? 0 : row[x];
        counts[x + 1] += row[x] != kNoHeight;
      }
    }
    for (int x = 0; x < cells.width; ++x) {
      const int i = y * cells.width + x;
      if (raw[i] != kNoHeight)
        heights[i] =
            (sums[x] + sums[x + 1] + sums[x + 2]) / (counts[x] + counts[x + 1] + counts[x + 2]);
    }
  }
  return heights;
}

/// Noise of the table: what lies below its surface is all noise.
int table_sigma_um(const std::vector<int>& heights_um) {
  std::vector<int> below;
  for (int h : heights_um)
    if (h != kNoHeight && h < 0 && h > kBelowTable_um) below.push_back(-h);
  if (below.empty()) return 2000;
  const auto middle = below.begin() + static_cast<std::ptrdiff_t>(below.size() / 2);
  std::nth_element(below.begin(), middle, below.end());
  return std::clamp(*middle * 3 / 2, 800, 20000);
}

/// Cloth of unknown thickness speaks for itself by its height; lying at the table's height says
/// less, for thin cloth does so too.
Votes depth_votes(const std::vector<int>& heights_um, int sigma_um, const SegmentOptions& options) {
  Votes votes(heights_um.size(), 0.0f);
  const auto middle = static_cast<float>(options.min_height_sigma * sigma_um);
  const float per_um = 1.25f / static_cast<float>(sigma_um);
  const auto weight = static_cast<float>(options.depth_weight);
  for (std::size_t i = 0; i < votes.size(); ++i) {
    if (heights_um[i] != kNoHeight)
      votes[i] =
          weight * std::clamp((static_cast<float>(heights_um[i]) - middle) * per_um, -1.5f, 2.5f);
  }
  return votes;
}

/// Divides the light out: the colour of the cells that votes call table is fitted by a quadratic
/// polynomial of the position (weighted least squares, what is far from it losing its weight), and
/// every colour divided by it. Light falls off towards the corners, and a dim corner is no garment.
std::vector<Colour> even_light(const Cells& cells, const Votes& votes) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  const double scale = 2.0 / cells.width;
  const auto powers = [&](int x, int y) {
    const double a = scale * x - 1.0, b = scale * y - 0.5 * scale * cells.height;
    Vector6 row;
    row << 1.0, a, b, a * a, a * b, b * b;
    return row;
  };
  Eigen::Matrix<double, 6, 3> light;
  for (int iteration = 0; iteration < 4; ++iteration) {
    Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 3> right = Eigen::Matrix<double, 6, 3>::Zero();
    for (int y = 2; y < cells.height; y += 6) {
      for (int x = 2; x < cells.width; x += 6) {
        const int i = y * cells.width + x;
        if (votes[i] >= 0.0f || !cells.seen[i]) continue;
        const Eigen::RowVector3d colour(cells.colour[i][0], cells.colour[i][1], cells.colour[i][2]);
        const Vector6 row = powers(x, y);
        double weight = 1.0;
        if (iteration > 0) {
          const double d = (colour - row.transpose() * light).squaredNorm() / (3.0 * 20.0 * 20.0);
          weight = 1.0 / ((1.0 + d) * (1.0 + d));
        }
        normal += weight * row * row.transpose();
        right += weight * row * colour;
      }
    }
    if (!(normal(0, 0) > 50.0)) return cells.colour;  // hardly any table in sight
    for (int k = 1; k < 6; ++k) normal(k, k) += 1.0;
    light = normal.ldlt().solve(right);
    if (!light.allFinite()) return cells.colour;
  }
  constexpr double kEven = 160.0;  // level of the table afterwards
  std::vector<Colour> even(cells.colour.size());
  constexpr int kBlock = 4;  // light changes slowly: one gain a block, of 256
  for (int by = 0; by < cells.height; by += kBlock) {
    for (int bx = 0; bx < cells.width; bx += kBlock) {
      const Eigen::RowVector3d here = powers(bx + kBlock / 2, by + kBlock / 2).transpose() * light;
      int gain[3];
      for (int c = 0; c < 3; ++c)
        gain[c] = static_cast<int>(std::clamp(kEven / std::max(here[c], 20.0), 0.25, 4.0) * 256.0);
      for (int y = by; y < std::min(by + kBlock, cells.height); ++y) {
        for (int x = bx; x < std::min(bx + kBlock, cells.width); ++x) {
          for (int c = 0; c < 3; ++c)
            even[y * cells.width + x][c] = static_cast<std::uint8_t>(
                std::min(255, (cells.colour[y * cells.width + x][c] * gain[c] + 128) >> 8));
        }
      }
    }
  }
  return even;
}

// Colour histogram: brightness, red - green and blue - green in 32 steps each.
constexpr int kSteps = 32;
constexpr std::size_t kBins = static_cast<std::size_t>(kSteps) * kSteps * kSteps;

std::vector<int> colour_bins(const std::vector<Colour>& colours) {
  std::vector<int> bins(colours.size());
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const auto [b, g, r] = colours[i];
    const int y = (r + 2 * g + b) / 4;
    const int rg = std::clamp(r - g + 64, 0, 127), bg = std::clamp(b - g + 64, 0, 127);
    bins[i] = (y / 8 * kSteps + rg / 4) * kSteps + bg / 4;
  }
  return bins;
}

/// Adds to each bin its neighbours along one axis, with weights 1 2 1.
void smooth_axis(std::vector<int>& histogram, int stride) {
  const int line = stride * kSteps;
  for (int base = 0; base < static_cast<int>(kBins); base += line) {
    for (int offset = 0; offset < stride; ++offset) {
      int* bin = &histogram[base + offset];
      int before = 0;
      for (int k = 0; k < kSteps; ++k, bin += stride) {
        const int here = *bin;
        *bin = before + 2 * here + (k + 1 < kSteps ? bin[stride] : 0);
        before = here;
      }
    }
  }
}

/// Log odds of each colour bin from how the cells' current odds share it out.
Votes colour_odds(const Cells& cells, const std::vector<int>& bins, const Votes& votes,
                  const SegmentOptions& options) {
  // In 64ths, for log odds of -4 to 4 in steps of an eighth
  std::array<int, 65> probability;
  for (int i = 0; i < 65; ++i)
    probability[i] = static_cast<int>(64.0 * det::logistic((i - 32) / 8.0) + 0.5);
  std::vector<int> garment(kBins, 0), table(kBins, 0);
  std::int64_t garment_sum = 0, table_sum = 0;
  for (std::size_t i = 0; i < bins.size(); ++i) {
    if (!cells.seen[i]) continue;
    const int p = probability[static_cast<int>(std::clamp(votes[i] * 8.0f, -32.0f, 32.0f) + 32.5f)];
    garment[bins[i]] += p;
    table[bins[i]] += 64 - p;
    garment_sum += p;
    table_sum += 64 - p;
  }
  for (std::vector<int>* histogram : {&garment, &table})
    for (int stride : {1, kSteps, kSteps * kSteps}) smooth_axis(*histogram, stride);
  // Likelihoods; smoothing multiplied the counts by 64. A bin that holds 0.02 % of a class says
  // little about it.
  const double g = 1.0 / (64.0 * static_cast<double>(garment_sum + 1));
  const double t = 1.0 / (64.0 * static_cast<double>(table_sum + 1));
  Votes odds(kBins, 0.0f);
  for (std::size_t k = 0; k < kBins; ++k) {
    if (garment[k] == 0 && table[k] == 0) continue;
    const double nats = det::log((garment[k] * g + 2e-4) / (table[k] * t + 2e-4));
    odds[k] = static_cast<float>(std::clamp(nats, -3.0, 3.0) * options.colour_weight);
  }
  return odds;
}

int colour_step(const Colour& a, const Colour& b) {
  int step = 0;
  for (int c = 0; c < 3; ++c) step = std::max(step, std::abs(a[c] - b[c]));
  return step;
}

/// Averages votes along rows, then columns, with weights that fall with every colour edge crossed
/// (the permeability filter of Cigla and Alatan, "Information permeability for stereo matching",
/// 2013).
class EdgeFilter {
 public:
  EdgeFilter(const Cells& cells, const std::vector<int>& heights_um, int sigma_um,
             const SegmentOptions& options)
      : width_(cells.width), height_(cells.height) {
    std::array<float, 256> colour_edge;
    for (int d = 0; d < 256; ++d) {
      const double r = d / options.edge_level;
      colour_edge[d] = static_cast<float>(r * r * r);
    }
    const auto per_um = static_cast<float>(1.0 / (options.edge_height_sigma * sigma_um));
    const auto most = static_cast<float>(1.0 - 1.0 / options.reach_cells);
    const auto likeness = [&](int i, int j) {
      if (!cells.seen[i] || !cells.seen[j]) return 0.0f;
      float h = 0.0f;
      if (heights_um[i] != kNoHeight && heights_um[j] != kNoHeight)
        h = static_cast<float>(std::abs(heights_um[i] - heights_um[j])) * per_um;
      return most / (1.0f + colour_edge[colour_step(cells.colour[i], cells.colour[j])] + h * h * h);
    };
    right_.assign(cells.colour.size(), 0.0f);
    down_.assign(cells.colour.size(), 0.0f);
    for (int y = 0; y < height_; ++y) {
      for (int x = 0; x < width_; ++x) {
        const int i = y * width_ + x;
        if (x + 1 < width_) right_[i] = likeness(i, i + 1);
        if (y + 1 < height_) down_[i] = likeness(i, i + width_);
      }
    }
    // The sums of the weights are the filter's answer to ones.
    for (Votes* inverse : {&inverse_rows_, &inverse_columns_}) inverse->assign(right_.size(), 1.0f);
    add_rows(inverse_rows_);
    add_columns(inverse_columns_);
    for (Votes* inverse : {&inverse_rows_, &inverse_columns_})
      for (float& value : *inverse) value = 1.0f / value;
  }

  void apply(Votes& votes) {
    add_rows(votes);
    for (std::size_t i = 0; i < votes.size(); ++i) votes[i] *= inverse_rows_[i];
    add_columns(votes);
    for (std::size_t i = 0; i < votes.size(); ++i) votes[i] *= inverse_columns_[i];
  }

 private:
  void add_rows(Votes& values) {
    before_.resize(values.size());
    for (int y = 0; y < height_; ++y) {
      float* row = &values[static_cast<std::size_t>(y) * width_];
      const float* pass = &right_[static_cast<std::size_t>(y) * width_];
      float sum = 0.0f;
      for (int x = 0; x < width_; ++x) {
        before_[x] = sum;
        sum = (sum + row[x]) * pass[x];
      }
      sum = 0.0f;
      for (int x = width_ - 1; x >= 0; --x) {
        const float here = row[x];
        row[x] = here + before_[x] + sum;
        if (x > 0) sum = (sum + here) * pass[x - 1];
      }
    }
  }
  void add_columns(Votes& values) {
    const auto w = static_cast<std::size_t>(width_);
    before_.assign(values.size(), 0.0f);
    after_.assign(w, 0.0f);
    for (std::size_t i = 0; i + w < values.size(); ++i)
      before_[i + w] = (before_[i] + values[i]) * down_[i];
    for (int y = height_ - 1; y >= 0; --y) {
      const std::size_t row = static_cast<std::size_t>(y) * w;
      for (std::size_t x = 0; x < w; ++x) {
        const float here = values[row + x];
        values[row + x] = here + before_[row + x] + after_[x];
        if (y > 0) after_[x] = (after_[x] + here) * down_[row - w + x];
      }
    }
  }

  int width_, height_;
  Votes right_, down_, inverse_rows_, inverse_columns_;
  Votes before_, after_;  // scratch
};

/// A connected set of cells.
struct Component {
  bool garment = false;
  bool at_border = false;
  std::vector<int> cells;
};

/// 4-connected components of the sign of the votes.
std::vector<Component> components(const Cells& cells, const Votes& votes) {
  std::vector<Component> found;
  std::vector<std::uint8_t> done(votes.size(), 0);
  for (int start = 0; start < cells.count(); ++start) {
    if (done[start]) continue;
    Component component;
    component.garment = votes[start] > 0.0f;
    component.cells.push_back(start);
    done[start] = 1;
    for (std::size_t k = 0; k < component.cells.size(); ++k) {
      const int i = component.cells[k], x = i % cells.width, y = i / cells.width;
      for (const auto& [dx, dy] : kNeighbours) {
        if (!cells.inside(x + dx, y + dy)) {
          component.at_border = true;
          continue;
        }
        const int j = i + dy * cells.width + dx;
        if (done[j] || (votes[j] > 0.0f) != component.garment) continue;
        done[j] = 1;
        component.cells.push_back(j);
      }
    }
    found.push_back(std::move(component));
  }
  return found;
}

class Segmenter {
 public:
  Segmenter(const rgbd::RgbdFrame& frame, const rgbd::Plane& table, const SegmentOptions& options)
      : frame_(frame), table_(table), options_(options), cells_(make_cells(frame)), filter_([&] {
          heights_um_ = cell_heights_um(cells_, fit_surface(frame, {}, table, 2));
          for (std::size_t i = 0; i < heights_um_.size(); ++i)
            if (heights_um_[i] != kNoHeight && heights_um_[i] < kBelowTable_um) cells_.seen[i] = 0;
          sigma_um_ = table_sigma_um(heights_um_);
          return EdgeFilter(cells_, heights_um_, sigma_um_, options);
        }()) {}

  cv::Mat run() {
    votes_ = depth_votes(heights_um_, sigma_um_, options_);
    filter_.apply(votes_);
    vote();
    // With the colour model the distortion can be fitted again where no cloth disturbs it.
    Votes colour(votes_.size());
    for (std::size_t i = 0; i < colour.size(); ++i) colour[i] = odds_[bins_[i]];
    filter_.apply(colour);
    heights_um_ = cell_heights_um(cells_, fit_surface(frame_, to_mask(colour), table_, 3));
    sigma_um_ = table_sigma_um(heights_um_);
    vote();
    clean();
    return to_mask(votes_);
  }

 private:
  void vote() {
    const Votes depth = depth_votes(heights_um_, sigma_um_, options_);
    bins_ = colour_bins(even_light(cells_, votes_));
    for (int iteration = 0; iteration < options_.iterations; ++iteration) {
      odds_ = colour_odds(cells_, bins_, votes_, options_);
      for (std::size_t i = 0; i < votes_.size(); ++i)
        votes_[i] = cells_.seen[i] ? depth[i] + odds_[bins_[i]] : -1.0f;
      filter_.apply(votes_);
    }
  }

  /// Takes away pieces that are no cloth and fills holes that are no table.
  void clean() {
    for (const Component& component : components(cells_, votes_))
      if (component.garment && !is_cloth(component))
        for (int i : component.cells) votes_[i] = -1.0f;
    for (const Component& component : components(cells_, votes_)) {
      if (component.garment || component.at_border) continue;
      float sum = 0.0f;
      for (int i : component.cells) sum += votes_[i];
      if (sum > -0.3f * static_cast<float>(component.cells.size()) ||
          area_cm2(component) <= options_.max_hole_cm2)
        for (int i : component.cells) votes_[i] = 1.0f;
    }
  }

  bool is_cloth(const Component& component) const {
    if (area_cm2(component) < options_.min_component_cm2) return false;
    std::int64_t height_um = 0;
    int with_height = 0;
    for (int i : component.cells) {
      if (heights_um_[i] != kNoHeight) {
        height_um += heights_um_[i];
        ++with_height;
      }
    }
    if (with_height == 0 ||
        static_cast<double>(height_um) < 1000.0 * options_.min_component_height_mm * with_height)
      return false;
    // The outline of cloth is an edge, in colour or in height (measured between 2 cells inside and
    // 4 cells outside); where the sensor's distortion ends, there is neither.
    std::int64_t step_um = 0;
    int steps = 0, outline = 0;
    double passes = 0.0;
    for (int i : component.cells) {
      const int x = i % cells_.width, y = i / cells_.width;
      for (const auto& [dx, dy] : kNeighbours) {
        if (!cells_.inside(x + dx, y + dy)) continue;
        const int j = i + dy * cells_.width + dx;
        if (votes_[j] > 0.0f || !cells_.seen[j]) continue;
        const double r = colour_step(cells_.colour[i], cells_.colour[j]) / options_.edge_level;
        passes += 1.0 / (1.0 + r * r * r);
        ++outline;
        if (!cells_.inside(x - 2 * dx, y - 2 * dy) || !cells_.inside(x + 4 * dx, y + 4 * dy))
          continue;
        const int inner = heights_um_[i - 2 * (dy * cells_.width + dx)];
        const int outer = heights_um_[i + 4 * (dy * cells_.width + dx)];
        if (inner == kNoHeight || outer == kNoHeight) continue;
        step_um += inner - outer;
        ++steps;
      }
    }
    if (outline == 0) return true;  // it fills the image
    const bool colour_edge = passes < options_.max_outline_passage * outline;
    const bool height_edge =
        steps > 0 && static_cast<double>(step_um) >
                         options_.min_outline_step_sigma * sigma_um_ * static_cast<double>(steps);
    return colour_edge || height_edge;
  }

  /// Area on the table: per unit of (x / z, y / z) it is distance^2 / |normal . ray|^3.
  double area_cm2(const Component& component) const {
    std::int64_t sum_x = 0, sum_y = 0;
    for (int i : component.cells) {
      sum_x += i % cells_.width;
      sum_y += i / cells_.width;
    }
    const double n = static_cast<double>(component.cells.size());
    const Eigen::Vector3d ray =
        frame_.camera.unproject((static_cast<double>(sum_x) / n + 0.5) * cells_.factor - 0.5,
                                (static_cast<double>(sum_y) / n + 0.5) * cells_.factor - 0.5, 1.0);
    const double across = std::max(0.1, -table_.normal.dot(ray));
    const double cell_m2 = table_.distance_m * table_.distance_m * cells_.factor * cells_.factor /
                           (frame_.camera.fx * frame_.camera.fy * across * across * across);
    return n * cell_m2 * 1e4;
  }

  /// Where the votes, interpolated bilinearly between the cells' centres, are for garment.
  cv::Mat to_mask(const Votes& votes) const {
    struct Tap {
      int first, second;
      float weight;  // of second
    };
    const auto taps = [&](int pixels, int count) {
      std::vector<Tap> result(static_cast<std::size_t>(pixels));
      for (int u = 0; u < pixels; ++u) {
        const float at = (static_cast<float>(u) + 0.5f) / static_cast<float>(cells_.factor) - 0.5f;
        const int first = std::clamp(static_cast<int>(at), 0, count - 1);
        result[u] = {first, std::min(first + 1, count - 1),
                     std::clamp(at - static_cast<float>(first), 0.0f, 1.0f)};
      }
      return result;
    };
    cv::Mat mask(frame_.camera.height, frame_.camera.width, CV_8UC1);
    const std::vector<Tap> across = taps(mask.cols, cells_.width);
    const std::vector<Tap> down = taps(mask.rows, cells_.height);
    std::vector<float> line(static_cast<std::size_t>(cells_.width));
    for (int v = 0; v < mask.rows; ++v) {
      const float* a = &votes[static_cast<std::size_t>(down[v].first) * cells_.width];
      const float* b = &votes[static_cast<std::size_t>(down[v].second) * cells_.width];
      for (int x = 0; x < cells_.width; ++x) line[x] = a[x] + (b[x] - a[x]) * down[v].weight;
      std::uint8_t* out = mask.ptr(v);
      for (int u = 0; u < mask.cols; ++u) {
        const float first = line[across[u].first], second = line[across[u].second];
        out[u] = first + (second - first) * across[u].weight > 0.0f ? 255 : 0;
      }
    }
    return mask;
  }

  const rgbd::RgbdFrame& frame_;
  const rgbd::Plane& table_;
  const SegmentOptions& options_;
  Cells cells_;
  std::vector<int> heights_um_, bins_;
  int sigma_um_ = 0;
  EdgeFilter filter_;
  Votes votes_, odds_;
};

}  // namespace

Foreground find_foreground(const rgbd::RgbdFrame& frame, const ForegroundOptions& options) {
  options.validate();
  const cv::Size size(frame.camera.width, frame.camera.height);
  const bool live = options.mode == Foreground::Source::kLive;
  if ((live && (frame.colour.type() != CV_8UC3 || frame.colour.size() != size)) ||
      frame.depth.type() != CV_16UC1 || frame.depth.size() != size)
    throw Error("segmentation needs 8 bit BGR colour and 16 bit depth of the camera's size");
  Foreground result;
  result.source = options.mode;
  if (!live) {
    if (frame.mask.type() != CV_8UC1 || frame.mask.size() != size)
      throw Error("frame '" + frame.source +
                  "' brings no mask; use a data set with masks, or mode: live");
    result.mask.create(size, CV_8UC1);
    for (int v = 0; v < size.height; ++v)
      std::transform(frame.mask.ptr(v), frame.mask.ptr(v) + size.width, result.mask.ptr(v),
                     [](std::uint8_t m) { return m ? 255 : 0; });
    result.table = find_table(frame, result.mask, options.table);
    return result;
  }
  result.table = find_table(frame, {}, options.table);
  if (!result.table) {
    result.mask = cv::Mat::zeros(size, CV_8UC1);
    return result;
  }
  result.mask = Segmenter(frame, *result.table, options.segment).run();
  result.table = refine_plane(frame, result.mask, *result.table);
  return result;
}

}  // namespace weft::foreground
