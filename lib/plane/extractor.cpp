#include "plane/extractor.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "base/error.hpp"
#include "plane/angle.hpp"
#include "plane/cell_kernel.hpp"
#include "plane/cylinder.hpp"
#include "plane/moments.hpp"

namespace weft::plane {
namespace {

constexpr int kBins = 20;  // of each coordinate of a normal
constexpr int kMaxSegments = 255;
constexpr int kFree = -1;
/// A cylinder must explain this many times as many cells as the plane around its seed.
constexpr double kCylinderGain = 1.3;
constexpr int kMinCylinderCells = 6;
/// Neighbouring cells of a cylinder may turn by this many times as much as those of a plane.
constexpr double kCylinderAngles = 2.0;
/// And its radius is at least this many cells: else an edge is one.
constexpr double kLeastRadius = 1.5;
/// A cylinder is fitted to every fifth pixel of every fifth row.
constexpr int kCylinderStep_px = 5;
/// Noise that a cell may be off a plane, and two planes off one, in standard deviations, beside the
/// margin. Planes more, as the sensor bends them.
constexpr double kGateSigmas = 3.0, kMergeSigmas = 4.0;
/// Of the margin that a plane's cells may be off it: how much a cell may be from flat, and two
/// planes from one.
constexpr double kFlatMargin = 0.3, kMergeMargin = 0.5;
/// Of a cell's pixels: what a segment must have to go on into the cells around it.
constexpr double kOfferShare = 0.25;
/// Pixels that a segment must get for each of its cells'.
constexpr double kLeastSupport = 0.6;
/// Least part of the noise that pixels at a segment's border are granted, however clean the rest.
constexpr double kLeastNoise = 0.5;

struct Cell {
  Moments moments;
  bool fitted = false;
  InversePlane plane = InversePlane::Zero();
  double mean_square = 0.0;  // of the residuals, 1/m^2
  double flatness = 0.0;     // the same in units of what a flat cell may have
  bool flat = false;         // the rest holds for flat cells only
  Eigen::Vector3d normal, centre;
  double gate_m = 0.0;  // distance of its points from a surface that may still be noise
  int bin = 0;
  int segment = kFree;
};

struct Segment {
  std::vector<int> cells;  // ascending
  Moments moments;
  InversePlane plane = InversePlane::Zero();  // of planes
  bool is_cylinder = false;
  Cylinder cylinder;
  double rms_m = 0.0;         // of cylinders
  double border_per_m = 0.0;  // pixels up to this far off in inverse depth belong to it
  int support = 0;
  bool alive = true;
};

/// Pixels of a cell by segment.
struct Shares {
  std::vector<int> segments, pixels;
};

class Grid {
 public:
  Grid(const rgbd::RgbdFrame& frame, const ExtractorOptions& options, const CellKernel& kernel)
      : frame_(frame), camera_(frame.camera), options_(options), kernel_(kernel) {
    columns_ = (camera_.width + options.cell_px - 1) / options.cell_px;
    rows_ = (camera_.height + options.cell_px - 1) / options.cell_px;
    cells_.resize(static_cast<std::size_t>(columns_) * rows_);
    stamps_.resize(cells_.size(), 0);
    const auto counts = [&](double depth_m) {
      return static_cast<std::uint32_t>(
          std::clamp(std::ceil(depth_m / frame.depth_unit_m), 1.0, 65535.0));
    };
    code_.nearest = counts(options.min_depth_m);
    code_.span = std::max(code_.nearest, counts(options.max_depth_m)) - code_.nearest;
    code_.steps =
        static_cast<float>(1 << InverseDepthCode::kBits) * static_cast<float>(code_.nearest);
    unit_per_m_ = 1.0 / (static_cast<double>(code_.steps) * frame.depth_unit_m);
    min_cos_ = cos_degrees(options.max_angle_deg);
  }

