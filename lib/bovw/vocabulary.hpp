#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "bovw/nearest.hpp"

namespace weft::bovw {

/// Visual words: cluster centres of 8-bit descriptors. Everything is integer arithmetic, so
/// assignments are exact and the same everywhere.
class Vocabulary {
 public:
  /// centres: words * dimension, at most 32767 words and 4096 dimensions. settings_hash and
  /// settings_yaml are those the descriptors were made with (DescribeOptions). Throws Error.
  Vocabulary(std::string descriptor, int dimension, std::vector<std::uint8_t> centres,
             std::uint64_t settings_hash, std::string settings_yaml);

  static Vocabulary read(const std::string& path);
  void write(const std::string& path) const;

  const std::string& descriptor() const { return descriptor_; }
  int dimension() const { return dimension_; }
  int words() const { return words_; }
  std::uint64_t settings_hash() const { return settings_hash_; }
  const std::string& settings_yaml() const { return settings_yaml_; }
  const std::vector<std::uint8_t>& centres() const { return centres_; }
  /// Names descriptor, settings and centres.
  std::uint64_t hash() const { return hash_; }

  /// The word with the smallest squared distance for each descriptor; of equals, the smallest word.
  /// descriptors: words.size() * dimension. threads < 1: one for each core.
  void assign(std::span<const std::uint8_t> descriptors, std::span<std::int16_t> words,
              int threads = 1) const;

 private:
  Nearest check() const;
  std::string descriptor_;
  int dimension_;
  int words_;
  std::vector<std::uint8_t> centres_;
  std::uint64_t settings_hash_;
  std::string settings_yaml_;
  std::uint64_t hash_;
  Nearest nearest_;
};

struct KMeansOptions {
  int words = 128;
  int max_iterations = 40;
  int seed = 1;

  void visit(OptionVisitor& v) {
    v.field("words", words, {2, 4096}, "", "vocabulary size; garment-parts.txt section 5.1: 128");
    v.field("max_iterations", max_iterations, {1, 1000}, "", "Lloyd iterations at most");
    v.field("seed", seed, {0, 1 << 30}, "", "of the k-means++ start");
  }
  void validate() const { validate_fields(*this, "KMeansOptions"); }
};

struct KMeansResult {
  std::vector<std::uint8_t> centres;     // words * dimension, rounded means
  std::vector<std::int64_t> word_count;  // samples of each word at the last assignment
  int iterations = 0;
  bool converged = false;              // the centres stopped moving
  double mean_squared_distance = 0.0;  // of the samples to their centres
};

/// k-means with k-means++ seeding on 8-bit descriptors, samples.size() / dimension of them. The
/// centres are rounded to 8 bit in every iteration; sums are integers, so the result does not
/// depend on the thread count. Throws Error when there are fewer distinct samples than words.
KMeansResult train_kmeans(std::span<const std::uint8_t> samples, int dimension,
                          const KMeansOptions& options, int threads);

}  // namespace weft::bovw
