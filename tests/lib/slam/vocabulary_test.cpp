#include "slam/vocabulary.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <set>

#include "base/blob.hpp"
#include "base/error.hpp"
#include "base/random.hpp"
#include "slam/place_index.hpp"
#include "support/files.hpp"

namespace weft::slam {
namespace {

Descriptor draw(Random& random) {
  return {random.bits(), random.bits(), random.bits(), random.bits()};
}
Descriptor disturbed(Random& random, Descriptor descriptor, int flips) {
  for (int i = 0; i < flips; ++i) {
    const auto bit = random.below(256);
    descriptor[bit / 64] ^= std::uint64_t{1} << (bit % 64);
  }
  return descriptor;
}
std::vector<Descriptor> draw_picture(Random& random, int size) {
  std::vector<Descriptor> out;
  for (int i = 0; i < size; ++i) out.push_back(draw(random));
  return out;
}

TEST(Hamming, CountsTheBits) {
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Descriptor a = draw(random), b = i % 3 ? draw(random) : disturbed(random, a, i % 7);
    int expected = 0;
    for (std::size_t k = 0; k < 4; ++k) expected += std::popcount(a[k] ^ b[k]);
    EXPECT_EQ(hamming_distance(a, b), expected);
  }
  const std::uint64_t ones = ~std::uint64_t{0};
  EXPECT_EQ(hamming_distance({0, 0, 0, 0}, {ones, ones, ones, ones}), 256);
}

TEST(Vocabulary, SeparatesWhatIsFarApart) {
  // 5 x 4 groups: five coarse ones far apart, in each four that differ in 40 bits.
  Random random(2);
  std::vector<Descriptor> centres;
  for (int coarse = 0; coarse < 5; ++coarse) {
    const Descriptor centre = draw(random);
    for (int fine = 0; fine < 4; ++fine) centres.push_back(disturbed(random, centre, 40));
  }
  std::vector<std::vector<Descriptor>> pictures(10);
  for (auto& picture : pictures) {
    for (const auto& centre : centres) picture.push_back(disturbed(random, centre, 4));
  }
  const auto vocabulary = BinaryVocabulary::train(pictures, {.branching = 5, .levels = 3});
  // What lands in one word is of one group.
  std::map<std::int32_t, std::set<std::size_t>> groups_of_word;
  for (const auto& picture : pictures) {
    for (std::size_t g = 0; g < picture.size(); ++g) {
      groups_of_word[vocabulary.find(picture[g], 3).word].insert(g);
    }
  }
  int mixed = 0;
  for (const auto& [word, groups] : groups_of_word) mixed += groups.size() > 1;
  EXPECT_LE(mixed, 1);
  EXPECT_GE(groups_of_word.size(), 19u);
}

TEST(Vocabulary, ALevelIsTheNearestOfTheMajorities) {
  // One level, two words: the majority of {000.., 100.., 010..} is 000..; of three disturbed ones
  // likewise. Hand-worked.
  const std::uint64_t ones = ~std::uint64_t{0};
  const Descriptor low{0, 0, 0, 0}, high{ones, ones, ones, ones};
  const auto flip = [](Descriptor d, int bit) {
    d[static_cast<std::size_t>(bit / 64)] ^= std::uint64_t{1} << (bit % 64);
    return d;
  };
  const std::vector<std::vector<Descriptor>> pictures{
      {flip(low, 0), flip(low, 70), flip(low, 255)}, {flip(high, 1), flip(high, 2), flip(high, 3)}};
  const auto vocabulary = BinaryVocabulary::train(pictures, {.branching = 2, .levels = 1});
  EXPECT_EQ(vocabulary.words(), 2);
  // 128 bits from both centres but for one: the border lies exactly between the majorities.
  Descriptor middle{ones, ones, 0, 0};
  EXPECT_EQ(vocabulary.find(flip(middle, 0), 1).word, vocabulary.find(low, 1).word);
  EXPECT_EQ(vocabulary.find(flip(middle, 200), 1).word, vocabulary.find(high, 1).word);
  EXPECT_NE(vocabulary.find(low, 1).word, vocabulary.find(high, 1).word);
}

TEST(Vocabulary, BagsHoldTfIdf) {
  Random random(3);
  const Descriptor a = draw(random), b = draw(random), c = draw(random);
  const std::vector<std::vector<Descriptor>> pictures{{a, a, b}, {a, c}, {a}, {c, c}};
  const auto vocabulary = BinaryVocabulary::train(pictures, {.branching = 3, .levels = 2});
  ASSERT_EQ(vocabulary.words(), 3);
  const auto word = [&](const Descriptor& d) { return vocabulary.find(d, 1).word; };
  EXPECT_DOUBLE_EQ(vocabulary.weight(word(a)), std::log(4.0 / 3.0));
  EXPECT_DOUBLE_EQ(vocabulary.weight(word(b)), std::log(4.0));
  EXPECT_DOUBLE_EQ(vocabulary.weight(word(c)), std::log(2.0));
  const std::vector<Descriptor> seen{b, a, c, a};
  const auto picture = vocabulary.describe(seen, 1);
  const double sum = 2 * std::log(4.0 / 3.0) + std::log(4.0) + std::log(2.0);
  ASSERT_EQ(picture.bag.size(), 3u);
  double total = 0.0;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto& entry = picture.bag[i];
    const double expected = entry.word == word(a)   ? 2 * std::log(4.0 / 3.0) / sum
                            : entry.word == word(b) ? std::log(4.0) / sum
                                                    : std::log(2.0) / sum;
    EXPECT_NEAR(entry.weight, expected, 1e-15);
    if (i > 0) {
      EXPECT_LT(picture.bag[i - 1].word, entry.word);
    }
    total += entry.weight;
  }
  EXPECT_NEAR(total, 1.0, 1e-12);
  EXPECT_TRUE(vocabulary.describe({}, 1).bag.empty());
}

