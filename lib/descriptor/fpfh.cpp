#include "descriptor/fpfh.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <span>
#include <thread>

#include "base/error.hpp"
#include "base/parallel.hpp"
#include "descriptor/fpfh_kernel.hpp"

namespace weft::descriptor {
namespace {

constexpr int kChunk = kFpfhGroups * kFpfhGroup;
constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();

const FpfhKernel& kernel_of([[maybe_unused]] SimdPath path) {
#if defined(__x86_64__)
  if (path == SimdPath::kAvx2) return kFpfhAvx2;
#endif
  return kFpfhBaseline;
}

int thread_count(int threads) {
  return threads < 1 ? static_cast<int>(std::max(1u, std::thread::hardware_concurrency()))
                     : threads;
}

// Columns first ... last of a row, none when first > last.
struct Span {
  int first = std::numeric_limits<int>::max(), last = -1;
  bool empty() const { return first > last; }
  void add(int from, int to) {
    first = std::min(first, from);
    last = std::max(last, to);
  }
  int first_group() const { return empty() ? 0 : first / kFpfhGroup; }
  int end_group() const { return empty() ? 0 : last / kFpfhGroup + 1; }
};
using Spans = std::vector<Span>;  // one a row

// Where the neighbours of a surface's points can be in its image.
//
// The distance of a point from another's line of sight is its z times sqrt(dm^2 + dn^2) at least,
// divided by sqrt(1 + m^2 + n^2) of that line; m = x / z, n = y / z and their differences follow
// from the pixels. Neighbours within the radius r of a point therefore differ from it by at most
// its reach, r sqrt(1 + m^2 + n^2) / (z - r).
class Neighbourhoods {
 public:
  Neighbourhoods(const rgbd::Surface& surface, double radius_m, int threads)
      : surface_(surface),
        radius_m_(radius_m),
        groups_((width() + kChunk - 1) / kChunk * kFpfhGroups),
        group_reach_(static_cast<std::size_t>(groups_) * static_cast<std::size_t>(height()),
                     -1.0f) {
    const auto& camera = surface.camera;
    const auto square = [](double v) { return v * v; };
    const double corner = square(std::max(camera.cx, width() - camera.cx) / camera.fx) +
                          square(std::max(camera.cy, height() - camera.cy) / camera.fy);
    // An ellipse of half axes a and b px holds fewer than pi (a + 1) (b + 1) pixels.
    constexpr double kMaxReach_px = 143.0;  // pi 144^2 < 65536
    nearest_m_ = static_cast<float>(
        radius_m * (1.0 + std::sqrt(1.0 + corner) * std::max(camera.fx, camera.fy) / kMaxReach_px));
    parallel_for(height(), threads, [&](int begin, int end) {
      for (int y = begin; y < end; ++y) measure(y);
    });
    const double farthest2 = square(farthest());
    // Points may lie a little off their pixel's centre.
    const auto gaps = [&](int size, double focal_px) {
      std::vector<double> gaps2;
      for (int d = 0; d < size && square(std::max(0.0, d - 0.02) / focal_px) <= farthest2; ++d)
        gaps2.push_back(square(std::max(0.0, d - 0.02) / focal_px));
      return gaps2;
    };
    column_gaps2_ = gaps(width(), camera.fx);
    row_gaps2_ = gaps(height(), camera.fy);
  }

  int width() const { return surface_.points_m.cols; }
  int height() const { return surface_.points_m.rows; }
  int groups() const { return groups_; }  // of a row, a whole number of chunks
  double radius_m() const { return radius_m_; }
  const cv::Vec3f* row(int y) const { return surface_.points_m.ptr<cv::Vec3f>(y); }
  bool missing(const cv::Vec3f& p) const {
    return !(p[2] >= nearest_m_) || !std::isfinite(p[0] + p[1] + p[2]);
  }
  /// Of a point that is not missing.
  double reach(int x, int y, float z_m) const {
    const auto& camera = surface_.camera;
    const double m = (x - camera.cx) / camera.fx, n = (y - camera.cy) / camera.fy;
    // A little more than it is: rounding must not lose a neighbour.
    return 1.00001 * radius_m_ * std::sqrt(1.0 + m * m + n * n) / (z_m - radius_m_);
  }
  /// The largest of a group's points, negative when all are missing.
  double group_reach(int group, int y) const {
    return group_reach_[static_cast<std::size_t>(y) * static_cast<std::size_t>(groups_) +
                        static_cast<std::size_t>(group)];
  }
  double farthest() const { return *std::max_element(group_reach_.begin(), group_reach_.end()); }