  void fit_cells() {
    const int whole = camera_.width / 8, blocks = (camera_.width + 7) / 8;
    std::vector<ColumnSums> sums(static_cast<std::size_t>(blocks));
    std::array<std::uint16_t, 8 * CellKernel::kMaxCell> tail{};
    for (int row = 0; row < rows_; ++row) {
      const int top = row * options_.cell_px;
      const int height = std::min(options_.cell_px, camera_.height - top);
      const auto* depth = frame_.depth.ptr<std::uint16_t>(top);
      const auto stride = static_cast<std::ptrdiff_t>(frame_.depth.step1());
      kernel_.columns(code_, depth, stride, height, whole, sums.data());
      if (blocks > whole) {
        for (int v = 0; v < height; ++v)
          std::copy(depth + v * stride + 8 * whole, depth + v * stride + camera_.width,
                    tail.begin() + 8 * v);
        kernel_.columns(code_, tail.data(), 8, height, 1, &sums.back());
      }
      for (int column = 0; column < columns_; ++column) fit_cell(column, row, height, sums.data());
    }
    noise_per_m_ = measure_noise();
    for (Cell& cell : cells_)
      if (cell.fitted) judge(cell);
  }

  void find_segments() {
    std::array<std::vector<int>, kBins * kBins> bins;
    std::vector<bool> tried(cells_.size(), false);
    for (int i = 0; i < static_cast<int>(cells_.size()); ++i)
      if (cells_[i].flat) bins[cells_[i].bin].push_back(i);
    while (true) {
      auto& fullest = *std::max_element(bins.begin(), bins.end(),
                                        [](auto& a, auto& b) { return a.size() < b.size(); });
      if (fullest.empty()) break;
      const int seed = *std::min_element(fullest.begin(), fullest.end(), [&](int a, int b) {
        return cells_[a].flatness < cells_[b].flatness;
      });
      Segment found = grow_plane(seed);
      if (options_.cylinders) {
        if (auto cylinder = try_cylinder(seed, found.cells.size())) found = std::move(*cylinder);
      }
      if (static_cast<int>(found.cells.size()) < options_.min_cells) {
        for (const int i : found.cells) tried[i] = true;
      } else {
        for (const int i : found.cells) cells_[i].segment = static_cast<int>(segments_.size());
        segments_.push_back(std::move(found));
      }
      for (auto& bin : bins)
        std::erase_if(bin, [&](int i) { return tried[i] || cells_[i].segment != kFree; });
    }
  }

  /// Merges planes, the two that fit each other best first.
  void merge_planes() {
    while (true) {
      double best = 1.0;
      std::size_t into = 0, from = 0;
      for (std::size_t a = 0; a < segments_.size(); ++a)
        for (std::size_t b = a + 1; b < segments_.size(); ++b) {
          const double misfit = misfit_of(segments_[a], segments_[b]);
          if (misfit < best &&
              (options_.merge_apart || touch(static_cast<int>(a), static_cast<int>(b)))) {
            best = misfit;
            into = a;
            from = b;
          }
        }
      if (!(best < 1.0)) return;
      Segment& a = segments_[into];
      const Segment& b = segments_[from];
      a.cells.insert(a.cells.end(), b.cells.begin(), b.cells.end());
      std::sort(a.cells.begin(), a.cells.end());
      a.moments += b.moments;
      a.plane = *a.moments.fit();
      segments_.erase(segments_.begin() + static_cast<std::ptrdiff_t>(from));
      own_cells();
    }
  }

