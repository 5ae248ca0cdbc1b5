#include "detector/refiner.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/ml.hpp>

#include "base/error.hpp"
#include "base/random.hpp"
#include "detector/chi2_kernel.hpp"

namespace weft::detector {
namespace {

bovw::WordGrid random_grid(Random& random, int columns, int rows, int words) {
  bovw::WordGrid grid;
  grid.vocabulary_size = words;
  grid.columns = columns;
  grid.rows = rows;
  grid.origin_x = 11.0;
  grid.origin_y = 7.5;
  grid.view.width = columns * 6 + 30;
  grid.view.height = rows * 6 + 30;
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const double dx = (c - columns / 2.0) / columns, dy = (r - rows / 2.0) / rows;
      const bool garment = dx * dx + dy * dy < 0.2;
      grid.cells.push_back(!garment                 ? bovw::WordGrid::kOutsideMask
                           : random.uniform() < 0.1 ? bovw::WordGrid::kNoWord
                                                    : static_cast<std::int16_t>(random.below(
                                                          static_cast<std::uint64_t>(words))));
    }
  }
  return grid;
}

RefineModel random_model(Random& random, const std::string& part, std::vector<int> block_words,
                         int vectors) {
  RefineModel model;
  model.part = part;
  model.shapes = {{9, 7}, {7, 9}, {12, 5}, {4, 4}};
  model.block_words = std::move(block_words);
  for (int i = 0; i < vectors; ++i) {
    for (int w = 0; w < model.words(); ++w) {
      model.counts.push_back(random.uniform() < 0.5 ? 0
                                                    : static_cast<std::uint16_t>(random.below(9)));
    }
    model.coefficients.push_back(random.uniform(-2.0, 2.0));
  }
  model.gamma = random.uniform(0.5, 2.0);
  model.rho = random.uniform(-0.2, 0.2);
  model.platt_a = -1.5;
  model.platt_b = 0.3;
  return model;
}

std::vector<double> l1(const std::vector<int>& counts, const std::vector<int>& block_words) {
  std::vector<double> h;
  std::size_t at = 0;
  for (const int words : block_words) {
    double total = 0.0;
    for (int w = 0; w < words; ++w) total += counts[at + static_cast<std::size_t>(w)];
    for (int w = 0; w < words; ++w) {
      h.push_back(total > 0 ? counts[at + static_cast<std::size_t>(w)] / total : 0.0);
    }
    at += static_cast<std::size_t>(words);
  }
  return h;
}

double brute_distance(const std::vector<double>& x, const std::vector<double>& t) {
  double d = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (x[i] + t[i] > 0) d += (x[i] - t[i]) * (x[i] - t[i]) / (x[i] + t[i]);
  }
  return d;
}

std::vector<int> vector_counts(const RefineModel& m, int i) {
  const auto begin = m.counts.begin() + static_cast<std::ptrdiff_t>(i) * m.words();
  return {begin, begin + m.words()};
}

double brute_decision(const RefineModel& m, const std::vector<int>& counts) {
  double sum = -m.rho;
  for (int i = 0; i < m.support_vectors(); ++i) {
    const double d =
        brute_distance(l1(counts, m.block_words), l1(vector_counts(m, i), m.block_words));
    sum += m.coefficients[static_cast<std::size_t>(i)] * std::exp(-m.gamma * d);
  }
  return sum;
}

std::vector<int> brute_counts(const std::vector<const bovw::WordGrid*>& grids, int column, int row,
                              GridShape shape) {
  std::vector<int> counts;
  for (const auto* grid : grids) {
    std::vector<int> block(static_cast<std::size_t>(grid->vocabulary_size), 0);
    for (int r = 0; r < grid->rows; ++r) {
      for (int c = 0; c < grid->columns; ++c) {
        if (c < column || c >= column + shape.columns || r < row || r >= row + shape.rows) continue;
        if (grid->at(c, r) >= 0) ++block[static_cast<std::size_t>(grid->at(c, r))];
      }
    }
    counts.insert(counts.end(), block.begin(), block.end());
  }
  return counts;
}

