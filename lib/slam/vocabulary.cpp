#include "slam/vocabulary.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "base/blob.hpp"
#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/random.hpp"

namespace weft::slam {
namespace {

constexpr std::uint32_t kVersion = 1;
constexpr const char* kKind = "binary vocabulary";

/// k-majority: k-means with Hamming distances and bitwise majorities for means. Returns the
/// centres; group: which of them each sample belongs to. Samples: indices into descriptors.
std::vector<Descriptor> cluster(const std::vector<Descriptor>& descriptors,
                                std::span<const std::int32_t> samples, int k, int max_iterations,
                                Random& random, std::vector<std::int32_t>& group) {
  const auto at = [&](std::size_t i) -> const Descriptor& {
    return descriptors[static_cast<std::size_t>(samples[i])];
  };
  // k-means++: the next centre is a sample, by its squared distance to the nearest so far.
  std::vector<Descriptor> centres{at(random.below(samples.size()))};
  std::vector<std::uint64_t> squared(samples.size(), std::numeric_limits<std::uint32_t>::max());
  while (static_cast<int>(centres.size()) < k) {
    std::uint64_t sum = 0;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const auto distance = static_cast<std::uint64_t>(hamming_distance(at(i), centres.back()));
      squared[i] = std::min(squared[i], distance * distance);
      sum += squared[i];
    }
    if (sum == 0) break;  // no more distinct samples
    std::uint64_t left = random.below(sum);
    std::size_t chosen = 0;
    while (left >= squared[chosen]) left -= squared[chosen++];
    centres.push_back(at(chosen));
  }
  group.assign(samples.size(), -1);
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    bool moved = false;
    for (std::size_t i = 0; i < samples.size(); ++i) {
      std::int32_t best = 0;
      int least = std::numeric_limits<int>::max();
      for (std::size_t c = 0; c < centres.size(); ++c) {
        const int distance = hamming_distance(at(i), centres[c]);
        if (distance < least) {
          least = distance;
          best = static_cast<std::int32_t>(c);
        }
      }
      moved = moved || best != group[i];
      group[i] = best;
    }
    if (!moved || iteration + 1 == max_iterations) break;
    std::vector<std::array<std::int32_t, 256>> ones(centres.size());
    std::vector<std::int32_t> size(centres.size(), 0);
    for (auto& counts : ones) counts.fill(0);
    for (std::size_t i = 0; i < samples.size(); ++i) {
      auto& counts = ones[static_cast<std::size_t>(group[i])];
      ++size[static_cast<std::size_t>(group[i])];
      for (std::size_t bit = 0; bit < 256; ++bit) {
        counts[bit] += static_cast<std::int32_t>(at(i)[bit / 64] >> (bit % 64) & 1u);
      }
    }
    for (std::size_t c = 0; c < centres.size(); ++c) {
      for (std::size_t bit = 0; bit < 256; ++bit) {
        const std::uint64_t mask = std::uint64_t{1} << (bit % 64);
        if (2 * ones[c][bit] > size[c]) centres[c][bit / 64] |= mask;
        if (2 * ones[c][bit] < size[c]) centres[c][bit / 64] &= ~mask;  // a tie stays as it was
      }
    }
  }
  return centres;
}

}  // namespace

double similarity(const BagOfWords& a, const BagOfWords& b) {
  double sum = 0.0;
  for (auto i = a.begin(), j = b.begin(); i != a.end() && j != b.end();) {
    if (i->word < j->word) {
      ++i;
    } else if (j->word < i->word) {
      ++j;
    } else {
      sum += std::min(i++->weight, j++->weight);
    }
  }
  return sum;
}

