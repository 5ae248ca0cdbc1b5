#include "slam/matching.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "base/random.hpp"

namespace weft::slam {
namespace {

Descriptor noise(Random& random) {
  return {random.bits(), random.bits(), random.bits(), random.bits()};
}

Descriptor flip(Descriptor d, int bits, Random& random) {
  for (int i = 0; i < bits; ++i) {
    const auto bit = random.below(256);
    d[bit / 64] ^= std::uint64_t{1} << (bit % 64);
  }
  return d;
}

std::vector<Feature> scattered(int count, Random& random) {
  std::vector<Feature> out(static_cast<std::size_t>(count));
  for (auto& f : out) {
    f.u_px = static_cast<float>(random.uniform(0.0, 639.0));
    f.v_px = static_cast<float>(random.uniform(0.0, 479.0));
    f.level = static_cast<int>(random.below(4));
    f.descriptor = noise(random);
  }
  return out;
}

TEST(FeatureGrid, FindsWhatIsNear) {
  Random random(1);
  auto features = scattered(800, random);
  features[0].u_px = -3.0f;  // beyond the border
  features[1].v_px = 500.0f;
  features[2].u_px = 639.9f;
  const FeatureGrid grid(features, 640, 480);
  for (int i = 0; i < 300; ++i) {
    const double u = random.uniform(-30.0, 670.0), v = random.uniform(-30.0, 510.0);
    const double radius = random.uniform(0.0, 60.0);
    std::vector<int> found, expected;
    grid.near(u, v, radius, [&](int index) { found.push_back(index); });
    for (int k = 0; k < 800; ++k) {
      const auto& f = features[static_cast<std::size_t>(k)];
      if (std::abs(f.u_px - u) <= radius && std::abs(f.v_px - v) <= radius) expected.push_back(k);
    }
    std::sort(found.begin(), found.end());
    ASSERT_EQ(found, expected);
  }
}

TEST(FeatureGrid, MayBeEmpty) {
  const FeatureGrid grid({}, 640, 480);
  grid.near(1e30, -1e30, 1e30, [](int) { FAIL(); });
}

/// Rules of match_by_place spelt out.
std::vector<Match> slow_by_place(const std::vector<Sought>& sought,
                                 const std::vector<Feature>& features, int max_distance,
                                 double ratio, const std::vector<std::uint8_t>& taken) {
  std::map<int, Match> of_feature;
  for (int i = 0; i < static_cast<int>(sought.size()); ++i) {
    const auto& s = sought[static_cast<std::size_t>(i)];
    std::vector<std::pair<int, int>> ranked;  // distance, feature
    for (int k = 0; k < static_cast<int>(features.size()); ++k) {
      const auto& f = features[static_cast<std::size_t>(k)];
      if (!taken.empty() && taken[static_cast<std::size_t>(k)]) continue;
      if (std::abs(f.u_px - s.u_px) > s.radius_px || std::abs(f.v_px - s.v_px) > s.radius_px)
        continue;
      if (f.level < s.min_level || f.level > s.max_level) continue;
      ranked.push_back({hamming_distance(s.descriptor, f.descriptor), k});
    }
    std::sort(ranked.begin(), ranked.end());
    if (ranked.empty() || ranked[0].first > max_distance) continue;
    const auto level = [&](std::size_t k) {
      return features[static_cast<std::size_t>(ranked[k].second)].level;
    };
    if (ranked.size() > 1 && level(0) == level(1) && ranked[0].first > ratio * ranked[1].first)
      continue;
    const Match match{i, ranked[0].second, ranked[0].first};
    const auto held = of_feature.find(match.feature);
    if (held == of_feature.end() || held->second.distance > match.distance)
      of_feature[match.feature] = match;
  }
  std::vector<Match> out;
  for (const auto& [feature, match] : of_feature) out.push_back(match);
  std::sort(out.begin(), out.end(),
            [](const Match& a, const Match& b) { return a.sought < b.sought; });
  return out;
}

TEST(MatchByPlace, EqualsTheRules) {
  Random random(2);
  for (int round = 0; round < 20; ++round) {
    const auto features = scattered(400, random);
    std::vector<Sought> sought;
    for (int i = 0; i < 300; ++i) {
      const auto& f = features[random.below(features.size())];
      Sought s;
      s.u_px = f.u_px + static_cast<float>(random.uniform(-12.0, 12.0));
      s.v_px = f.v_px + static_cast<float>(random.uniform(-12.0, 12.0));
      s.radius_px = static_cast<float>(random.uniform(5.0, 40.0));
      s.min_level = f.level - 1;
      s.max_level = f.level + 1;
      s.descriptor = flip(f.descriptor, static_cast<int>(random.below(120)), random);
      sought.push_back(s);
    }
    std::vector<std::uint8_t> taken;
    if (round % 2 == 1)
      for (std::size_t k = 0; k < features.size(); ++k)
        taken.push_back(random.below(3) == 0 ? 1 : 0);
    const FeatureGrid grid(features, 640, 480);
    const auto found = match_by_place(sought, grid, 80, 0.9, taken);
    const auto expected = slow_by_place(sought, features, 80, 0.9, taken);
    ASSERT_GT(expected.size(), 50u);
    ASSERT_EQ(found.size(), expected.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_EQ(found[i].sought, expected[i].sought);
      EXPECT_EQ(found[i].feature, expected[i].feature);
      EXPECT_EQ(found[i].distance, expected[i].distance);
    }
  }
}

TEST(MatchByLooks, FindsThePermutation) {
  Random random(3);
  const auto a = scattered(300, random);
  std::vector<std::size_t> order(300);
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  random.shuffle(order.begin(), order.end());
  std::vector<Feature> b;
  for (const auto i : order) {
    b.push_back(a[i]);
    b.back().descriptor = flip(a[i].descriptor, 20, random);
  }
  for (const auto& f : scattered(100, random)) b.push_back(f);
  const auto matches = match_by_looks(a, b, 64, 0.8);
  EXPECT_EQ(matches.size(), 300u);
  for (const auto& m : matches) {
    ASSERT_LT(m.feature, 300);
    EXPECT_EQ(order[static_cast<std::size_t>(m.feature)], static_cast<std::size_t>(m.sought));
  }
}

TEST(MatchByLooks, LeavesDoubtfulOnesOut) {
  Random random(4);
  std::vector<Feature> a(3), b(3);
  a[0].descriptor = noise(random);
  b[0].descriptor = flip(a[0].descriptor, 10, random);
  b[1].descriptor = flip(a[0].descriptor, 11, random);  // as good: which is it?
  a[1].descriptor = noise(random);
  b[2].descriptor = flip(a[1].descriptor, 30, random);
  a[2].descriptor = flip(b[2].descriptor, 3, random);  // is it rather
  const auto matches = match_by_looks(a, b, 64, 0.8);
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].sought, 2);
  EXPECT_EQ(matches[0].feature, 2);
  EXPECT_TRUE(match_by_looks(a, b, 1, 0.8).empty());
  EXPECT_TRUE(match_by_looks(a, {}, 64, 0.8).empty());
  EXPECT_TRUE(match_by_looks({}, b, 64, 0.8).empty());
}

TEST(KeepCommonTurn, LeavesOthersOut) {
  std::vector<Match> matches;
  std::vector<float> turns;
  for (int i = 0; i < 100; ++i) {
    matches.push_back({i, i, 0});
    turns.push_back(i % 10 == 0 ? static_cast<float>(i * 37) : (i % 2 == 0 ? 359.0f : -358.5f));
  }
  keep_common_turn(matches, turns);
  int common = 0;
  for (const auto& m : matches) common += m.sought % 10 != 0;
  EXPECT_EQ(common, 90);
  EXPECT_LT(matches.size(), 95u);
  std::vector<Match> none;
  keep_common_turn(none, {});
  EXPECT_TRUE(none.empty());
}

}  // namespace
}  // namespace weft::slam
