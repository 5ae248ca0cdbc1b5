// Assignment of 128 visual words to 8190 descriptors of 128 and of 208 values, beside a plain loop.
#include <limits>

#include "base/random.hpp"
#include "bench/descriptors/bench.hpp"
#include "bovw/vocabulary.hpp"
#include "descriptor/sift.hpp"

namespace weft::bench {

nlohmann::json bench_words(const Scan& scan, const Settings& settings) {
  if (scan.frame.colour.empty()) return nullptr;
  const auto field = descriptor::SiftDescriptor(descriptor::SiftOptions{})
                         .describe(scan.frame, scan.view, scan.images, scan.grid, 1);
  if (field.points.empty()) return nullptr;
  const auto points = scan.grid.cells();
  nlohmann::json result;
  Random random(2);
  for (const std::size_t dimension : {std::size_t{208}, std::size_t{128}}) {
    // Descriptors of the scan, repeated until there is one for each point of the grid.
    std::vector<std::uint8_t> values(points * dimension), centres(128 * dimension);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = field.values[i % field.values.size()];
    for (std::size_t word = 0; word < 128; ++word) {
      const auto at = random.below(points) * dimension;
      for (std::size_t k = 0; k < dimension; ++k) centres[word * dimension + k] = values[at + k];
    }
    const bovw::Vocabulary vocabulary("sift", static_cast<int>(dimension), centres, 0, "");
    std::vector<std::int16_t> assigned(points);
    const double ms = best_ms(settings.runs, settings.threads,
                              [&] { vocabulary.assign(values, assigned, settings.threads); });
    if (dimension == 208) {
      result["ms_208_values"] = ms;
      continue;
    }
    result.update(figures(points, ms, settings.threads));
    const bovw::Nearest nearest(centres, static_cast<int>(dimension), SimdPath::kBaseline);
    std::vector<std::int32_t> found(points);
    result["ms_baseline_simd"] =
        best_ms(settings.runs, 1, [&] { nearest.find(values, found, {}); });
    if (!settings.peer) continue;
    std::vector<int> expected(points);
    const double peer_ms = best_ms(1, 1, [&] {
      for (std::size_t i = 0; i < points; ++i) {
        int best = std::numeric_limits<int>::max();
        for (std::size_t word = 0; word < 128; ++word) {
          int distance = 0;
          for (std::size_t k = 0; k < dimension; ++k) {
            const int d = values[i * dimension + k] - centres[word * dimension + k];
            distance += d * d;
          }
          if (distance < best) {
            best = distance;
            expected[i] = static_cast<int>(word);
          }
        }
      }
    });
    int different = 0;
    for (std::size_t i = 0; i < points; ++i) different += assigned[i] != expected[i];
    result["peer"] = "every distance by a plain loop";
    result["peer_ms"] = peer_ms;
    result["ratio"] = peer_ms / ms;
    result["words_that_differ"] = different;
  }
  return result;
}

}  // namespace weft::bench