  /// Neighbours within this reach are at most so many rows apart ...
  int rows_within(double reach) const {
    const auto end = std::upper_bound(row_gaps2_.begin(), row_gaps2_.end(), reach * reach);
    return static_cast<int>(end - row_gaps2_.begin()) - 1;
  }
  /// ... and those `rows` rows apart at most so many columns, -1 when there are none. The search
  /// starts at `guess`, the answer for about as many rows.
  int columns_within(double reach, int rows, int guess) const {
    const double left = reach * reach - row_gaps2_[static_cast<std::size_t>(rows)];
    const auto fits = [&](int columns) {
      return column_gaps2_[static_cast<std::size_t>(columns)] <= left;
    };
    while (guess < most_columns() && fits(guess + 1)) ++guess;
    while (guess >= 0 && !fits(guess)) --guess;
    return guess;
  }
  int most_columns() const { return static_cast<int>(column_gaps2_.size()) - 1; }
  /// Adds the neighbours of the columns of a row.
  void add_neighbours(int y, const Span& columns, double reach, Spans& spans) const {
    int far = most_columns();
    for (int dy = 0; dy <= rows_within(reach); ++dy) {
      far = columns_within(reach, dy, far);
      if (far < 0) return;
      const int first = std::max(0, columns.first - far);
      const int last = std::min(width() - 1, columns.last + far);
      if (y >= dy) spans[static_cast<std::size_t>(y - dy)].add(first, last);
      if (y + dy < height()) spans[static_cast<std::size_t>(y + dy)].add(first, last);
    }
  }

 private:
  void measure(int y) {
    const cv::Vec3f* points = row(y);
    float* out = group_reach_.data() + static_cast<std::ptrdiff_t>(y) * groups_;
    for (int x = 0; x < width(); x += kFpfhGroup) {
      const int last = std::min(width(), x + kFpfhGroup) - 1;
      float z_m = std::numeric_limits<float>::infinity();
      for (int i = x; i <= last; ++i) {
        if (!missing(points[i])) z_m = std::min(z_m, points[i][2]);
      }
      if (std::isfinite(z_m))  // and a little more again, for the rounding to float
        out[x / kFpfhGroup] =
            static_cast<float>(1.000001 * std::max(reach(x, y, z_m), reach(last, y, z_m)));
    }
  }

  const rgbd::Surface& surface_;
  double radius_m_;
  float nearest_m_;
  int groups_;
  std::vector<float> group_reach_;
  std::vector<double> column_gaps2_, row_gaps2_;
};

// A grid point to describe.
struct Query {
  std::size_t index;  // among the grid points inside the mask
  int x;
  cv::Vec3f point_m;
  double reach;
  int columns;  // the last answer of Neighbourhoods::columns_within()
};

// Those of a row of the grid.
struct QueryRow {
  int y;
  std::vector<Query> queries;
  std::vector<float> sums;  // [query][bin][8], see FpfhKernel::add_weighted, while it grows
};

// Where the results go, for the grid points inside the mask.
struct Results {
  std::vector<std::uint8_t> described;
  std::vector<float> values;
};

constexpr std::size_t kSums = kFpfhBins * 8;

// Scales each block to the sum 100; false when there is nothing.
bool finish(const float* sums, float* out) {
  for (int block = 0; block < 3; ++block) {
    float total = 0.0f;
    for (int bin = 0; bin < kFpfhBins; ++bin) {
      const float* sum = sums + 8 * bin + block;
      out[kFpfhBins * block + bin] = sum[0] + sum[4];
      total += sum[0] + sum[4];
    }
    if (!(total > 0.0f)) return false;
    const float scale = 100.0f / total;
    for (int bin = 0; bin < kFpfhBins; ++bin) out[kFpfhBins * block + bin] *= scale;
  }
  return true;
}

// Describes the grid points of a band of rows in one sweep from top to bottom. Each row of points
// is paired with itself and the rows below; then its counts are complete, are added to the grid
// points around, and its memory goes to a row further down. All of it stays in the processor's
// cache.
class Sweep {
 public:
  Sweep(const Neighbourhoods& scan, const cv::Mat& normals, std::span<QueryRow> band,
        int min_neighbours, const FpfhKernel& kernel, Results& results)
      : scan_(scan),
        normals_(normals),
        band_(band),
        min_neighbours_(min_neighbours),
        kernel_(kernel),
        results_(results),
        radius2_m2_(static_cast<float>(scan.radius_m() * scan.radius_m())),
        slots_(scan.rows_within(scan.farthest()) + 1),
        stride_((scan.groups() + 2) * kFpfhGroup),
        spans_(static_cast<std::size_t>(scan.height())),
        points_(static_cast<std::size_t>(slots_) * static_cast<std::size_t>(kPlanes * stride_)),
        counts_(static_cast<std::size_t>(slots_) *
                static_cast<std::size_t>(scan.groups() * kFpfhGroupCounts)),
        spfh_(static_cast<std::size_t>(scan.groups() * kFpfhGroupCounts)),
        codes_(kFpfhCodes, ~0u) {}