  /// Planes before cylinders, of each the largest first, at most 255.
  Extraction label_pixels() {
    order_segments([](const Segment& s) { return s.cells.size(); });
    for (Segment& segment : segments_) {
      const double least = kLeastNoise * noise_per_m_;
      const double z_m = segment.moments.n / segment.moments.d;
      const double square = segment.is_cylinder
                                ? segment.rms_m * segment.rms_m / (z_m * z_m * z_m * z_m)
                                : segment.moments.mean_square(segment.plane);
      // On a surface without noise, a count of depth.
      const double count = frame_.depth_unit_m / (z_m * z_m) + unit_per_m_;
      segment.border_per_m = options_.border_sigmas * std::sqrt(square + least * least) + count;
    }
    cv::Mat labels(camera_.height, camera_.width, CV_8UC1, cv::Scalar(0));
    shares_.assign(cells_.size(), {});
    // Cells across an edge look like a plane of their own, until their pixels go to the two
    // surfaces that meet there.
    for (bool weak = true; weak;) {
      spread_labels(labels);
      weak = false;
      for (Segment& s : segments_)
        if (s.alive && s.support < kLeastSupport * s.moments.n) {
          s.alive = false;
          weak = true;
        }
    }
    const std::vector<int> place = order_segments([](const Segment& s) { return s.support; });
    std::array<std::uint8_t, kMaxSegments + 1> table{};
    bool moved = false;
    for (std::size_t s = 0; s < place.size(); ++s) {
      table[s + 1] = static_cast<std::uint8_t>(place[s] + 1);
      moved |= place[s] != static_cast<int>(s);
    }
    if (moved)
      for (int v = 0; v < labels.rows; ++v) {
        auto* at = labels.ptr<std::uint8_t>(v);
        for (int u = 0; u < labels.cols; ++u) at[u] = table[at[u]];
      }
    Extraction out;
    out.labels = labels;
    for (const Segment& segment : segments_) {
      if (segment.is_cylinder)
        out.cylinders.push_back(cylinder_segment(segment));
      else
        out.planes.push_back(plane_segment(segment));
    }
    return out;
  }

 private:
  /// Labels pixels in and around the segments' cells, and counts them. A cell offers its neighbours
  /// its own segment; if it has none, those with a good part of its pixels, until no cell hears of
  /// another. Only cells that hear of others than before are labelled again.
  void spread_labels(cv::Mat& labels) {
    const double least_px = kOfferShare * options_.cell_px * options_.cell_px;
    std::vector<std::vector<int>> offers(cells_.size());
    const auto offer = [&](int i) {
      if (is_owned(cells_[i])) return;
      for (std::size_t k = 0; k < shares_[i].segments.size(); ++k) {
        const int s = shares_[i].segments[k];
        if (segments_[s].alive && shares_[i].pixels[k] > least_px &&
            std::find(offers[i].begin(), offers[i].end(), s) == offers[i].end())
          offers[i].push_back(s);
      }
    };
    for (int i = 0; i < static_cast<int>(cells_.size()); ++i) {
      if (is_owned(cells_[i])) offers[i] = {cells_[i].segment};
      offer(i);
    }
    std::vector<int> changed;
    for (bool first = true; first || !changed.empty(); first = false) {
      changed.clear();
      for (int i = 0; i < static_cast<int>(cells_.size()); ++i) {
        if (!first && is_owned(cells_[i])) continue;
        auto candidates = offered_to(i, offers);
        if (candidates == shares_[i].segments) continue;
        changed.push_back(i);
        shares_[i] = label_cell(i, std::move(candidates), labels);
      }
      for (const int i : changed) offer(i);
    }
    for (Segment& segment : segments_) segment.support = 0;
    for (const Shares& share : shares_)
      for (std::size_t k = 0; k < share.segments.size(); ++k)
        segments_[share.segments[k]].support += share.pixels[k];
  }

  bool is_owned(const Cell& cell) const {
    return cell.segment != kFree && segments_[cell.segment].alive;
  }

  void own_cells() {
    for (auto& cell : cells_) cell.segment = kFree;
    for (std::size_t s = 0; s < segments_.size(); ++s)
      for (const int i : segments_[s].cells) cells_[i].segment = static_cast<int>(s);
  }

  /// The segments that a cell and its eight neighbours offer, ascending.
  std::vector<int> offered_to(int i, const std::vector<std::vector<int>>& offers) const {
    const int row = i / columns_, column = i % columns_;
    std::vector<int> all;
    for (int r = std::max(0, row - 1); r <= std::min(rows_ - 1, row + 1); ++r)
      for (int c = std::max(0, column - 1); c <= std::min(columns_ - 1, column + 1); ++c)
        for (const int s : offers[index(c, r)])
          if (std::find(all.begin(), all.end(), s) == all.end()) all.push_back(s);
    std::sort(all.begin(), all.end());
    if (all.size() > CellKernel::kMaxPlanes) all.resize(CellKernel::kMaxPlanes);
    return all;
  }

