#include <gtest/gtest.h>

#include <set>

#include "base/error.hpp"
#include "base/random.hpp"
#include "bovw/vocabulary.hpp"

namespace weft::bovw {
namespace {

constexpr int kDimension = 16;

std::vector<std::uint8_t> clusters(int count, int spread, int samples, std::uint64_t seed,
                                   std::vector<std::vector<int>>* middles) {
  Random random(seed);
  middles->assign(static_cast<std::size_t>(count), {});
  for (auto& middle : *middles) {
    for (int d = 0; d < kDimension; ++d)
      middle.push_back(static_cast<int>(random.integer(40, 215)));
  }
  std::vector<std::uint8_t> values;
  for (int i = 0; i < samples; ++i) {
    for (const int m : (*middles)[static_cast<std::size_t>(i % count)])
      values.push_back(static_cast<std::uint8_t>(m + random.integer(-spread, spread)));
  }
  return values;
}

TEST(KMeans, FindsSeparateClusters) {
  std::vector<std::vector<int>> middles;
  const auto samples = clusters(6, 3, 600, 4, &middles);
  KMeansOptions options;
  options.words = 6;
  const auto result = train_kmeans(samples, kDimension, options, 2);
  EXPECT_TRUE(result.converged);
  std::set<std::size_t> found;
  for (std::size_t word = 0; word < 6; ++word) {
    EXPECT_EQ(result.word_count[word], 100);
    for (std::size_t m = 0; m < middles.size(); ++m) {
      bool near = true;
      for (std::size_t d = 0; d < kDimension; ++d)
        near &= std::abs(result.centres[word * kDimension + d] - middles[m][d]) <= 1;
      if (near) found.insert(m);
    }
  }
  EXPECT_EQ(found.size(), 6u);
  // Uniform integers in [-3, 3] have variance 4.
  EXPECT_NEAR(result.mean_squared_distance, 4.0 * kDimension, 4.0);
}

// At the end every centre is the rounded mean of the samples that are nearest to it.
TEST(KMeans, CentresAreTheMeansOfTheirSamples) {
  Random random(5);
  std::vector<std::uint8_t> samples;
  for (int i = 0; i < 2000 * kDimension; ++i)
    samples.push_back(static_cast<std::uint8_t>(random.below(256)));
  KMeansOptions options;
  options.words = 20;
  options.max_iterations = 1000;
  const auto result = train_kmeans(samples, kDimension, options, 2);
  ASSERT_TRUE(result.converged);
  std::vector<double> sums(20 * kDimension, 0.0), counts(20, 0.0);
  for (std::size_t i = 0; i < 2000; ++i) {
    std::size_t best = 0;
    double least = 1e18;
    for (std::size_t word = 0; word < 20; ++word) {
      double distance = 0;
      for (std::size_t d = 0; d < kDimension; ++d) {
        const double difference =
            samples[i * kDimension + d] - double(result.centres[word * kDimension + d]);
        distance += difference * difference;
      }
      if (distance < least) {
        least = distance;
        best = word;
      }
    }
    ++counts[best];
    for (std::size_t d = 0; d < kDimension; ++d)
      sums[best * kDimension + d] += samples[i * kDimension + d];
  }
  for (std::size_t word = 0; word < 20; ++word) {
    ASSERT_EQ(static_cast<double>(result.word_count[word]), counts[word]);
    for (std::size_t d = 0; d < kDimension; ++d)
      EXPECT_NEAR(result.centres[word * kDimension + d], sums[word * kDimension + d] / counts[word],
                  0.5);
  }
}

TEST(KMeans, SameResultForAnyThreadCountAnotherForAnotherSeed) {
  std::vector<std::vector<int>> middles;
  const auto samples = clusters(40, 30, 3001, 6, &middles);
  KMeansOptions options;
  options.words = 32;
  const auto one = train_kmeans(samples, kDimension, options, 1);
  const auto many = train_kmeans(samples, kDimension, options, 5);
  EXPECT_EQ(one.centres, many.centres);
  EXPECT_EQ(one.word_count, many.word_count);
  EXPECT_EQ(one.mean_squared_distance, many.mean_squared_distance);
  options.seed = 2;
  EXPECT_NE(train_kmeans(samples, kDimension, options, 1).centres, one.centres);
}

TEST(KMeans, SaysWhenThereAreTooFewSamples) {
  KMeansOptions options;
  options.words = 3;
  const std::vector<std::uint8_t> two = {1, 2, 3, 4};
  EXPECT_THROW(train_kmeans(two, 2, options, 1), Error);
  const std::vector<std::uint8_t> equal(20, 7);
  EXPECT_THROW(train_kmeans(equal, 2, options, 1), Error);
  EXPECT_THROW(train_kmeans(equal, 3, options, 1), Error);  // 20 values are no whole samples
}

}  // namespace
}  // namespace weft::bovw