  void run() {
    for (const auto& row : band_) {
      for (const auto& query : row.queries)
        scan_.add_neighbours(row.y, {query.x, query.x}, query.reach, spans_);
    }
    int first = 0, last = scan_.height() - 1;
    while (first <= last && span(first).empty()) ++first;
    while (first <= last && span(last).empty()) --last;
    if (first > last) return;
    int loaded = std::max(0, first - slots_ + 1);
    for (int y = loaded; y <= last; ++y) {
      for (; loaded < std::min(scan_.height(), y + slots_); ++loaded) load(loaded);
      for (int group = 0; group < scan_.groups(); group += kFpfhGroups) count_chunk(group, y);
      if (!span(y).empty()) add_to_queries(y);
      for (auto& row : band_) {
        if (std::min(row.y + slots_ - 1, last) == y) finish_row(row);
      }
    }
  }

 private:
  static constexpr int kPlanes = 6;  // coordinates, normal

  // The columns of a row whose counts are needed.
  const Span& span(int y) const { return spans_[static_cast<std::size_t>(y)]; }
  float* plane(int i, int y) {
    return points_.data() + static_cast<std::ptrdiff_t>(y % slots_ * kPlanes + i) * stride_ +
           kFpfhGroup;
  }
  std::uint16_t* counts(int group, int y) {
    return counts_.data() +
           (static_cast<std::ptrdiff_t>(y % slots_) * scan_.groups() + group) * kFpfhGroupCounts;
  }

  void load(int y) {
    float* out = plane(0, y);
    std::fill(out - kFpfhGroup, out - kFpfhGroup + kPlanes * stride_, kMissing);
    const cv::Vec3f *points = scan_.row(y), *normals = normals_.ptr<cv::Vec3f>(y);
    for (int x = 0; x < scan_.width(); ++x) {
      const cv::Vec3f &p = points[x], &n = normals[x];
      if (scan_.missing(p) || !std::isfinite(n[0] + n[1] + n[2])) continue;
      for (int i = 0; i < 3; ++i) {
        out[i * stride_ + x] = p[i];
        out[(i + 3) * stride_ + x] = n[i];
      }
    }
    std::fill(counts(span(y).first_group(), y), counts(span(y).end_group(), y), std::uint16_t{0});
  }

  // Counts the pairs of a chunk of points with those right of and below them.
  void count_chunk(int first_group, int y) {
    int columns[kFpfhGroups];  // how many columns away neighbours can be
    double farthest = -1.0;
    for (int g = 0; g < kFpfhGroups; ++g) {
      const double reach = scan_.group_reach(first_group + g, y);
      columns[g] = reach < 0.0 ? -1 : scan_.most_columns();
      farthest = std::max(farthest, reach);
    }
    if (farthest < 0.0) return;
    const int last_row = std::min(scan_.height() - 1, y + scan_.rows_within(farthest));
    for (int q_y = y; q_y <= last_row; ++q_y) count_chunk_and_row(first_group, y, q_y, columns);
  }

