#include <algorithm>
#include <limits>

#include "base/error.hpp"
#include "base/parallel.hpp"
#include "base/random.hpp"
#include "bovw/nearest.hpp"
#include "bovw/vocabulary.hpp"

namespace weft::bovw {
namespace {

// Pieces of the samples whose sums are added up one after the other.
constexpr int kPieces = 32;

struct Samples {
  std::span<const std::uint8_t> values;
  int dimension;
  int count;
  std::span<const std::uint8_t> range(int begin, int end) const {
    const auto d = static_cast<std::size_t>(dimension);
    return values.subspan(static_cast<std::size_t>(begin) * d,
                          static_cast<std::size_t>(end - begin) * d);
  }
};

// k-means++ (Arthur and Vassilvitskii 2007): each next centre is a sample drawn with probability
// proportional to its squared distance from the nearest centre so far.
std::vector<std::uint8_t> seed(const Samples& samples, int words, Random& random, int threads) {
  std::vector<std::uint8_t> centres;
  std::vector<std::int32_t> nearest(static_cast<std::size_t>(samples.count),
                                    std::numeric_limits<std::int32_t>::max());
  int chosen = static_cast<int>(random.below(static_cast<std::uint64_t>(samples.count)));
  for (int word = 0;; ++word) {
    const auto centre = samples.range(chosen, chosen + 1);
    centres.insert(centres.end(), centre.begin(), centre.end());
    if (word + 1 == words) return centres;
    parallel_for(samples.count, threads, [&](int begin, int end) {
      std::vector<std::int32_t> distances(static_cast<std::size_t>(end - begin));
      squared_distances(samples.range(begin, end), centre, distances);
      for (int i = begin; i < end; ++i) {
        auto& least = nearest[static_cast<std::size_t>(i)];
        least = std::min(least, distances[static_cast<std::size_t>(i - begin)]);
      }
    });
    std::uint64_t total = 0;
    for (const auto distance : nearest) total += static_cast<std::uint64_t>(distance);
    if (total == 0) {
      throw Error("k-means: the " + std::to_string(samples.count) + " samples have only " +
                  std::to_string(word + 1) + " distinct values for " + std::to_string(words) +
                  " words; sample more scenes or ask for fewer words");
    }
    std::uint64_t left = random.below(total);
    for (chosen = 0;; ++chosen) {
      const auto distance = static_cast<std::uint64_t>(nearest[static_cast<std::size_t>(chosen)]);
      if (left < distance) break;
      left -= distance;
    }
  }
}

}  // namespace

KMeansResult train_kmeans(std::span<const std::uint8_t> values, int dimension,
                          const KMeansOptions& options, int threads) {
  options.validate();
  if (dimension < 1 || dimension > 4096 ||
      values.size() % static_cast<std::size_t>(dimension) != 0 ||
      values.size() / static_cast<std::size_t>(dimension) > (1u << 30)) {
    throw Error("k-means: " + std::to_string(values.size()) + " values are no samples of " +
                std::to_string(dimension) + " dimensions");
  }
  const Samples samples{values, dimension,
                        static_cast<int>(values.size() / static_cast<std::size_t>(dimension))};
  if (samples.count < options.words) {
    throw Error("k-means: " + std::to_string(samples.count) + " samples for " +
                std::to_string(options.words) +
                " words; sample more scenes or ask for fewer words");
  }
  Random random(static_cast<std::uint64_t>(options.seed));
  KMeansResult result;
  result.centres = seed(samples, options.words, random, threads);

  const auto words = static_cast<std::size_t>(options.words);
  const auto size = static_cast<std::size_t>(dimension);
  std::vector<std::int32_t> assigned(static_cast<std::size_t>(samples.count));
  std::vector<std::int32_t> distances(assigned.size());
  while (true) {
    const Nearest nearest(result.centres, dimension);
    std::vector<std::vector<std::int64_t>> sums(kPieces), counts(kPieces);
    parallel_for(kPieces, threads, [&](int first, int last) {
      for (int piece = first; piece < last; ++piece) {
        const auto bound = [&](int i) {
          return static_cast<int>(static_cast<std::int64_t>(samples.count) * i / kPieces);
        };
        const int begin = bound(piece), end = bound(piece + 1);
        const auto at = static_cast<std::size_t>(begin), n = static_cast<std::size_t>(end - begin);
        nearest.find(samples.range(begin, end), std::span(assigned).subspan(at, n),
                     std::span(distances).subspan(at, n));
        auto& sum = sums[static_cast<std::size_t>(piece)];
        auto& count = counts[static_cast<std::size_t>(piece)];
        sum.assign(words * size, 0);
        count.assign(words, 0);
        for (int i = begin; i < end; ++i) {
          const auto word = static_cast<std::size_t>(assigned[static_cast<std::size_t>(i)]);
          const auto* sample = values.data() + static_cast<std::size_t>(i) * size;
          ++count[word];
          for (std::size_t d = 0; d < size; ++d) sum[word * size + d] += sample[d];
        }
      }
    });
    for (int piece = 1; piece < kPieces; ++piece) {
      for (std::size_t i = 0; i < sums[0].size(); ++i)
        sums[0][i] += sums[static_cast<std::size_t>(piece)][i];
      for (std::size_t i = 0; i < words; ++i)
        counts[0][i] += counts[static_cast<std::size_t>(piece)][i];
    }
    std::int64_t total = 0;
    for (const auto distance : distances) total += distance;
    result.mean_squared_distance = static_cast<double>(total) / static_cast<double>(samples.count);
    result.word_count = counts[0];
    if (result.converged || result.iterations == options.max_iterations) return result;

    auto centres = result.centres;
    for (std::size_t word = 0; word < words; ++word) {
      const std::int64_t n = counts[0][word];
      if (n == 0) {
        // An empty word moves to the sample that is worst off.
        const auto far = std::max_element(distances.begin(), distances.end());
        const auto sample = static_cast<int>(far - distances.begin());
        const auto value = samples.range(sample, sample + 1);
        std::copy(value.begin(), value.end(),
                  centres.begin() + static_cast<std::ptrdiff_t>(word * size));
        *far = 0;
        continue;
      }
      for (std::size_t d = 0; d < size; ++d) {
        centres[word * size + d] =
            static_cast<std::uint8_t>((2 * sums[0][word * size + d] + n) / (2 * n));
      }
    }
    result.converged = centres == result.centres;
    result.centres = std::move(centres);
    ++result.iterations;
  }
}

}  // namespace weft::bovw
