#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "slam/descriptor.hpp"

namespace weft::slam {

struct WordWeight {
  std::int32_t word;
  double weight;
};
/// Words with their tf-idf weights, ascending by word, the weights' sum 1 (or empty).
using BagOfWords = std::vector<WordWeight>;

/// A picture in words: the bag, and for each node of the direct level (ascending) the indices of
/// the descriptors below it, so that two pictures' descriptors are matched node by node.
struct WordedPicture {
  BagOfWords bag;
  struct Node {
    std::int32_t node;
    std::vector<std::int32_t> features;
  };
  std::vector<Node> nodes;
};

/// 1 - half the L1 distance of two bags: 1 for equal ones, 0 where no word is shared.
double similarity(const BagOfWords& a, const BagOfWords& b);

struct VocabularyOptions {
  int branching = 10;
  int levels = 4;
  int max_iterations = 20;
  int seed = 1;

  void visit(OptionVisitor& v) {
    v.field("branching", branching, {2, 64}, "", "children of a node");
    v.field("levels", levels, {1, 6}, "", "below the root; branching^levels words at most");
    v.field("max_iterations", max_iterations, {1, 1000}, "", "of k-majority at a node");
    v.field("seed", seed, {0, 1 << 30}, "", "of the starts");
  }
  void validate() const { validate_fields(*this, "VocabularyOptions"); }
};

/// A tree of binary words: each node's descriptor is the bitwise majority of those below it
/// (Galvez- Lopez and Tardos, Bags of Binary Words, T-RO 2012; k-majority as Grana et al. 2013). A
/// word's weight is log(pictures / pictures with it).
class BinaryVocabulary {
 public:
  /// pictures: the descriptors of each training picture. Throws Error when there are none.
  static BinaryVocabulary train(std::span<const std::vector<Descriptor>> pictures,
                                const VocabularyOptions& options);
  static BinaryVocabulary read(const std::string& path);
  void write(const std::string& path) const;

  int words() const { return words_; }
  int branching() const { return branching_; }
  int levels() const { return levels_; }
  /// Names the tree and its weights.
  std::uint64_t hash() const { return hash_; }

  struct Word {
    std::int32_t word;
    std::int32_t node;  // the one on the way at the asked level
  };
  /// Descends to the child of least Hamming distance, of equals the first. level: 0 = root.
  Word find(const Descriptor& descriptor, int level) const;
  double weight(std::int32_t word) const { return weight_[static_cast<std::size_t>(word)]; }

  /// direct_level: level of WordedPicture::nodes, 1 to levels().
  WordedPicture describe(std::span<const Descriptor> descriptors, int direct_level) const;

 private:
  BinaryVocabulary() = default;
  void number_words();
  void finish();
  struct Node {
    Descriptor descriptor{};
    std::int32_t first_child = 0;  // its children are consecutive
    std::int32_t children = 0;     // 0: a word
    std::int32_t word = -1;
  };
  int branching_ = 0;
  int levels_ = 0;
  int words_ = 0;
  std::int32_t pictures_ = 0;
  std::vector<Node> nodes_;  // breadth first, the root the first
  std::vector<std::int32_t> pictures_with_word_;
  std::vector<double> weight_;
  std::uint64_t hash_ = 0;
};

}  // namespace weft::slam