BinaryVocabulary BinaryVocabulary::train(std::span<const std::vector<Descriptor>> pictures,
                                         const VocabularyOptions& options) {
  options.validate();
  std::vector<Descriptor> all;
  for (const auto& picture : pictures) all.insert(all.end(), picture.begin(), picture.end());
  if (all.empty()) throw Error("vocabulary: the training pictures have no descriptors");
  if (all.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max())) {
    throw Error("vocabulary: more than 2^31 descriptors; train on fewer pictures");
  }
  BinaryVocabulary out;
  out.branching_ = options.branching;
  out.levels_ = options.levels;
  out.pictures_ = static_cast<std::int32_t>(pictures.size());
  Random random(static_cast<std::uint64_t>(options.seed));
  // Breadth first; a node's samples lie side by side in `order`.
  std::vector<std::int32_t> order(all.size());
  std::iota(order.begin(), order.end(), 0);
  struct Span {
    std::size_t begin, end;
    int level;
  };
  std::vector<Span> spans{{0, all.size(), 0}};
  out.nodes_.push_back({});
  std::vector<std::int32_t> group, sorted;
  for (std::size_t node = 0; node < out.nodes_.size(); ++node) {
    const Span span = spans[node];
    if (span.level == options.levels) continue;
    const auto samples = std::span(order).subspan(span.begin, span.end - span.begin);
    const auto centres =
        cluster(all, samples, options.branching, options.max_iterations, random, group);
    std::vector<std::size_t> size(centres.size(), 0);
    for (const std::int32_t g : group) ++size[static_cast<std::size_t>(g)];
    if (std::count_if(size.begin(), size.end(), [](std::size_t n) { return n > 0; }) < 2) continue;
    out.nodes_[node].first_child = static_cast<std::int32_t>(out.nodes_.size());
    sorted.clear();
    for (std::size_t c = 0; c < centres.size(); ++c) {
      if (size[c] == 0) continue;
      const std::size_t begin = span.begin + sorted.size();
      for (std::size_t i = 0; i < samples.size(); ++i) {
        if (group[i] == static_cast<std::int32_t>(c)) sorted.push_back(samples[i]);
      }
      spans.push_back({begin, span.begin + sorted.size(), span.level + 1});
      out.nodes_.push_back({centres[c]});
      ++out.nodes_[node].children;
    }
    std::copy(sorted.begin(), sorted.end(), samples.begin());
  }
  out.number_words();
  // In how many pictures a word is. Found by descent, as later: a sample's own leaf may differ.
  out.pictures_with_word_.assign(static_cast<std::size_t>(out.words_), 0);
  std::vector<std::int32_t> last(static_cast<std::size_t>(out.words_), -1);
  for (std::size_t p = 0; p < pictures.size(); ++p) {
    for (const Descriptor& descriptor : pictures[p]) {
      const auto word = static_cast<std::size_t>(out.find(descriptor, 0).word);
      if (last[word] == static_cast<std::int32_t>(p)) continue;
      last[word] = static_cast<std::int32_t>(p);
      ++out.pictures_with_word_[word];
    }
  }
  out.finish();
  return out;
}

void BinaryVocabulary::number_words() {
  words_ = 0;
  for (Node& node : nodes_) node.word = node.children == 0 ? words_++ : -1;
}

void BinaryVocabulary::finish() {
  weight_.resize(static_cast<std::size_t>(words_));
  for (std::size_t w = 0; w < weight_.size(); ++w) {
    // A word no picture has says as much as one that a single picture has.
    weight_[w] = std::log(static_cast<double>(pictures_) /
                          static_cast<double>(std::max(1, pictures_with_word_[w])));
  }
  Hash64 hash;
  hash.add(static_cast<std::uint64_t>(pictures_));
  for (const Node& node : nodes_) {
    hash.add(node.descriptor.data(), sizeof node.descriptor);
    hash.add(static_cast<std::uint64_t>(node.children));
  }
  hash.add(pictures_with_word_.data(), pictures_with_word_.size() * sizeof(std::int32_t));
  hash_ = hash.value();
}

void BinaryVocabulary::write(const std::string& path) const {
  BlobWriter blob(kKind, kVersion);
  std::vector<std::uint8_t> descriptors(nodes_.size() * sizeof(Descriptor));
  std::vector<std::uint8_t> children;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    std::memcpy(descriptors.data() + i * sizeof(Descriptor), nodes_[i].descriptor.data(),
                sizeof(Descriptor));
    children.push_back(static_cast<std::uint8_t>(nodes_[i].children));
  }
  blob.add_number("branching", static_cast<std::int64_t>(branching_));
  blob.add_number("levels", static_cast<std::int64_t>(levels_));
  blob.add_number("pictures", static_cast<std::int64_t>(pictures_));
  blob.add("descriptors", descriptors);
  blob.add("children", children);
  blob.add("pictures_with_word", pictures_with_word_);
  blob.write(path);
}