  /// Gives each pixel of a cell to the nearest of the candidates within its gate.
  Shares label_cell(int i, std::vector<int> candidates, cv::Mat& labels) const {
    const int left = i % columns_ * options_.cell_px, top = i / columns_ * options_.cell_px;
    const int width = std::min(options_.cell_px, camera_.width - left);
    const int height = std::min(options_.cell_px, camera_.height - top);
    // Planes are ordered before cylinders.
    std::array<CellPlane, CellKernel::kMaxPlanes> planes;
    int plane_count = 0;
    const double x = (left - camera_.cx) / camera_.fx, y = (top - camera_.cy) / camera_.fy;
    for (const int s : candidates) {
      if (segments_[s].is_cylinder) break;
      const InversePlane p = segments_[s].plane / unit_per_m_;
      planes[plane_count++] = {static_cast<float>(p.x() * x + p.y() * y + p.z()),
                               static_cast<float>(p.x() / camera_.fx),
                               static_cast<float>(p.y() / camera_.fy),
                               static_cast<float>(segments_[s].border_per_m / unit_per_m_), s + 1};
    }
    const bool with_cylinders = plane_count < static_cast<int>(candidates.size());
    Shares shares;
    shares.pixels.resize(candidates.size());
    std::array<float, CellKernel::kMaxCell * CellKernel::kMaxCell> distances;
    kernel_.label(code_, frame_.depth.ptr<std::uint16_t>(top) + left,
                  static_cast<std::ptrdiff_t>(frame_.depth.step1()), width, height, planes.data(),
                  plane_count, labels.ptr<std::uint8_t>(top) + left,
                  static_cast<std::ptrdiff_t>(labels.step1()), shares.pixels.data(),
                  with_cylinders ? distances.data() : nullptr);
    if (with_cylinders) {
      std::array<int, kMaxSegments + 1> count{};
      for (int v = 0; v < height; ++v)
        for (int u = 0; u < width; ++u) {
          auto& label = labels.at<std::uint8_t>(top + v, left + u);
          nearest_cylinder(candidates, plane_count, left + u, top + v,
                           distances[v * CellKernel::kMaxCell + u], label);
          ++count[label];
        }
      for (std::size_t k = 0; k < candidates.size(); ++k)
        shares.pixels[k] = count[candidates[k] + 1];
    }
    shares.segments = std::move(candidates);
    return shares;
  }

  /// Gives a pixel at `distance` (units of the code) from its plane to a cylinder that is nearer.
  void nearest_cylinder(const std::vector<int>& candidates, int first, int u, int v, float distance,
                        std::uint8_t& label) const {
    const std::uint32_t counts = frame_.depth.at<std::uint16_t>(v, u);
    if (counts - code_.nearest > code_.span) return;
    const double z_m = counts * frame_.depth_unit_m;
    const Eigen::Vector3d point = camera_.unproject(u, v, z_m);
    double best = static_cast<double>(distance) * unit_per_m_;
    for (auto s = candidates.begin() + first; s != candidates.end(); ++s) {
      const double off = std::abs(segments_[*s].cylinder.height_m(point)) / (z_m * z_m);
      if (!(off <= segments_[*s].border_per_m && off < best)) continue;
      best = off;
      label = static_cast<std::uint8_t>(*s + 1);
    }
  }

  int index(int column, int row) const { return row * columns_ + column; }

  template <class Visit>
  void for_neighbours(int i, const Visit& visit) const {
    const int column = i % columns_;
    if (i >= columns_) visit(i - columns_);
    if (column > 0) visit(i - 1);
    if (column + 1 < columns_) visit(i + 1);
    if (i + columns_ < static_cast<int>(cells_.size())) visit(i + columns_);
  }

