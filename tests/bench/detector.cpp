// Times the detector's two layers over a 105 x 78 grid for vocabularies of 64 to 1024 words, the
// first beside a sliding window that counts every histogram anew.
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>

#include "detector/part_scorer.hpp"
#include "detector/refiner.hpp"
#include "lib/detector/random_words.hpp"

namespace {

using namespace weft;  // NOLINT: a program of one file

// CPU time of all threads: on a machine that others use too, waiting is not part of the work.
double ms_of(const std::function<void()>& body) {
  const auto now = [] {
    timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
  };
  const double start = now();
  body();
  return now() - start;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

detector::RefineModel random_refine_model(const detector::ScoreModel& model, int vectors,
                                          Random& random) {
  detector::RefineModel refine;
  refine.blocks = model.blocks;
  for (std::size_t p = 0; p < model.parts.size(); ++p) {
    detector::PartSvm svm;
    svm.part = detector::kParts[p % detector::kParts.size()];
    svm.shapes = model.parts[p].shapes;
    svm.shapes.push_back({90, 90});
    for (int i = 0; i < vectors * refine.entries(); ++i) {
      svm.counts.push_back(random.uniform() < 0.4 ? 0 : static_cast<int>(random.below(12)));
    }
    for (int i = 0; i < vectors; ++i) svm.coefficients.push_back(random.normal());
    refine.parts.push_back(std::move(svm));
  }
  return refine;
}

// Every window of one part by its own histogram; returns how many scores differ in any bit.
int count_differences(const detector::ScoreModel& model,
                      const std::vector<const bovw::WordGrid*>& grids, double& brute_ms) {
  const detector::WindowScorer scorer(model, grids);
  int different = 0;
  brute_ms = 0.0;
  for (const auto& shape : model.parts[0].shapes) {
    const auto windows = scorer.score(0, shape);
    std::vector<double> expected;
    brute_ms += ms_of([&] {
      std::vector<std::vector<std::int32_t>> counts(1);
      counts[0].resize(static_cast<std::size_t>(model.blocks[0].entries()));
      for (int r = 0; r < windows.positions.rows; ++r) {
        for (int c = 0; c < windows.positions.columns; ++c) {
          detector::count_block(model.blocks[0], *grids[0],
                                {windows.positions.column + c, windows.positions.row + r,
                                 windows.window_columns, windows.window_rows},
                                counts[0]);
          expected.push_back(detector::window_score(model, 0, counts));
        }
      }
    });
    for (std::size_t i = 0; i < expected.size(); ++i) {
      const bool same = expected[i] == windows.scores[i] ||
                        (std::isnan(expected[i]) && std::isnan(windows.scores[i]));
      if (!same) ++different;
    }
  }
  return different;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"The sliding window against brute force, and its time by vocabulary size"};
  int runs = 15, threads = 1, parts = 11, vectors = 500;
  double mask_share = 10.0;
  std::string json;
  app.add_option("--runs", runs, "the median of so many runs counts")->check(CLI::Range(1, 10000));
  app.add_option("--threads", threads)->check(CLI::Range(1, 64));
  app.add_option("--parts", parts)->check(CLI::Range(1, 11));
  app.add_option("--support-vectors", vectors, "of each part")->check(CLI::Range(1, 100000));
  app.add_option("--mask", mask_share,
                 "size of the garment: 10 fills the grid, 0.1 is a third of it")
      ->check(CLI::Range(0.01, 10.0));
  app.add_option("--json", json, "write the results here");
  CLI11_PARSE(app, argc, argv);

  // Widths and heights such as clusters of training boxes have, 600 px/m: collars, sleeves, hems.
  const std::vector<detector::WindowShape> shapes = {{72, 54},  {60, 84},  {108, 66},
                                                     {96, 120}, {150, 96}, {180, 150}};
  nlohmann::json report;
  int exit_status = 0;
  for (const int words : {64, 128, 256, 512, 1024}) {
    Random random(static_cast<std::uint64_t>(words));
    const auto grid = detector::random_words("sift", 105, 78, words, random, mask_share);
    const std::vector<const bovw::WordGrid*> grids = {&grid};
    auto model = detector::random_model(grids, parts, shapes, random, true);
    for (int p = 0; p < parts; ++p) {
      model.parts[static_cast<std::size_t>(p)].part = detector::kParts[static_cast<std::size_t>(p)];
    }
    const detector::Refiner refiner(random_refine_model(model, vectors, random), {});
    double brute_ms;
    const int different = count_differences(model, grids, brute_ms);
    std::vector<double> windows_ms, all_ms, refine_ms;
    std::size_t windows = 0, candidates = 0;
    for (int run = 0; run < runs; ++run) {
      windows = 0;
      windows_ms.push_back(ms_of([&] {
        const detector::WindowScorer scorer(model, grids);
        for (int part = 0; part < parts; ++part) {
          for (const auto& shape : shapes) windows += scorer.score(part, shape).scores.size();
        }
      }));
      detector::PartScores scores;
      all_ms.push_back(ms_of([&] {
        scores = detector::score_parts(model, grids, {}, detector::PriorMode::kOff, {}, threads);
      }));
      candidates = scores.candidates.size();
      refine_ms.push_back(ms_of([&] { refiner.refine(grids, scores.candidates, threads); }));
    }
    const double ratio = brute_ms * parts / median(windows_ms);
    report["words_" + std::to_string(words)] = {{"windows", windows},
                                                {"windows_ms", median(windows_ms)},
                                                {"score_ms", median(all_ms)},
                                                {"candidates", candidates},
                                                {"support_vectors", vectors},
                                                {"refine_ms", median(refine_ms)},
                                                {"threads", threads},
                                                {"peer", "histogram of each window counted anew"},
                                                {"peer_ms", brute_ms * parts},
                                                {"ratio", ratio},
                                                {"scores_that_differ", different}};
    std::printf(
        "%5d words: %zu windows %7.2f ms, with map and peaks %7.2f ms, refining %zu peaks "
        "%7.2f ms (%d threads, CPU time); brute force windows %8.1f ms, %.0fx; %d scores differ\n",
        words, windows, median(windows_ms), median(all_ms), candidates, median(refine_ms), threads,
        brute_ms * parts, ratio, different);
    if (different != 0) exit_status = 1;
  }
  if (!json.empty()) {
    std::ofstream file(json);
    file << report.dump(2) << "\n";
    if (!file.flush()) {
      std::fprintf(stderr, "%s: cannot write\n", json.c_str());
      return 1;
    }
  }
  return exit_status;
}