TEST(Vocabulary, TheDirectIndexPartsTheFeatures) {
  Random random(4);
  std::vector<std::vector<Descriptor>> pictures;
  for (int i = 0; i < 5; ++i) pictures.push_back(draw_picture(random, 400));
  const auto vocabulary = BinaryVocabulary::train(pictures, {.branching = 6, .levels = 3});
  for (int level = 1; level <= 3; ++level) {
    const auto picture = vocabulary.describe(pictures[0], level);
    std::set<std::int32_t> seen;
    for (std::size_t n = 0; n < picture.nodes.size(); ++n) {
      if (n > 0) {
        EXPECT_LT(picture.nodes[n - 1].node, picture.nodes[n].node);
      }
      EXPECT_TRUE(
          std::is_sorted(picture.nodes[n].features.begin(), picture.nodes[n].features.end()));
      for (const auto feature : picture.nodes[n].features) {
        EXPECT_TRUE(seen.insert(feature).second);
        EXPECT_EQ(vocabulary.find(pictures[0][static_cast<std::size_t>(feature)], level).node,
                  picture.nodes[n].node);
      }
    }
    EXPECT_EQ(seen.size(), pictures[0].size());
    EXPECT_LE(picture.nodes.size(), static_cast<std::size_t>(std::pow(6, level)));
    if (level == 1) {
      EXPECT_EQ(picture.nodes.size(), 6u);
    }
  }
  EXPECT_THROW(vocabulary.describe(pictures[0], 0), Error);
  EXPECT_THROW(vocabulary.describe(pictures[0], 4), Error);
}

TEST(Vocabulary, TrainsTheSameTwiceAndComesBackFromItsFile) {
  Random random(5);
  std::vector<std::vector<Descriptor>> pictures;
  for (int i = 0; i < 4; ++i) pictures.push_back(draw_picture(random, 300));
  pictures.emplace_back();  // a picture without a corner
  const VocabularyOptions options{.branching = 7, .levels = 3};
  const auto a = BinaryVocabulary::train(pictures, options);
  const auto b = BinaryVocabulary::train(pictures, options);
  EXPECT_EQ(a.hash(), b.hash());
  test::TemporaryFolder folder;
  a.write(folder / "a.blob");
  b.write(folder / "b.blob");
  EXPECT_EQ(test::read_bytes(folder / "a.blob"), test::read_bytes(folder / "b.blob"));
  const auto back = BinaryVocabulary::read(folder / "a.blob");
  EXPECT_EQ(back.hash(), a.hash());
  EXPECT_EQ(back.words(), a.words());
  EXPECT_EQ(back.levels(), 3);
  for (int i = 0; i < 500; ++i) {
    const Descriptor d = draw(random);
    EXPECT_EQ(a.find(d, 2).word, back.find(d, 2).word);
    EXPECT_EQ(a.find(d, 2).node, back.find(d, 2).node);
    EXPECT_EQ(a.weight(a.find(d, 2).word), back.weight(back.find(d, 2).word));
  }
  const auto other = BinaryVocabulary::train(pictures, {.branching = 7, .levels = 3, .seed = 2});
  EXPECT_NE(other.hash(), a.hash());
}

TEST(Vocabulary, AFileThatIsNoTreeIsRefused) {
  test::TemporaryFolder folder;
  const auto write = [&](std::vector<std::uint8_t> children, std::vector<std::int32_t> counts) {
    BlobWriter blob("binary vocabulary", 1);
    blob.add_number("branching", std::int64_t{3});
    blob.add_number("levels", std::int64_t{2});
    blob.add_number("pictures", std::int64_t{5});
    blob.add("children", children);
    blob.add("descriptors", std::vector<std::uint8_t>(32 * children.size(), 0));
    blob.add("pictures_with_word", counts);
    blob.write(folder / "v.blob");
    return BinaryVocabulary::read(folder / "v.blob");
  };
  EXPECT_EQ(write({2, 0, 2, 0, 0}, {1, 5, 2}).words(), 3);
  EXPECT_THROW(write({}, {}), Error);
  EXPECT_THROW(write({2, 0}, {1}), Error);                    // children missing
  EXPECT_THROW(write({1, 0, 0}, {1, 1}), Error);              // a node without a parent
  EXPECT_THROW(write({4, 0, 0, 0, 0}, {1, 1, 1, 1}), Error);  // more than the branching
  EXPECT_THROW(write({1, 1, 1, 0}, {1}), Error);              // deeper than its levels
  EXPECT_THROW(write({2, 0, 0}, {1, 6}), Error);              // more pictures than there were
  EXPECT_THROW(write({2, 0, 0}, {1}), Error);
  EXPECT_THROW(BinaryVocabulary::train({}, {}), Error);
}