  void fit_cell(int column, int row, int height, const ColumnSums* sums) {
    Cell& cell = cells_[index(column, row)];
    const int left = column * options_.cell_px;
    const int width = std::min(options_.cell_px, camera_.width - left);
    // Whole numbers below 2^53, so exact: u, v from the cell's corner, rows counted from the end.
    double n = 0, u1 = 0, u2 = 0, w1 = 0, w2 = 0, uw = 0, d = 0, ud = 0, wd = 0, dd = 0;
    for (int u = 0; u < width; ++u) {
      const ColumnSums& block = sums[(left + u) / 8];
      const int k = (left + u) % 8;
      n += block.n[k];
      u1 += static_cast<double>(u) * block.n[k];
      u2 += static_cast<double>(u * u) * block.n[k];
      w1 += block.nw[k];
      w2 += 2.0 * block.nww[k] - block.nw[k];
      uw += static_cast<double>(u) * block.nw[k];
      d += block.d[k];
      ud += static_cast<double>(u) * block.d[k];
      wd += block.dw[k];
      dd += block.dd[k];
    }
    if (2 * width < options_.cell_px || 2 * height < options_.cell_px ||
        n < options_.min_valid_share * width * height || n < 4.0)
      return;
    // x = x0 + u / fx, y = y0 - w / fy.
    const double fx = 1.0 / camera_.fx, fy = -1.0 / camera_.fy;
    const double x0 = (left - camera_.cx) * fx;
    const double y0 = (row * options_.cell_px + height - camera_.cy) / camera_.fy;
    Moments& m = cell.moments;
    m.n = n;
    m.x = n * x0 + fx * u1;
    m.y = n * y0 + fy * w1;
    m.xx = n * x0 * x0 + 2.0 * x0 * fx * u1 + fx * fx * u2;
    m.yy = n * y0 * y0 + 2.0 * y0 * fy * w1 + fy * fy * w2;
    m.xy = n * x0 * y0 + x0 * fy * w1 + y0 * fx * u1 + fx * fy * uw;
    m.d = d * unit_per_m_;
    m.xd = (x0 * d + fx * ud) * unit_per_m_;
    m.yd = (y0 * d + fy * wd) * unit_per_m_;
    m.dd = dd * unit_per_m_ * unit_per_m_;
    const auto plane = m.fit();
    if (!plane) return;
    cell.fitted = true;
    cell.plane = *plane;
    cell.mean_square = m.mean_square(*plane);
  }

  /// The noise of the quieter cells, those without edges, but no more than the sensor's.
  double measure_noise() const {
    std::vector<double> squares;
    for (const Cell& cell : cells_)
      if (cell.fitted) squares.push_back(cell.mean_square);
    if (squares.empty()) return options_.noise_per_m;
    const auto quarter = squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 4);
    std::nth_element(squares.begin(), quarter, squares.end());
    return std::min(options_.noise_per_m, std::sqrt(*quarter));
  }

  void judge(Cell& cell) const {
    const Moments& m = cell.moments;
    const InversePlane& plane = cell.plane;
    const double gate = gate_per_m(m, plane, kGateSigmas, kFlatMargin);
    cell.flatness = cell.mean_square / (gate * gate);
    const double norm = plane.norm();
    const Eigen::Vector3d ray(m.x / m.n, m.y / m.n, 1.0);
    // Seen edge on, or from behind: the fit follows a depth jump.
    if (!(cell.flatness <= 1.0) || !(plane.dot(ray) > 0.02 * norm * ray.norm())) return;
    cell.flat = true;
    cell.normal = -plane / norm;
    cell.centre = m.centre(plane);
    cell.gate_m = gate * cell.centre.z() / norm;
    // Stereographic projection: no pole where normals point to the camera.
    const auto bin = [&](double v) {
      return std::clamp(static_cast<int>((v / (1.0 - cell.normal.z()) + 1.0) * (0.5 * kBins)), 0,
                        kBins - 1);
    };
    cell.bin = bin(cell.normal.y()) * kBins + bin(cell.normal.x());
  }