  void count_chunk_and_row(int first_group, int y, int q_y, int* columns) {
    const Span &p_span = span(y), &q_span = span(q_y);
    FpfhPairs pairs;
    pairs.p_begin = std::clamp(p_span.first_group() - first_group, 0, kFpfhGroups);
    pairs.p_end = std::clamp(p_span.end_group() - first_group, 0, kFpfhGroups);
    Span dx[kFpfhGroups], all;
    for (int g = 0; g < kFpfhGroups; ++g) {
      const int group = first_group + g, x = group * kFpfhGroup;
      if (columns[g] >= 0)
        columns[g] = scan_.columns_within(scan_.group_reach(group, y), q_y - y, columns[g]);
      if (columns[g] < 0) continue;
      dx[g].first = std::max(q_y == y ? 1 : -columns[g], -x - kFpfhGroup + 1);
      dx[g].last = std::min(columns[g], scan_.width() - 1 - x);
      if (g < pairs.p_begin || g >= pairs.p_end) {  // only counts of the other row are needed
        dx[g].first = std::max(dx[g].first, q_span.first - x - kFpfhGroup + 1);
        dx[g].last = std::min(dx[g].last, q_span.last - x);
      }
      if (!dx[g].empty()) all.add(dx[g].first, dx[g].last);
    }
    for (int i = 0; i < 6; ++i) {
      pairs.p[i] = plane(i, y) + first_group * kFpfhGroup;
      pairs.q[i] = plane(i, q_y) + first_group * kFpfhGroup;
    }
    pairs.radius2_m2 = radius2_m2_;
    pairs.q_begin = q_span.first_group() - first_group;
    pairs.q_end = q_span.end_group() - first_group;
    pairs.p_counts = counts(first_group + pairs.p_begin, y);
    pairs.q_counts = counts(q_span.first_group(), q_y);
    pairs.codes = codes_.data();
    int first_dx[kFpfhGroups], last_dx[kFpfhGroups];
    pairs.first_dx = first_dx;
    pairs.last_dx = last_dx;
    for (int from = all.first; from <= all.last; from += kFpfhMaxRun) {
      for (int g = 0; g < kFpfhGroups; ++g) {
        first_dx[g] = std::max(dx[g].first, from);
        last_dx[g] = std::min(dx[g].last, from + kFpfhMaxRun - 1);
      }
      kernel_.count_pairs(pairs);
    }
  }

  // Adds the SPFH of a row to the grid points around.
  void add_to_queries(int y) {
    const int first_group = span(y).first_group(), end_group = span(y).end_group();
    kernel_.normalise(counts(first_group, y), end_group - first_group, spfh_.data());
    for (auto& row : band_) {
      const int dy = std::abs(row.y - y);
      if (dy >= slots_) continue;
      row.sums.resize(row.queries.size() * kSums);
      for (std::size_t i = 0; i < row.queries.size(); ++i) {
        Query& query = row.queries[i];
        query.columns = scan_.columns_within(query.reach, dy, query.columns);
        if (query.columns < 0) continue;
        const int first = std::max(0, query.x - query.columns) / kFpfhGroup;
        const int last = std::min(scan_.width() - 1, query.x + query.columns) / kFpfhGroup;
        const float* points[3];
        for (int k = 0; k < 3; ++k) points[k] = plane(k, y) + first * kFpfhGroup;
        kernel_.add_weighted(points, spfh_.data() + (first - first_group) * kFpfhGroupCounts,
                             last - first + 1, query.point_m.val, radius2_m2_,
                             row.sums.data() + i * kSums);
        if (dy == 0) {
          const auto* own = counts(query.x / kFpfhGroup, y) + 4 * (query.x % kFpfhGroup);
          results_.described[query.index] = own[3] >= min_neighbours_;
        }
      }
    }
  }

  void finish_row(QueryRow& row) {
    for (std::size_t i = 0; i < row.queries.size(); ++i) {
      const std::size_t index = row.queries[i].index;
      auto& described = results_.described[index];
      described = described && finish(row.sums.data() + i * kSums,
                                      results_.values.data() + index * FpfhDescriptor::kDimension);
    }
    row.sums = {};
  }