TEST(Chi2Distance, EqualsTheDefinition) {
  Random random(1);
  for (int trial = 0; trial < 50; ++trial) {
    const auto m = random_model(random, "jeans hips", {20, 13}, 2);
    const double expected = brute_distance(l1(vector_counts(m, 0), m.block_words),
                                           l1(vector_counts(m, 1), m.block_words));
    EXPECT_NEAR(chi2_distance(m.counts.data(), m.counts.data() + 33, m.block_words), expected,
                1e-14);
  }
  const std::uint16_t empty[3] = {0, 0, 0}, one[3] = {0, 5, 0};
  EXPECT_DOUBLE_EQ(chi2_distance(empty, empty, {3}), 0.0);
  EXPECT_DOUBLE_EQ(chi2_distance(empty, one, {3}), 1.0);
  EXPECT_DOUBLE_EQ(chi2_distance(one, one, {3}), 0.0);
}

TEST(Chi2Kernel, EveryInstructionSetGivesTheSameBits) {
  const auto avx2 = chi2::avx2_kernel();
  if (avx2 == nullptr) GTEST_SKIP() << "this machine has no AVX2";
  Random random(2);
  const int blocks = 3, words = 70;
  std::vector<float> shares, sums(blocks * chi2::kBlock), coefficients(blocks * chi2::kBlock);
  for (int i = 0; i < blocks * words * chi2::kBlock; ++i) {
    shares.push_back(random.uniform() < 0.4 ? 0.0f : static_cast<float>(random.uniform() / 20));
  }
  for (auto& s : sums) s = static_cast<float>(random.uniform(0.0, 2.0));
  for (auto& c : coefficients) c = static_cast<float>(random.normal());
  for (const float gamma : {0.1f, 1.0f, 3.0f, 500.0f}) {
    const chi2::Model model{shares.data(), sums.data(), coefficients.data(), blocks, words, gamma};
    std::vector<chi2::Entry> entries;
    for (int w = 0; w < words; w += 2) entries.push_back({w, static_cast<float>(random.uniform())});
    const chi2::Histogram h[2] = {{entries.data(), static_cast<std::int32_t>(entries.size()), 1.0f},
                                  {entries.data(), 5, 1.0f}};
    double baseline[2], wide[2];
    chi2::decide_baseline(model, h, 2, baseline);
    avx2(model, h, 2, wide);
    EXPECT_EQ(baseline[0], wide[0]);
    EXPECT_EQ(baseline[1], wide[1]);
  }
}

TEST(Refiner, DecisionEqualsTheDefinition) {
  Random random(3);
  for (const int vectors : {1, 31, 32, 100}) {
    const auto model = random_model(random, "jeans hips", {40, 25}, vectors);
    const Refiner refiner({model}, {});
    for (int trial = 0; trial < 20; ++trial) {
      std::vector<int> counts;
      for (int w = 0; w < 65; ++w) {
        counts.push_back(random.uniform() < 0.5 ? 0 : static_cast<int>(random.below(30)));
      }
      if (trial == 0) std::fill(counts.begin() + 40, counts.end(), 0);  // one descriptor is silent
      EXPECT_NEAR(refiner.decide(0, counts), brute_decision(model, counts), 2e-6 * vectors);
    }
    EXPECT_EQ(refiner.decide(0, std::vector<int>(65, 0)), -std::numeric_limits<double>::infinity());
  }
}

