#include "detector/refiner.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/ml.hpp>

#include "base/blob.hpp"
#include "base/error.hpp"
#include "base/random.hpp"
#include "detector/chi2_kernel.hpp"
#include "support/files.hpp"

namespace weft::detector {
namespace {

bovw::WordGrid random_grid(Random& random, int columns, int rows, int words) {
  bovw::WordGrid grid;
  grid.descriptor = "d" + std::to_string(words);
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

using Blocks = std::vector<HistogramBlock>;

Blocks blocks_of(const std::vector<int>& words) {
  Blocks blocks;
  for (const int n : words) blocks.push_back({"d" + std::to_string(n), 0, n, false});
  return blocks;
}

PartSvm random_svm(Random& random, const std::string& part, int words, int vectors) {
  PartSvm svm;
  svm.part = part;
  svm.shapes = {{54, 42}, {42, 54}, {72, 30}, {24, 24}};  // 9x7, 7x9, 12x5, 4x4 grid points
  for (int i = 0; i < vectors * words; ++i) {
    svm.counts.push_back(random.uniform() < 0.5 ? 0 : static_cast<std::int32_t>(random.below(9)));
  }
  for (int i = 0; i < vectors; ++i) svm.coefficients.push_back(random.uniform(-2.0, 2.0));
  svm.gamma = random.uniform(0.5, 2.0);
  svm.rho = random.uniform(-0.2, 0.2);
  svm.platt_a = -1.5;
  svm.platt_b = 0.3;
  return svm;
}

std::vector<double> l1(const std::vector<int>& counts, const Blocks& blocks) {
  std::vector<double> h;
  std::size_t at = 0;
  for (const auto& each : blocks) {
    const int words = each.entries();
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

std::vector<int> vector_counts(const PartSvm& svm, int i, int words) {
  const auto begin = svm.counts.begin() + static_cast<std::ptrdiff_t>(i) * words;
  return {begin, begin + words};
}

double brute_decision(const PartSvm& svm, const Blocks& blocks, const std::vector<int>& counts) {
  double sum = -svm.rho;
  for (int i = 0; i < svm.support_vectors(); ++i) {
    const double d = brute_distance(l1(counts, blocks),
                                    l1(vector_counts(svm, i, total_entries(blocks)), blocks));
    sum += svm.coefficients[static_cast<std::size_t>(i)] * std::exp(-svm.gamma * d);
  }
  return sum;
}

std::vector<int> brute_counts(const std::vector<const bovw::WordGrid*>& grids, const Blocks& blocks,
                              const bovw::CellBox& box) {
  std::vector<int> counts;
  for (std::size_t b = 0; b < grids.size(); ++b) {
    const auto* grid = grids[b];
    const auto words = static_cast<std::size_t>(grid->vocabulary_size);
    std::vector<int> block(words + 2, 0);
    for (int r = box.row; r < box.row + box.rows; ++r) {
      for (int c = box.column; c < box.column + box.columns; ++c) {
        const bool on_grid = c >= 0 && r >= 0 && c < grid->columns && r < grid->rows;
        const int word = on_grid ? grid->at(c, r) : bovw::WordGrid::kOutsideMask;
        ++block[word >= 0 ? static_cast<std::size_t>(word)
                          : words + (word == bovw::WordGrid::kNoWord ? 0 : 1)];
      }
    }
    if (!blocks[b].context) block.resize(words);
    counts.insert(counts.end(), block.begin(), block.end());
  }
  return counts;
}

TEST(Chi2Distance, EqualsTheDefinition) {
  Random random(1);
  const auto blocks = blocks_of({20, 13});
  for (int trial = 0; trial < 50; ++trial) {
    const auto svm = random_svm(random, "jeans hips", 33, 2);
    const double expected = brute_distance(l1(vector_counts(svm, 0, 33), blocks),
                                           l1(vector_counts(svm, 1, 33), blocks));
    EXPECT_NEAR(chi2_distance(svm.counts.data(), svm.counts.data() + 33, blocks), expected, 1e-14);
  }
  const std::int32_t empty[3] = {0, 0, 0}, one[3] = {0, 5, 0};
  EXPECT_DOUBLE_EQ(chi2_distance(empty, empty, blocks_of({3})), 0.0);
  EXPECT_DOUBLE_EQ(chi2_distance(empty, one, blocks_of({3})), 1.0);
  EXPECT_DOUBLE_EQ(chi2_distance(one, one, blocks_of({3})), 0.0);
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
    RefineModel model;
    model.blocks = blocks_of({40, 25});
    model.parts = {random_svm(random, "jeans hips", 65, vectors)};
    const Refiner refiner(model, {});
    for (int trial = 0; trial < 20; ++trial) {
      std::vector<int> counts;
      for (int w = 0; w < 65; ++w) {
        counts.push_back(random.uniform() < 0.5 ? 0 : static_cast<int>(random.below(30)));
      }
      if (trial == 0) std::fill(counts.begin() + 40, counts.end(), 0);  // one descriptor is silent
      EXPECT_NEAR(refiner.decide(0, counts), brute_decision(model.parts[0], model.blocks, counts),
                  2e-6 * vectors);
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
    const auto x = l1(h, blocks_of({words}));
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
  PartSvm ours;
  ours.part = "polo collar";
  ours.shapes = {{18, 18}};
  ours.gamma = 1.7;
  ours.rho = svm->getDecisionFunction(0, alpha, index);
  // OpenCV keeps its support vectors as L1 shares: find the samples they came from.
  const cv::Mat vectors = svm->getSupportVectors();
  for (int k = 0; k < index.cols * index.rows; ++k) {
    const auto row = vectors.row(index.at<int>(k));
    int sample = 0;
    while (sample < samples && cv::norm(row, data.row(sample)) > 1e-6) ++sample;
    ASSERT_LT(sample, samples);
    const auto& h = counts[static_cast<std::size_t>(sample)];
    ours.counts.insert(ours.counts.end(), h.begin(), h.end());
    ours.coefficients.push_back(alpha.at<double>(k));
  }
  RefineModel model;
  model.blocks = blocks_of({words});
  model.parts = {ours};
  const Refiner refiner(model, {});
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
  RefineModel model;
  model.blocks = blocks_of({16, 9});
  model.blocks[0].context = GetParam() % 2 == 0;
  const int entries = model.entries();
  model.parts = {random_svm(random, "jeans hips", entries, 70),
                 random_svm(random, "polo collar", entries, 33)};
  RefinerOptions options;
  options.max_overlap = 1.0;  // keep repeats: they are tested below
  const Refiner refiner(model, options);
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
    const auto& svm = model.parts[c.part == "jeans hips" ? 0 : 1];
    double best = -1e300;
    Detection d;
    for (const auto& shape : svm.shapes) {
      const int columns = static_cast<int>(shape.width_px / 6);
      const int rows = static_cast<int>(shape.height_px / 6);
      for (int dy = -4; dy <= 4; dy += 2) {
        for (int dx = -4; dx <= 4; dx += 2) {
          const int column = c.column + dx, row = c.row + dy;
          if (column < 0 || row < 0 || column >= 40 || row >= 30) continue;
          if (a.at(column, row) == bovw::WordGrid::kOutsideMask) continue;
          const bovw::CellBox box{column - columns / 2, row - rows / 2, columns, rows};
          const auto counts = brute_counts(grids, model.blocks, box);
          if (std::all_of(counts.begin(), counts.end(), [](int n) { return n == 0; })) continue;
          const double f = brute_decision(svm, model.blocks, counts);
          if (f <= best) continue;
          best = f;
          d.part = c.part;
          d.probability = c.prior / (1.0 + std::exp(svm.platt_a * f + svm.platt_b));
          d.box_view = {11.0 + (box.column - 0.5) * 6.0, 7.5 + (box.row - 0.5) * 6.0, columns * 6.0,
                        rows * 6.0};
        }
      }
    }
    if (!d.part.empty()) expected.push_back(d);
  }
  std::stable_sort(expected.begin(), expected.end(), [](const Detection& x, const Detection& y) {
    return x.probability > y.probability;
  });

  const auto found = refiner.refine(grids, candidates, 1);
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
  const auto suppressed = Refiner(model, {}).refine(grids, candidates, 2);
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
  RefineModel model;
  model.blocks = blocks_of({16});
  model.parts = {random_svm(random, "jeans hips", 16, 5)};
  const Refiner refiner(model, {});
  const bovw::WordGrid* const grids[] = {&grid};
  std::vector<Candidate> candidates(1);
  candidates[0].part = "jeans hips";
  candidates[0].column = 20;
  EXPECT_THROW(refiner.refine(grids, candidates, 1), Error);
  candidates[0].column = -1;
  EXPECT_THROW(refiner.refine(grids, candidates, 1), Error);
  candidates[0].column = 3;
  EXPECT_NO_THROW(refiner.refine(grids, candidates, 1));
  candidates[0].part = "polo collar";
  EXPECT_THROW(refiner.refine(grids, candidates, 1), Error);
  candidates[0].part = "jeans hips";
  EXPECT_THROW(refiner.refine(grids, std::vector<Candidate>(65, candidates[0]), 1), Error);
  const bovw::WordGrid* const two[] = {&grid, &grid};
  EXPECT_THROW(refiner.refine(two, candidates, 1), Error);
  for (int field = 0; field < 7; ++field) {
    auto bad = model;
    auto& svm = bad.parts[0];
    if (field == 0) svm.shapes.clear();
    if (field == 1) svm.counts.pop_back();
    if (field == 2) svm.gamma = 0.0;
    if (field == 3) svm.part = "sock toe";
    if (field == 4) svm.shapes[0].height_px = 0.0;
    if (field == 5) svm.counts[0] = -1;
    if (field == 6) svm.rho = std::nan("");
    EXPECT_THROW(Refiner(bad, {}), Error) << field;
  }
}

TEST(RefineModel, WritesAndReadsTheSame) {
  Random random(6);
  RefineModel model;
  model.blocks = blocks_of({16, 9});
  model.parts = {random_svm(random, "jeans hips", 25, 7), random_svm(random, "polo collar", 25, 3)};
  // Counts of one to three bytes, a support vector with every word, one with the last word alone.
  std::fill_n(model.parts[0].counts.begin(), 25, 1 << 20);
  std::fill_n(model.parts[0].counts.begin() + 25, 24, 0);
  model.parts[0].counts[49] = 127;
  model.parts[0].counts[50] = 128;
  const test::TemporaryFolder folder;
  const auto path = folder / "refine.blob";
  model.write(path);
  const auto read = RefineModel::read(path);
  EXPECT_NE(read.hash, 0u);
  EXPECT_EQ(read.entries(), 25);
  ASSERT_EQ(read.parts.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(read.parts[i].part, model.parts[i].part);
    EXPECT_EQ(read.parts[i].counts, model.parts[i].counts);
    EXPECT_EQ(read.parts[i].coefficients, model.parts[i].coefficients);
    EXPECT_EQ(read.parts[i].gamma, model.parts[i].gamma);
    EXPECT_EQ(read.parts[i].rho, model.parts[i].rho);
    EXPECT_EQ(read.parts[i].platt_a, model.parts[i].platt_a);
    EXPECT_EQ(read.parts[i].platt_b, model.parts[i].platt_b);
    EXPECT_EQ(read.parts[i].shapes.size(), 4u);
    EXPECT_EQ(read.parts[i].shapes[2].width_px, 72.0);
  }
}

TEST(RefineModel, RefusesDamagedCounts) {
  const test::TemporaryFolder folder;
  const auto path = folder / "refine.blob";
  const auto error_of = [&](std::uint32_t version, const std::vector<std::uint8_t>& counts) {
    BlobWriter blob("refine", version);
    write_blocks(blob, blocks_of({5}));
    blob.add_number("parts", std::int64_t{1});
    blob.add("part.0.name", "jeans hips");
    const std::vector<double> shape{10.0, 10.0}, coefficients{1.0, -1.0};
    blob.add("part.0.shapes", std::span<const double>(shape));
    blob.add("part.0.coefficients", std::span<const double>(coefficients));
    blob.add("part.0.counts", std::span<const std::uint8_t>(counts));
    for (const char* number : {"gamma", "rho", "platt_a", "platt_b"})
      blob.add_number(std::string("part.0.") + number, 1.0);
    blob.write(path);
    return test::error_of([&] { RefineModel::read(path); });
  };
  // Words 0 and 3 of the first support vector, word 4 of the second.
  EXPECT_EQ(error_of(2, {2, 0, 7, 2, 9, 1, 4, 1}), "");
  EXPECT_NE(error_of(1, {2, 0, 7, 2, 9, 1, 4, 1}), "");
  EXPECT_NE(error_of(2, {2, 0, 7, 2, 9, 1, 4}), "");        // ends too early
  EXPECT_NE(error_of(2, {2, 0, 7, 2, 9, 1, 4, 1, 0}), "");  // too late
  EXPECT_NE(error_of(2, {2, 0, 7, 2, 9, 1, 5, 1}), "");     // a word beyond the last
  EXPECT_NE(error_of(2, {2, 2, 7, 2, 9, 1, 4, 1}), "");     // two of them together
  EXPECT_NE(error_of(2, {6, 0, 7, 2, 9, 1, 4, 1}), "");     // more words than there are
  EXPECT_NE(error_of(2, {2, 0, 255, 255, 255, 127, 1, 9, 1, 4, 1}), "");  // an absurd count
  EXPECT_NE(error_of(2, {2, 0, 255, 255, 255, 255, 255, 1}), "");         // an endless number
  EXPECT_NE(error_of(2, {}), "");
}

TEST(Overlap, HandWorked) {
  EXPECT_DOUBLE_EQ(overlap({0, 0, 2, 2}, {1, 0, 2, 2}), 2.0 / 6.0);
  EXPECT_DOUBLE_EQ(overlap({0, 0, 2, 2}, {2, 0, 2, 2}), 0.0);
  EXPECT_DOUBLE_EQ(overlap({0, 0, 2, 2}, {0, 0, 2, 2}), 1.0);
}

}  // namespace
}  // namespace weft::detector