  const Neighbourhoods& scan_;
  const cv::Mat& normals_;
  std::span<QueryRow> band_;
  int min_neighbours_;
  const FpfhKernel& kernel_;
  Results& results_;
  float radius2_m2_;
  int slots_;   // rows in memory; row y in slot y mod slots
  int stride_;  // of a row of points: a group more at both ends, so that kernels may read there
  Spans spans_;
  std::vector<float> points_;
  std::vector<std::uint16_t> counts_;
  std::vector<float> spfh_;  // of the latest complete row
  std::vector<std::uint32_t> codes_;
};

// normals_where: the normals, needed only where its argument (CV_8UC1) is not 0.
FloatField describe_with(const rgbd::Surface& surface, const cv::Mat& mask, const Grid& grid,
                         const FpfhOptions& options, SimdPath path, int threads,
                         const std::function<cv::Mat(const cv::Mat&)>& normals_where) {
  const auto cells = masked_cells(surface, mask, grid, "FPFH");
  surface.camera.validate("FPFH: the surface's camera");
  if (surface.camera.width != surface.points_m.cols ||
      surface.camera.height != surface.points_m.rows)
    throw Error("FPFH: the surface is not of its camera's size");
  Results results{std::vector<std::uint8_t>(cells.size()),
                  std::vector<float>(cells.size() * FpfhDescriptor::kDimension)};
  const auto field = [&] {
    return make_field(grid, FpfhDescriptor::kDimension, cells, results.described,
                      std::move(results.values));
  };
  if (cells.empty()) return field();

  const Neighbourhoods scan(surface, options.radius_m, threads);
  std::vector<QueryRow> rows;
  std::vector<double> work{0.0};  // up to each row: a neighbourhood has about reach^2 pixels
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const int x = grid.x(cells[i] % grid.columns), y = grid.y(cells[i] / grid.columns);
    const cv::Vec3f& point_m = scan.row(y)[x];
    if (scan.missing(point_m)) continue;
    if (rows.empty() || rows.back().y != y) {
      rows.push_back({y, {}, {}});
      work.push_back(work.back());
    }
    const double reach = scan.reach(x, y, point_m[2]);
    rows.back().queries.push_back({i, x, point_m, reach, 0});
    work.back() += reach * reach;
  }
  if (rows.empty()) return field();

  // Normals are needed of the neighbours, and of their neighbours.
  Spans near(static_cast<std::size_t>(scan.height())), around(near.size());
  for (const auto& row : rows) {
    for (const auto& query : row.queries)
      scan.add_neighbours(row.y, {query.x, query.x}, query.reach, near);
  }
  for (int y = 0; y < scan.height(); ++y) {
    const Span& span = near[static_cast<std::size_t>(y)];
    double reach = -1.0;
    for (int group = span.first_group(); group < span.end_group(); ++group)
      reach = std::max(reach, scan.group_reach(group, y));
    if (reach >= 0.0) scan.add_neighbours(y, span, reach, around);
  }
  cv::Mat where(scan.height(), scan.width(), CV_8UC1, cv::Scalar(0));
  for (int y = 0; y < scan.height(); ++y) {
    const Span& span = around[static_cast<std::size_t>(y)];
    if (!span.empty()) std::fill(where.ptr(y) + span.first, where.ptr(y) + span.last + 1, 255);
  }
  const cv::Mat normals = normals_where(where);

  // A band for each thread; points near its edges count in both bands.
  const int bands = std::min(static_cast<int>(rows.size()), thread_count(threads));
  const auto cut = [&](int band) {
    if (band == bands) return rows.size();
    const auto at = std::lower_bound(work.begin(), work.end(), work.back() * band / bands);
    return static_cast<std::size_t>(at - work.begin());
  };
  parallel_for(bands, bands, [&](int first, int last) {
    for (int band = first; band < last; ++band) {
      const auto of_band = std::span(rows).subspan(cut(band), cut(band + 1) - cut(band));
      Sweep(scan, normals, of_band, options.min_neighbours, kernel_of(path), results).run();
    }
  });
  return field();
}

}  // namespace

FpfhDescriptor::FpfhDescriptor(const FpfhOptions& options, SimdPath path)
    : options_(options), path_(resolve_simd_path(path)) {
  options_.validate();
  if (!simd_path_available(path_)) throw Error("this processor has no AVX2; use the baseline path");
}

const std::string& FpfhDescriptor::name() const {
  static const std::string name = "fpfh";
  return name;
}

DescriptorField FpfhDescriptor::describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                                         const rgbd::ViewImages& images, const Grid& grid,
                                         int threads) const {
  const rgbd::Surface surface = rgbd::render_surface(frame, view);
  return to_bytes(describe_with(surface, images.mask, grid, options_, path_, threads,
                                [&](const cv::Mat& where) {
                                  return rgbd::estimate_normals(surface, options_.normals, threads,
                                                                where, path_);
                                }),
                  [](float v) { return 2.55f * v; });
}

FloatField FpfhDescriptor::describe_surface(const rgbd::Surface& surface, const cv::Mat& normals,
                                            const cv::Mat& mask, const Grid& grid,
                                            int threads) const {
  if (normals.type() != CV_32FC3 || normals.size() != surface.points_m.size())
    throw Error("FPFH: expected a normal of three floats for each point of the surface");
  return describe_with(surface, mask, grid, options_, path_, threads,
                       [&](const cv::Mat&) { return normals; });
}

}  // namespace weft::descriptor