  /// What the root mean square residual of pixels may be, 1/m: a height h above the plane is
  /// h |p| / z of inverse depth.
  double gate_per_m(const Moments& m, const InversePlane& plane, double sigmas,
                    double margins) const {
    return sigmas * noise_per_m_ + margins * options_.margin_m * plane.norm() * m.d / m.n;
  }

  bool fits(const Cell& cell, const InversePlane& plane) const {
    if (-cell.normal.dot(plane) < min_cos_ * plane.norm()) return false;
    const double gate = gate_per_m(cell.moments, plane, kGateSigmas, 1.0);
    return cell.moments.mean_square(plane) <= gate * gate;
  }

  /// Whether the surface goes on from one cell to the next.
  bool smooth(const Cell& a, const Cell& b, double min_cos) const {
    if (a.normal.dot(b.normal) < min_cos) return false;
    const Eigen::Vector3d step = b.centre - a.centre;
    const double reach_m = std::sqrt(1.0 - min_cos * min_cos) * step.norm();
    return std::abs(a.normal.dot(step)) <= reach_m + a.gate_m &&
           std::abs(b.normal.dot(step)) <= reach_m + b.gate_m;
  }

  /// Cells reached from the seed over free, flat, accepted neighbours, layer by layer; ascending.
  template <class Accept, class LayerDone>
  std::vector<int> flood(int seed, const Accept& accept, const LayerDone& layer_done) {
    ++stamp_;
    std::vector<int> reached = {seed}, next;
    stamps_[seed] = stamp_;
    for (std::size_t begin = 0; begin < reached.size();) {
      const std::size_t end = reached.size();
      for (std::size_t k = begin; k < end; ++k)
        for_neighbours(reached[k], [&](int j) {
          const Cell& cell = cells_[j];
          if (stamps_[j] == stamp_ || !cell.flat || cell.segment != kFree ||
              !accept(cells_[reached[k]], cell))
            return;
          stamps_[j] = stamp_;
          reached.push_back(j);
        });
      layer_done(reached, end);
      begin = end;
    }
    std::sort(reached.begin(), reached.end());
    return reached;
  }

  /// The plane around a seed: grown with the plane of what it has so far, then twice again with the
  /// plane of the whole.
  Segment grow_plane(int seed) {
    Segment segment;
    segment.plane = cells_[seed].plane;
    Moments sum = cells_[seed].moments;
    segment.cells = flood(
        seed,
        [&](const Cell& from, const Cell& to) {
          return smooth(from, to, min_cos_) && fits(to, segment.plane);
        },
        [&](const std::vector<int>& reached, std::size_t begin) {
          for (std::size_t k = begin; k < reached.size(); ++k) sum += cells_[reached[k]].moments;
          segment.plane = sum.fit().value_or(segment.plane);
        });
    for (int round = 0; round < 2; ++round) {
      auto again = flood(
          seed, [&](const Cell&, const Cell& to) { return fits(to, segment.plane); },
          [](const std::vector<int>&, std::size_t) {});
      if (again == segment.cells) break;
      segment.cells = std::move(again);
      refit(segment);
    }
    refit(segment);
    return segment;
  }

  void refit(Segment& segment) const {
    segment.moments = Moments();
    for (const int i : segment.cells) segment.moments += cells_[i].moments;
    segment.plane = segment.moments.fit().value_or(segment.plane);
  }

  void add_pixels(int i, std::vector<Eigen::Vector3d>& points) const {
    const int left = i % columns_ * options_.cell_px, top = i / columns_ * options_.cell_px;
    for (int v = top; v < std::min(top + options_.cell_px, camera_.height); v += kCylinderStep_px)
      for (int u = left; u < std::min(left + options_.cell_px, camera_.width);
           u += kCylinderStep_px) {
        const std::uint32_t counts = frame_.depth.at<std::uint16_t>(v, u);
        if (counts - code_.nearest > code_.span) continue;
        points.push_back(camera_.unproject(u, v, counts * frame_.depth_unit_m));
      }
  }

