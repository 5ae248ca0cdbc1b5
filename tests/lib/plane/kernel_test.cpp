#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "base/random.hpp"
#include "base/simd.hpp"
#include "plane/cell_kernel.hpp"

namespace weft::plane {
namespace {

struct Path {
  const char* name;
  const CellKernel* kernel;
};

std::vector<Path> paths() {
  std::vector<Path> all = {{"baseline", &kCellBaseline}};
#if defined(__x86_64__)
  if (simd_path_available(SimdPath::kAvx2)) all.push_back({"AVX2", &kCellAvx2});
#endif
  return all;
}

InverseDepthCode code(std::uint32_t nearest, std::uint32_t farthest) {
  return {nearest, farthest - nearest, static_cast<float>(nearest) * 4194304.0f};
}

/// Half of the depths around the ends of the valid range, or missing.
std::vector<std::uint16_t> depths(std::size_t count, const InverseDepthCode& c) {
  Random random(count);
  std::vector<std::uint16_t> out(count);
  for (auto& z : out) {
    const auto any = static_cast<std::uint16_t>(random.integer(c.nearest, c.nearest + c.span));
    const std::uint16_t edges[] = {0,
                                   1,
                                   65535,
                                   static_cast<std::uint16_t>(c.nearest - 1),
                                   static_cast<std::uint16_t>(c.nearest),
                                   static_cast<std::uint16_t>(c.nearest + c.span),
                                   static_cast<std::uint16_t>(c.nearest + c.span + 1)};
    z = random.below(2) ? any : edges[random.below(7)];
  }
  return out;
}

bool valid(const InverseDepthCode& c, std::uint16_t z) {
  return z >= c.nearest && z <= c.nearest + c.span;
}

TEST(CellKernel, ColumnsEqualPlainSums) {
  for (const auto& [nearest, farthest] : {std::pair{1000u, 50000u}, {1u, 65535u}, {200u, 200u}}) {
    const InverseDepthCode c = code(nearest, farthest);
    const std::ptrdiff_t stride = 27;
    const auto z = depths(27 * 40, c);
    for (const int rows : {1, 7, 20, 40})
      for (const Path& path : paths()) {
        std::vector<ColumnSums> sums(3);
        path.kernel->columns(c, z.data(), stride, rows, 3, sums.data());
        for (int u = 0; u < 24; ++u) {
          std::uint64_t n = 0, nw = 0, nww = 0, d = 0, dw = 0, dd = 0;
          for (int v = 0; v < rows; ++v) {
            const std::uint16_t at = z[static_cast<std::size_t>(v * stride + u)];
            if (!valid(c, at)) continue;
            const auto w = static_cast<std::uint64_t>(rows - v);
            const auto inverse =
                static_cast<std::uint64_t>(c.steps / static_cast<float>(at) + 0.5f);
            ASSERT_LE(inverse, 1u << 22);
            ++n;
            nw += w;
            nww += w * (w + 1) / 2;
            d += inverse;
            dw += w * inverse;
            dd += inverse * inverse;
          }
          const ColumnSums& s = sums[static_cast<std::size_t>(u / 8)];
          EXPECT_EQ(s.n[u % 8], n) << path.name;
          EXPECT_EQ(s.nw[u % 8], nw) << path.name;
          EXPECT_EQ(s.nww[u % 8], nww) << path.name;
          EXPECT_EQ(s.d[u % 8], d) << path.name;
          EXPECT_EQ(s.dw[u % 8], dw) << path.name;
          EXPECT_EQ(s.dd[u % 8], static_cast<double>(dd)) << path.name;
        }
      }
  }
}

TEST(CellKernel, LargestSumsDoNotOverflow) {
  const InverseDepthCode c = code(7, 65535);
  const std::vector<std::uint16_t> z(8 * 40, 7);
  for (const Path& path : paths()) {
    ColumnSums sums;
    path.kernel->columns(c, z.data(), 8, CellKernel::kMaxCell, 1, &sums);
    EXPECT_EQ(sums.d[3], 40u << 22) << path.name;
    EXPECT_EQ(sums.dw[3], 820u << 22) << path.name;
    EXPECT_EQ(sums.dd[3], 40.0 * 17592186044416.0) << path.name;
  }
}

TEST(CellKernel, LabelsEqualThePlainNearestPlane) {
  const InverseDepthCode c = code(1000, 50000);
  const std::ptrdiff_t stride = 45;
  const auto z = depths(45 * 40, c);
  const float far = c.steps / 30000.0f, wide = c.steps / 2000.0f;
  const std::vector<CellPlane> planes = {{far, 300.0f, -10.0f, wide, 7},
                                         {far, 300.0f, -10.0f, wide, 9},  // a tie: the first wins
                                         {2 * far, 0.0f, 500.0f, far, 200},
                                         {5 * far, -900.0f, 0.0f, 0.1f * far, 1}};
  for (const int columns : {1, 7, 8, 20, 40})
    for (const int rows : {1, 19, 40})
      for (const Path& path : paths())
        for (const int count : {0, 1, 4}) {
          std::vector<std::uint8_t> labels(50 * 40, 99);
          std::vector<float> distances(40 * 40, -1.0f);
          std::vector<int> counts(4, -1);
          path.kernel->label(c, z.data(), stride, columns, rows, planes.data(), count,
                             labels.data(), 50, counts.data(), distances.data());
          std::vector<int> expected_counts(4, 0);
          for (int v = 0; v < 40; ++v)
            for (int u = 0; u < 50; ++u) {
              const std::uint8_t label = labels[static_cast<std::size_t>(v * 50 + u)];
              if (v >= rows || u >= columns) {
                ASSERT_EQ(label, 99) << path.name;
                continue;
              }
              const std::uint16_t at = z[static_cast<std::size_t>(v * stride + u)];
              float best = std::numeric_limits<float>::infinity();
              int nearest = -1;
              for (int i = 0; i < count && valid(c, at); ++i) {
                const CellPlane& p = planes[static_cast<std::size_t>(i)];
                const float start = p.start + p.row * static_cast<float>(v);
                const float off = std::abs(c.steps / static_cast<float>(at) -
                                           (start + p.column * static_cast<float>(u)));
                if (off <= p.gate && off < best) {
                  best = off;
                  nearest = i;
                }
              }
              ASSERT_EQ(label, nearest < 0 ? 0 : planes[static_cast<std::size_t>(nearest)].label)
                  << path.name;
              ASSERT_EQ(distances[static_cast<std::size_t>(v * 40 + u)], best) << path.name;
              if (nearest >= 0) ++expected_counts[static_cast<std::size_t>(nearest)];
            }
          for (int i = 0; i < count; ++i)
            EXPECT_EQ(counts[static_cast<std::size_t>(i)],
                      expected_counts[static_cast<std::size_t>(i)]);
        }
}

}  // namespace
}  // namespace weft::plane