/// 1 - L1 / 2, word by word.
double plain_similarity(const BagOfWords& a, const BagOfWords& b) {
  std::map<std::int32_t, double> difference;
  for (const auto& [word, weight] : a) difference[word] += weight;
  for (const auto& [word, weight] : b) difference[word] -= weight;
  double sum = 0.0;
  for (const auto& [word, value] : difference) sum += std::abs(value);
  return 1.0 - 0.5 * sum;
}

BagOfWords draw_bag(Random& random, int words) {
  BagOfWords bag;
  double sum = 0.0;
  for (std::int32_t word = 0; word < words; ++word) {
    if (random.uniform() < 0.7) continue;
    bag.push_back({word, random.uniform(0.1, 1.0)});
    sum += bag.back().weight;
  }
  for (auto& entry : bag) entry.weight /= sum;
  return bag;
}

TEST(PlaceIndex, AnswersAsComparingWithAllPlaces) {
  Random random(6);
  PlaceIndex index(60);
  std::map<std::int64_t, BagOfWords> known;
  for (std::int64_t place = 0; place < 40; ++place) {
    known[place * 3] = draw_bag(random, 60);
    index.add(place * 3, known[place * 3]);
  }
  for (int round = 0; round < 30; ++round) {
    const auto gone =
        std::next(known.begin(), static_cast<std::ptrdiff_t>(random.below(known.size())))->first;
    index.remove(gone);
    known.erase(gone);
    const BagOfWords bag = draw_bag(random, 60);
    std::map<std::int64_t, int> shared;
    int most = 0;
    for (const auto& [place, other] : known) {
      for (const auto& entry : other) {
        shared[place] += std::any_of(bag.begin(), bag.end(),
                                     [&](const auto& mine) { return mine.word == entry.word; });
      }
      most = std::max(most, shared[place]);
    }
    const auto all = index.query(bag);
    std::erase_if(shared, [](const auto& s) { return s.second == 0; });
    EXPECT_EQ(all.size(), shared.size());
    for (std::size_t i = 0; i < all.size(); ++i) {
      EXPECT_NEAR(all[i].score, plain_similarity(bag, known.at(all[i].place)), 1e-12);
      EXPECT_NEAR(all[i].score, similarity(bag, known.at(all[i].place)), 1e-12);
      EXPECT_EQ(all[i].shared_words, shared[all[i].place]);
      if (i > 0) {
        EXPECT_GE(all[i - 1].score, all[i].score);
      }
    }
    const auto some = index.query(bag, 0.8);
    const auto expected = std::count_if(shared.begin(), shared.end(),
                                        [&](const auto& s) { return s.second >= 0.8 * most; });
    EXPECT_EQ(static_cast<std::ptrdiff_t>(some.size()), expected);
  }
  EXPECT_EQ(index.size(), 10);
}

TEST(PlaceIndex, FindsAPlaceSeenAgain) {
  // Each place has corners of its own; half are seen again, with 20 flipped bits.
  Random random(7);
  std::vector<std::vector<Descriptor>> places;
  for (int i = 0; i < 30; ++i) places.push_back(draw_picture(random, 300));
  const auto vocabulary = BinaryVocabulary::train(places, {.branching = 10, .levels = 3});
  PlaceIndex index(vocabulary.words());
  for (std::size_t i = 0; i < places.size(); ++i) {
    index.add(static_cast<std::int64_t>(i), vocabulary.describe(places[i], 2).bag);
  }
  int found = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    auto again = draw_picture(random, 150);
    for (std::size_t k = 0; k < 150; ++k) again.push_back(disturbed(random, places[i][k], 20));
    const auto candidates = index.query(vocabulary.describe(again, 2).bag, 0.8);
    ASSERT_FALSE(candidates.empty());
    found += candidates[0].place == static_cast<std::int64_t>(i);
  }
  EXPECT_EQ(found, 30);
}

TEST(PlaceIndex, WhatCannotBeIsRefused) {
  EXPECT_THROW(PlaceIndex(0), Error);
  PlaceIndex index(5);
  index.add(1, {{2, 1.0}});
  EXPECT_THROW(index.add(1, {{3, 1.0}}), Error);
  EXPECT_THROW(index.add(2, {{5, 1.0}}), Error);
  EXPECT_THROW(index.add(2, {{-1, 1.0}}), Error);
  EXPECT_THROW(index.remove(2), Error);
  EXPECT_THROW(index.query({{5, 1.0}}), Error);
  EXPECT_EQ(index.size(), 1);
  index.remove(1);
  EXPECT_TRUE(index.query({{2, 1.0}}).empty());
}

}  // namespace
}  // namespace weft::slam