  std::optional<Segment> try_cylinder(int seed, std::size_t plane_cells) {
    const double min_cos = cos_degrees(kCylinderAngles * options_.max_angle_deg);
    const std::vector<int> region = flood(
        seed, [&](const Cell& from, const Cell& to) { return smooth(from, to, min_cos); },
        [](const std::vector<int>&, std::size_t) {});
    const auto enough = static_cast<int>(
        std::max<double>({kCylinderGain * static_cast<double>(plane_cells), kMinCylinderCells,
                          static_cast<double>(options_.min_cells)}));
    if (static_cast<int>(region.size()) < enough) return std::nullopt;
    std::vector<OrientedPoint> points;
    for (const int i : region)
      points.push_back({cells_[i].centre, cells_[i].normal, cells_[i].gate_m});
    const auto fit = fit_cylinder(points, enough, options_.max_radius_m, options_.max_angle_deg,
                                  options_.min_arc_deg, static_cast<std::uint64_t>(seed));
    if (!fit) return std::nullopt;
    Segment segment;
    segment.is_cylinder = true;
    segment.cylinder = fit->cylinder;
    std::vector<Eigen::Vector3d> pixels;
    for (const int k : fit->inliers) {
      segment.cells.push_back(region[k]);
      segment.moments += cells_[region[k]].moments;
      add_pixels(region[k], pixels);
    }
    segment.rms_m = refine_cylinder(pixels, segment.cylinder);
    const double cell_m =
        options_.cell_px / std::min(camera_.fx, camera_.fy) * segment.moments.n / segment.moments.d;
    if (!(segment.cylinder.radius_m <= options_.max_radius_m &&
          segment.cylinder.radius_m >= kLeastRadius * cell_m))
      return std::nullopt;
    return segment;
  }

  /// Below 1 when one plane explains both about as well as each explains itself.
  double misfit_of(const Segment& a, const Segment& b) const {
    constexpr double kNever = 2.0;
    if (a.is_cylinder || b.is_cylinder) return kNever;
    if (a.plane.dot(b.plane) < min_cos_ * a.plane.norm() * b.plane.norm()) return kNever;
    Moments both = a.moments;
    both += b.moments;
    const auto plane = both.fit();
    if (!plane) return kNever;
    double worst = 0.0;
    for (const Segment* s : {&a, &b}) {
      const double gate = gate_per_m(s->moments, *plane, kMergeSigmas, kMergeMargin);
      const double excess = s->moments.mean_square(*plane) - s->moments.mean_square(s->plane);
      worst = std::max(worst, excess / (gate * gate));
    }
    return worst;
  }

  bool touch(int a, int b) const {
    bool found = false;
    for (const int i : segments_[a].cells)
      for_neighbours(i, [&](int j) { found |= cells_[j].segment == b; });
    return found;
  }

