#include "evaluation/part_metrics.hpp"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

namespace weft::evaluation {
namespace {

dataset::PartPolygon square(const std::string& part, float x, float y, float size,
                            bool ignore = false) {
  dataset::PartPolygon p;
  p.part = part;
  p.points = {{x, y}, {x + size, y}, {x + size, y + size}, {x, y + size}};
  p.ignore = ignore;
  return p;
}

detector::Detection at(const std::string& part, double x, double y, double probability) {
  detector::Detection d;
  d.part = part;
  d.centre_sensor_px = {x, y};
  d.probability = probability;
  return d;
}

const PartScore& score_of(const Evaluation& e, const std::string& part) {
  for (const auto& score : e.parts) {
    if (score.part == part) return score;
  }
  throw std::runtime_error("no " + part);
}

TEST(Inside, EvenOddRuleAndTheBorder) {
  const std::vector<cv::Point2f> u = {{0, 0}, {9, 0}, {9, 9}, {6, 9},
                                      {6, 3}, {3, 3}, {3, 9}, {0, 9}};
  EXPECT_TRUE(inside(u, 1, 8));
  EXPECT_TRUE(inside(u, 8, 8));
  EXPECT_FALSE(inside(u, 4.5, 6));  // between the legs of the U
  EXPECT_TRUE(inside(u, 4.5, 3));   // on an edge
  EXPECT_TRUE(inside(u, 0, 0));     // a corner
  EXPECT_FALSE(inside(u, -0.001, 4));
  EXPECT_FALSE(inside({}, 0, 0));
}

TEST(AveragePrecision, HandWorked) {
  // Ranks: hit, miss, hit, miss, miss, hit; 4 positives. Precision at hits: 1, 2/3, 1/2.
  const auto ap = average_precision({true, false, true, false, false, true}, 4);
  EXPECT_NEAR(ap.all_points, 0.25 * (1.0 + 2.0 / 3 + 0.5), 1e-15);
  // Recalls 0, .1, .2 see 1; .3, .4, .5 see 2/3; .6, .7 see 1/2; .8, .9, 1 are not reached.
  EXPECT_NEAR(ap.eleven_points, (3 * 1.0 + 3 * 2.0 / 3 + 2 * 0.5) / 11, 1e-15);
}

TEST(AveragePrecision, InterpolationTakesTheBestLaterPrecision) {
  // miss, hit, hit: precision 0, 1/2, 2/3 becomes 2/3 for every recall.
  const auto ap = average_precision({false, true, true}, 2);
  EXPECT_NEAR(ap.all_points, 2.0 / 3, 1e-15);
  EXPECT_NEAR(ap.eleven_points, 2.0 / 3, 1e-15);
  EXPECT_EQ(average_precision({}, 3).all_points, 0.0);
  EXPECT_EQ(average_precision({false, false}, 3).eleven_points, 0.0);
}

TEST(AveragePrecision, ElevenPointsCountARecallThatIsJustReached) {
  // 10 positives, 3 hits in a row: recalls 0 to 0.3, though 3 * 0.1 is not 0.3 in doubles.
  EXPECT_NEAR(average_precision({true, true, true}, 10).eleven_points, 4.0 / 11, 1e-15);
}

TEST(EvaluateParts, HandWorkedScene) {
  std::vector<JudgedImage> images(3);
  // Image a: two sleeves. Ranked by probability: miss (0.9), hit (0.8), the same sleeve again
  // (0.7).
  images[0].name = "a";
  images[0].truth = {square("polo sleeves", 0, 0, 10), square("polo sleeves", 50, 0, 10)};
  images[0].detections = {at("polo sleeves", 5, 5, 0.8), at("polo sleeves", 30, 30, 0.9),
                          at("polo sleeves", 6, 6, 0.7), at("jeans hips", 5, 5, 0.99)};
  images[0].mask = cv::Mat(20, 100, CV_8UC1, cv::Scalar(255));
  // Image b: one sleeve found at once, and a detection in a polygon to be ignored.
  images[1].name = "b";
  images[1].truth = {square("polo sleeves", 0, 0, 10), square("polo sleeves", 20, 0, 10, true)};
  images[1].detections = {at("polo sleeves", 25, 5, 0.95), at("polo sleeves", 5, 5, 0.6)};
  images[1].mask = cv::Mat::zeros(20, 100, CV_8UC1);
  images[1].mask(cv::Rect(0, 0, 50, 20)) = 255;
  // Image c shows no sleeve: its detection is false.
  images[2].name = "c";
  images[2].detections = {at("polo sleeves", 5, 5, 0.65)};

  const auto evaluation = evaluate_parts(images);
  const auto& sleeves = score_of(evaluation, "polo sleeves");
  EXPECT_EQ(sleeves.positives, 3);
  EXPECT_EQ(sleeves.positive_images, 2);
  EXPECT_EQ(sleeves.images, 3);
  EXPECT_EQ(sleeves.detections, 5);
  EXPECT_EQ(sleeves.sure, 5);
  EXPECT_EQ(sleeves.sure_right, 3);             // .8, .7, .6
  EXPECT_DOUBLE_EQ(*sleeves.recall_at_1, 0.5);  // b; the ignored detection takes no rank
  EXPECT_DOUBLE_EQ(*sleeves.recall_at_3, 1.0);
  EXPECT_DOUBLE_EQ(*sleeves.recall_at_5, 1.0);
  EXPECT_DOUBLE_EQ(*sleeves.oracle_at_1, 1.0);
  // Pixels 0..10 in x and y lie in or on the 10 px square: 121 of 2000 each; two in a. In b the
  // ignored square's 121 pixels do not count.
  EXPECT_DOUBLE_EQ(*sleeves.chance_at_1, (242.0 / 2000 + 121.0 / (1000 - 121)) / 2);
  // Ranks: .9 miss, .8 hit, .7 miss (twice the same sleeve), .65 miss, .6 hit; 3 positives.
  EXPECT_NEAR(*sleeves.ap, (0.5 + 0.4) / 3, 1e-15);
  EXPECT_NEAR(*sleeves.ap11, (4 * 0.5 + 3 * 0.4) / 11, 1e-15);

  const auto& hips = score_of(evaluation, "jeans hips");
  EXPECT_EQ(hips.positives, 0);
  EXPECT_FALSE(hips.ap.has_value());
  EXPECT_DOUBLE_EQ(*evaluation.map, *sleeves.ap);  // parts without positives do not dilute the mean
}

TEST(EvaluateParts, SureDetectionsHaveTheThresholdsProbability) {
  std::vector<JudgedImage> images(1);
  images[0].truth = {square("jeans hips", 0, 0, 10)};
  images[0].detections = {at("jeans hips", 5, 5, 0.7), at("jeans hips", 30, 5, 0.69),
                          at("jeans hips", 30, 30, 0.9)};
  const auto evaluation = evaluate_parts(images, 0.7);
  EXPECT_EQ(evaluation.threshold, 0.7);
  EXPECT_EQ(score_of(evaluation, "jeans hips").sure, 2);
  EXPECT_EQ(score_of(evaluation, "jeans hips").sure_right, 1);
}

TEST(EvaluateParts, APolygonToFindWinsOverOneToIgnore) {
  std::vector<JudgedImage> images(1);
  images[0].truth = {square("jeans hips", 0, 0, 20, true), square("jeans hips", 5, 5, 5)};
  images[0].detections = {at("jeans hips", 7, 7, 0.2), at("jeans hips", 15, 15, 0.9)};
  const auto hips = score_of(evaluate_parts(images), "jeans hips");
  EXPECT_EQ(hips.detections, 1);
  EXPECT_DOUBLE_EQ(*hips.recall_at_1, 1.0);
  EXPECT_DOUBLE_EQ(*hips.ap, 1.0);
  EXPECT_FALSE(hips.chance_at_1.has_value());  // no mask
}

TEST(EvaluateParts, OracleMissesAPolygonWhoseBoxCentreLiesOutside) {
  std::vector<JudgedImage> images(1);
  dataset::PartPolygon crescent;
  crescent.part = "dress collar";
  crescent.points = {{0, 0}, {9, 0}, {9, 9}, {6, 9}, {6, 3}, {3, 3}, {3, 9}, {0, 9}};
  images[0].truth = {crescent, square("dress collar", 30, 30, 4)};
  EXPECT_DOUBLE_EQ(*score_of(evaluate_parts(images), "dress collar").oracle_at_1, 0.5);
}

TEST(EvaluateParts, NothingToJudge) {
  const auto evaluation = evaluate_parts({});
  EXPECT_EQ(evaluation.parts.size(), detector::kParts.size());
  EXPECT_FALSE(evaluation.map.has_value());
}

}  // namespace
}  // namespace weft::evaluation