BinaryVocabulary BinaryVocabulary::read(const std::string& path) {
  const auto blob = BlobReader::from_file(path, kKind, kVersion);
  BinaryVocabulary out;
  out.branching_ = static_cast<int>(blob.integer("branching", 2, 64));
  out.levels_ = static_cast<int>(blob.integer("levels", 1, 6));
  out.pictures_ = static_cast<std::int32_t>(blob.integer("pictures", 1, 1 << 30));
  const auto children = blob.values<std::uint8_t>("children");
  if (children.empty() || children.size() > (1u << 24)) blob.fail("it has no nodes, or too many");
  const auto descriptors =
      blob.values<std::uint8_t>("descriptors", children.size() * sizeof(Descriptor));
  out.nodes_.resize(children.size());
  // Breadth first: the children of one node follow those of the node before.
  std::size_t next = 1;
  std::vector<int> level(children.size(), 0);
  for (std::size_t i = 0; i < children.size(); ++i) {
    Node& node = out.nodes_[i];
    std::memcpy(node.descriptor.data(), descriptors.data() + i * sizeof(Descriptor),
                sizeof(Descriptor));
    node.children = children[i];
    if (node.children == 0) continue;
    if (node.children > out.branching_ || level[i] >= out.levels_ || next <= i ||
        children.size() - next < children[i]) {
      blob.fail("node " + std::to_string(i) + " has " + std::to_string(node.children) +
                " children where the tree has no room for them");
    }
    node.first_child = static_cast<std::int32_t>(next);
    for (int c = 0; c < node.children; ++c) level[next++] = level[i] + 1;
  }
  if (next != children.size()) blob.fail("nodes without a parent");
  out.number_words();
  out.pictures_with_word_ =
      blob.values<std::int32_t>("pictures_with_word", static_cast<std::size_t>(out.words_));
  for (const std::int32_t n : out.pictures_with_word_) {
    if (n < 0 || n > out.pictures_) blob.fail("a word is in more pictures than there were");
  }
  out.finish();
  return out;
}

BinaryVocabulary::Word BinaryVocabulary::find(const Descriptor& descriptor, int level) const {
  std::int32_t at = 0;
  std::int32_t passed = 0;
  for (int depth = 0; nodes_[static_cast<std::size_t>(at)].children > 0; ++depth) {
    const Node& node = nodes_[static_cast<std::size_t>(at)];
    int least = std::numeric_limits<int>::max();
    for (std::int32_t child = node.first_child; child < node.first_child + node.children; ++child) {
      const int distance =
          hamming_distance(descriptor, nodes_[static_cast<std::size_t>(child)].descriptor);
      if (distance < least) {
        least = distance;
        at = child;
      }
    }
    if (depth < level) passed = at;
  }
  return {nodes_[static_cast<std::size_t>(at)].word, passed};
}

WordedPicture BinaryVocabulary::describe(std::span<const Descriptor> descriptors,
                                         int direct_level) const {
  if (direct_level < 1 || direct_level > levels_) {
    throw Error("vocabulary: direct level " + std::to_string(direct_level) + "; expected 1 to " +
                std::to_string(levels_));
  }
  std::vector<std::int32_t> words;
  std::vector<std::pair<std::int32_t, std::int32_t>> nodes;
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    const Word found = find(descriptors[i], direct_level);
    words.push_back(found.word);
    nodes.emplace_back(found.node, static_cast<std::int32_t>(i));
  }
  std::sort(words.begin(), words.end());
  std::sort(nodes.begin(), nodes.end());
  WordedPicture out;
  double sum = 0.0;
  for (std::size_t i = 0; i < words.size();) {
    std::size_t end = i;
    while (end < words.size() && words[end] == words[i]) ++end;
    const double weight = static_cast<double>(end - i) * this->weight(words[i]);
    if (weight > 0.0) out.bag.push_back({words[i], weight});
    sum += weight;
    i = end;
  }
  for (WordWeight& word : out.bag) word.weight /= sum;
  for (const auto& [node, feature] : nodes) {
    if (out.nodes.empty() || out.nodes.back().node != node) out.nodes.push_back({node, {}});
    out.nodes.back().features.push_back(feature);
  }
  return out;
}

}  // namespace weft::slam