// OpenCV's chi-squared SVM kernel is exp(-gamma sum (x-t)^2 / (x+t)) too.
TEST(Refiner, DecisionEqualsOpenCvsChi2Svm) {
  Random random(4);
  const int words = 30, samples = 60;
  cv::Mat data(samples, words, CV_32F), labels(samples, 1, CV_32S);
  std::vector<std::vector<int>> counts;
  for (int i = 0; i < samples; ++i) {
    std::vector<int> h;
    for (int w = 0; w < words; ++w) {
      h.push_back(static_cast<int>(random.below(w % 2 == i % 2 ? 12 : 5)));
    }
    counts.push_back(h);
    const auto x = l1(h, {words});
    for (int w = 0; w < words; ++w) {
      data.at<float>(i, w) = static_cast<float>(x[static_cast<std::size_t>(w)]);
    }
    labels.at<int>(i) = i % 2 == 0 ? 1 : -1;
  }
  const auto svm = cv::ml::SVM::create();
  svm->setKernel(cv::ml::SVM::CHI2);
  svm->setGamma(1.7);
  svm->setC(2.0);
  ASSERT_TRUE(svm->train(data, cv::ml::ROW_SAMPLE, labels));
  cv::Mat alpha, index;
  RefineModel model;
  model.part = "polo collar";
  model.shapes = {{3, 3}};
  model.block_words = {words};
  model.gamma = 1.7;
  model.rho = svm->getDecisionFunction(0, alpha, index);
  // OpenCV keeps its support vectors as L1 shares: find the samples they came from.
  const cv::Mat vectors = svm->getSupportVectors();
  for (int k = 0; k < index.cols * index.rows; ++k) {
    const auto row = vectors.row(index.at<int>(k));
    int sample = 0;
    while (sample < samples && cv::norm(row, data.row(sample)) > 1e-6) ++sample;
    ASSERT_LT(sample, samples);
    for (const int n : counts[static_cast<std::size_t>(sample)]) {
      model.counts.push_back(static_cast<std::uint16_t>(n));
    }
    model.coefficients.push_back(alpha.at<double>(k));
  }
  const Refiner refiner({model}, {});
  cv::Mat raw;
  svm->predict(data, raw, cv::ml::StatModel::RAW_OUTPUT);
  for (int i = 0; i < samples; ++i) {
    EXPECT_NEAR(std::abs(refiner.decide(0, counts[static_cast<std::size_t>(i)])),
                std::abs(raw.at<float>(i)), 1e-4);
  }
}

class RefineFrame : public ::testing::TestWithParam<int> {};

