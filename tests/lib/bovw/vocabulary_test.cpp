#include "bovw/vocabulary.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>

#include "base/blob.hpp"
#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::bovw {
namespace {

std::vector<std::uint8_t> random_bytes(std::size_t count, int limit, Random& random) {
  std::vector<std::uint8_t> bytes(count);
  for (auto& byte : bytes)
    byte = static_cast<std::uint8_t>(random.below(static_cast<std::uint64_t>(limit)));
  return bytes;
}

// The first of the nearest words, by definition.
int brute_force(const std::vector<std::uint8_t>& centres, const std::uint8_t* point, int dimension,
                std::int64_t* least) {
  int best = -1;
  for (int word = 0; word < static_cast<int>(centres.size()) / dimension; ++word) {
    std::int64_t distance = 0;
    for (int d = 0; d < dimension; ++d) {
      const int difference = point[d] - centres[static_cast<std::size_t>(word * dimension + d)];
      distance += difference * difference;
    }
    if (best < 0 || distance < *least) {
      best = word;
      *least = distance;
    }
  }
  return best;
}

TEST(Nearest, EqualsBruteForceOnEveryPath) {
  for (const auto path : {SimdPath::kBaseline, SimdPath::kAvx2}) {
    if (!simd_path_available(path)) continue;
    Random random(1);
    for (const int dimension : {1, 2, 7, 33, 128, 208}) {
      for (const int words : {1, 5, 8, 100, 129}) {
        for (const int limit : {2, 256}) {  // 2: many ties
          const auto centres =
              random_bytes(static_cast<std::size_t>(words * dimension), limit, random);
          const auto points = random_bytes(static_cast<std::size_t>(61 * dimension), limit, random);
          std::vector<std::int32_t> found(61), distances(61);
          Nearest(centres, dimension, path).find(points, found, distances);
          for (int i = 0; i < 61; ++i) {
            std::int64_t least = 0;
            ASSERT_EQ(found[static_cast<std::size_t>(i)],
                      brute_force(centres, points.data() + i * dimension, dimension, &least));
            ASSERT_EQ(distances[static_cast<std::size_t>(i)], least);
          }
        }
      }
    }
  }
}

TEST(Nearest, HoldsTheLargestSums) {
  const std::vector<std::uint8_t> centres(2 * 4096, 255), points(4096, 0);
  std::vector<std::int32_t> words(1), distances(1);
  for (const auto path : {SimdPath::kBaseline, SimdPath::kAvx2}) {
    if (!simd_path_available(path)) continue;
    Nearest(centres, 4096, path).find(points, words, distances);
    EXPECT_EQ(words[0], 0);
    EXPECT_EQ(distances[0], 255 * 255 * 4096);
    Nearest(centres, 4096, path).find(std::span(centres).first(4096), words, distances);
    EXPECT_EQ(distances[0], 0);
    squared_distances(points, std::span(centres).first(4096), distances, path);
    EXPECT_EQ(distances[0], 255 * 255 * 4096);
  }
}

TEST(Vocabulary, AssignsTheSameWordsOnAnyNumberOfThreads) {
  Random random(2);
  const Vocabulary vocabulary("sift", 128, random_bytes(128 * 128, 256, random), 0, "");
  const auto points = random_bytes(1001 * 128, 256, random);
  std::vector<std::int16_t> one(1001), many(1001);
  vocabulary.assign(points, one, 1);
  vocabulary.assign(points, many, 7);
  EXPECT_EQ(one, many);
  EXPECT_THROW(vocabulary.assign(points, std::span(one).first(1000)), Error);
}

TEST(Vocabulary, FileKeepsEverything) {
  Random random(3);
  const Vocabulary vocabulary("fpfh", 33, random_bytes(20 * 33, 256, random), 0xfedcba9876543210u,
                              "grid:\n  step_px: 6\n");
  const auto path = (std::filesystem::temp_directory_path() /
                     ("weft_vocabulary_" + std::to_string(getpid()) + ".weft"))
                        .string();
  vocabulary.write(path);
  const auto read = Vocabulary::read(path);
  EXPECT_EQ(read.descriptor(), "fpfh");
  EXPECT_EQ(read.dimension(), 33);
  EXPECT_EQ(read.words(), 20);
  EXPECT_EQ(read.centres(), vocabulary.centres());
  EXPECT_EQ(read.settings_hash(), 0xfedcba9876543210u);
  EXPECT_EQ(read.settings_yaml(), vocabulary.settings_yaml());
  EXPECT_EQ(read.hash(), vocabulary.hash());
  BlobWriter other("vocabulary", 1);
  other.add_number("dimension", std::int64_t{33});
  other.add_number("words", std::int64_t{21});
  other.add("centres", vocabulary.centres());
  other.write(path);
  EXPECT_THROW(Vocabulary::read(path), Error);
  std::filesystem::remove(path);
}

TEST(Vocabulary, HashNamesSettingsAndCentres) {
  const std::vector<std::uint8_t> centres = {1, 2, 3, 4};
  const auto hash = [&](const std::string& name, int dimension, std::uint64_t settings) {
    return Vocabulary(name, dimension, centres, settings, "").hash();
  };
  EXPECT_EQ(hash("a", 2, 1), hash("a", 2, 1));
  EXPECT_NE(hash("a", 2, 1), hash("b", 2, 1));
  EXPECT_NE(hash("a", 2, 1), hash("a", 4, 1));
  EXPECT_NE(hash("a", 2, 1), hash("a", 2, 2));
  EXPECT_THROW(hash("a", 3, 1), Error);
  EXPECT_THROW(hash("a", 0, 1), Error);
  EXPECT_THROW(hash("", 2, 1), Error);
}

}  // namespace
}  // namespace weft::bovw