  /// Sorts the segments and says where each went; dead ones and those beyond the 255th go.
  template <class Size>
  std::vector<int> order_segments(const Size& size) {
    std::vector<int> order(segments_.size());
    for (std::size_t s = 0; s < order.size(); ++s) order[s] = static_cast<int>(s);
    std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
      if (segments_[a].alive != segments_[b].alive) return segments_[a].alive;
      if (segments_[a].is_cylinder != segments_[b].is_cylinder) return segments_[b].is_cylinder;
      return size(segments_[a]) > size(segments_[b]);
    });
    std::vector<int> place(order.size());
    std::vector<Segment> sorted;
    for (std::size_t s = 0; s < order.size(); ++s) {
      place[order[s]] = static_cast<int>(s);
      sorted.push_back(std::move(segments_[order[s]]));
    }
    std::erase_if(sorted, [](const Segment& s) { return !s.alive; });
    if (sorted.size() > kMaxSegments) sorted.resize(kMaxSegments);
    segments_ = std::move(sorted);
    own_cells();
    return place;
  }

  PlaneSegment plane_segment(const Segment& segment) const {
    const Moments& m = segment.moments;
    const InversePlane& p = segment.plane;
    PlaneSegment out;
    out.plane = hesse(p);
    out.plane.support = segment.support;
    out.cells = static_cast<int>(segment.cells.size());
    double squares = 0.0;
    for (const int i : segment.cells) {
      const Moments& cell = cells_[i].moments;
      squares += cell.n * cell.mean_square_m(p);
      out.points_camera.push_back(cell.centre(p).cast<float>());
    }
    out.plane.rms_m = std::sqrt(squares / m.n);
    // Least squares' covariance of p, a cell counting as one pixel; then n = -p / |p|, distance =
    // -1 / |p|.
    const double variance = m.mean_square(p) * m.n / (m.n - 3.0);
    const Eigen::Matrix3d covariance_p = variance * m.n / out.cells * m.information().inverse();
    const auto [e0, e1] = tangent_basis(out.plane.normal);
    const double norm = p.norm();
    Eigen::Matrix3d jacobian;
    jacobian << -e0.transpose() / norm, -e1.transpose() / norm,
        -out.plane.normal.transpose() / (norm * norm);
    const Eigen::Matrix3d covariance = jacobian * covariance_p * jacobian.transpose();
    out.covariance = 0.5 * (covariance + covariance.transpose());
    return out;
  }

  CylinderSegment cylinder_segment(const Segment& segment) const {
    CylinderSegment out;
    const Cylinder& c = segment.cylinder;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const int i : segment.cells) {
      sum += cells_[i].centre;
      out.points_camera.push_back(cells_[i].centre.cast<float>());
    }
    out.cells = static_cast<int>(segment.cells.size());
    int largest;
    c.axis.cwiseAbs().maxCoeff(&largest);
    out.axis = c.axis[largest] < 0.0 ? Eigen::Vector3d(-c.axis) : c.axis;
    out.point_camera = c.point + c.axis * c.axis.dot(sum / out.cells - c.point);
    out.radius_m = c.radius_m;
    out.convex = c.convex;
    out.rms_m = segment.rms_m;
    out.support = segment.support;
    return out;
  }

  const rgbd::RgbdFrame& frame_;
  const rgbd::CameraModel& camera_;
  const ExtractorOptions& options_;
  const CellKernel& kernel_;
  InverseDepthCode code_;
  double unit_per_m_;         // 1/m of one step of the code
  double noise_per_m_ = 0.0;  // of this image
  double min_cos_;
  int columns_, rows_;
  std::vector<Cell> cells_;  // row by row
  std::vector<Segment> segments_;
  std::vector<Shares> shares_;  // of each cell, by the segments it heard of
  std::vector<int> stamps_;     // of the flood that reached a cell last
  int stamp_ = 0;
};

const CellKernel& kernel_of([[maybe_unused]] SimdPath path) {
#if defined(__x86_64__)
  if (path == SimdPath::kAvx2) return kCellAvx2;
#endif
  return kCellBaseline;
}

}  // namespace

void ExtractorOptions::validate() const {
  validate_fields(*this, "ExtractorOptions");
  if (!(min_depth_m < max_depth_m))
    throw Error("ExtractorOptions: min_depth_m must be below max_depth_m");
}

Extractor::Extractor(const ExtractorOptions& options, SimdPath path)
    : options_(options), path_(resolve_simd_path(path)) {
  options_.validate();
}

Extraction Extractor::extract(const rgbd::RgbdFrame& frame) const {
  frame.camera.validate("plane extraction: camera");
  if (frame.depth.type() != CV_16UC1 || frame.depth.cols != frame.camera.width ||
      frame.depth.rows != frame.camera.height)
    throw Error("plane extraction: the depth image is not 16 bit or not of the camera's size");
  if (!(frame.depth_unit_m > 0.0 && frame.depth_unit_m <= 1.0))
    throw Error("plane extraction: a depth unit of " + std::to_string(frame.depth_unit_m) + " m");
  Grid grid(frame, options_, kernel_of(path_));
  grid.fit_cells();
  grid.find_segments();
  grid.merge_planes();
  return grid.label_pixels();
}

}  // namespace weft::plane