TEST_P(RefineFrame, KeepsTheBestWindowOfEachCandidate) {
  Random random(static_cast<std::uint64_t>(GetParam()));
  auto a = random_grid(random, 40, 30, 16);
  auto b = random_grid(random, 40, 30, 9);
  for (std::size_t i = 0; i < a.cells.size(); ++i) {
    if (a.cells[i] == bovw::WordGrid::kOutsideMask) b.cells[i] = a.cells[i];
  }
  const std::vector<const bovw::WordGrid*> grids = {&a, &b};
  const std::vector<RefineModel> models = {random_model(random, "jeans hips", {16, 9}, 70),
                                           random_model(random, "polo collar", {16, 9}, 33)};
  RefinerOptions options;
  options.max_overlap = 1.0;  // keep repeats: they are tested below
  const Refiner refiner(models, options);
  std::vector<Candidate> candidates;
  for (int i = 0; i < 8; ++i) {
    Candidate c;
    c.part = i % 2 == 0 ? "jeans hips" : "polo collar";
    c.column = static_cast<int>(random.below(40));
    c.row = static_cast<int>(random.below(30));
    c.prior = i < 4 ? 1.0 : 0.5;
    candidates.push_back(c);
  }
  candidates.push_back(candidates[0]);

  std::vector<Detection> expected;
  for (const auto& c : candidates) {
    const auto& model = models[c.part == "jeans hips" ? 0 : 1];
    double best = -1e300;
    Detection d;
    for (const auto& shape : model.shapes) {
      for (int dy = -4; dy <= 4; dy += 2) {
        for (int dx = -4; dx <= 4; dx += 2) {
          const int column = c.column + dx, row = c.row + dy;
          if (column < 0 || row < 0 || column >= 40 || row >= 30) continue;
          if (a.at(column, row) == bovw::WordGrid::kOutsideMask) continue;
          const auto counts =
              brute_counts(grids, column - shape.columns / 2, row - shape.rows / 2, shape);
          if (std::all_of(counts.begin(), counts.end(), [](int n) { return n == 0; })) continue;
          const double f = brute_decision(model, counts);
          if (f <= best) continue;
          best = f;
          d.part = c.part;
          d.probability = c.prior / (1.0 + std::exp(model.platt_a * f + model.platt_b));
          d.box_view = {11.0 + (column - shape.columns / 2 - 0.5) * 6.0,
                        7.5 + (row - shape.rows / 2 - 0.5) * 6.0, shape.columns * 6.0,
                        shape.rows * 6.0};
        }
      }
    }
    if (!d.part.empty()) expected.push_back(d);
  }
  std::stable_sort(expected.begin(), expected.end(), [](const Detection& x, const Detection& y) {
    return x.probability > y.probability;
  });

  const auto found = refiner.refine(grids, candidates);
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(found[i].probability, expected[i].probability, 1e-4);
    EXPECT_EQ(found[i].part, expected[i].part);
    EXPECT_EQ(found[i].box_view.x, expected[i].box_view.x);
    EXPECT_EQ(found[i].box_view.y, expected[i].box_view.y);
    EXPECT_EQ(found[i].box_view.width, expected[i].box_view.width);
    const auto& box = found[i].box_view;
    EXPECT_EQ(found[i].centre_sensor_px.x(), box.x + box.width / 2);  // a sensor view
    EXPECT_EQ(found[i].corners_sensor_px[2].y(), box.y + box.height);
  }
  for (const int threads : {2, 3, 8}) {
    const auto again = refiner.refine(grids, candidates, threads);
    ASSERT_EQ(again.size(), found.size());
    for (std::size_t i = 0; i < found.size(); ++i) {
      EXPECT_EQ(again[i].probability, found[i].probability);
      EXPECT_EQ(again[i].box_view.x, found[i].box_view.x);
    }
  }

  // The candidate given twice is one detection when overlapping ones are suppressed.
  const auto suppressed = Refiner(models, {}).refine(grids, candidates);
  EXPECT_LT(suppressed.size(), found.size());
  for (std::size_t i = 0; i < suppressed.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (suppressed[i].part != suppressed[j].part) continue;
      EXPECT_LE(overlap(suppressed[i].box_view, suppressed[j].box_view), 0.5);
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Seeds, RefineFrame, ::testing::Values(10, 11, 12));

TEST(Refiner, RefusesWhatDoesNotFit) {
  Random random(5);
  const auto grid = random_grid(random, 20, 20, 16);
  const auto model = random_model(random, "jeans hips", {16}, 5);
  const Refiner refiner({model}, {});
  Candidate c;
  c.part = "jeans hips";
  c.column = 20;
  EXPECT_THROW(refiner.refine({&grid}, {c}), Error);
  c.column = 3;
  c.part = "polo collar";
  EXPECT_THROW(refiner.refine({&grid}, {c}), Error);
  c.part = "jeans hips";
  EXPECT_THROW(refiner.refine({&grid, &grid}, {c}), Error);
  EXPECT_THROW(refiner.refine({&grid}, std::vector<Candidate>(65, c)), Error);
  const auto other = random_grid(random, 21, 20, 16);
  EXPECT_THROW(refiner.refine({&grid, &other}, {}), Error);
  for (const int field : {0, 1, 2, 3, 4}) {
    auto bad = model;
    if (field == 0) bad.shapes.clear();
    if (field == 1) bad.counts.pop_back();
    if (field == 2) bad.gamma = 0.0;
    if (field == 3) bad.part = "sock toe";
    if (field == 4) bad.shapes[0].rows = 0;
    EXPECT_THROW(Refiner({bad}, {}), Error) << field;
  }
}

TEST(Overlap, HandWorked) {
  EXPECT_DOUBLE_EQ(overlap({0, 0, 2, 2}, {1, 0, 2, 2}), 2.0 / 6.0);
  EXPECT_DOUBLE_EQ(overlap({0, 0, 2, 2}, {2, 0, 2, 2}), 0.0);
  EXPECT_DOUBLE_EQ(overlap({0, 0, 2, 2}, {0, 0, 2, 2}), 1.0);
}

}  // namespace
}  // namespace weft::detector
