#include "evaluation/garment_metrics.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/error.hpp"

namespace weft::evaluation {
namespace {

dataset::TruePart true_part(const std::string& part, const Eigen::Vector3d& at,
                            double share = 0.5) {
  return {part, "", at, share};
}
slam::GarmentPart map_part(const std::string& part, const Eigen::Vector3d& at,
                           double probability = 0.5) {
  slam::GarmentPart out;
  out.part = part;
  out.position_world = at;
  out.covariance = Eigen::Vector3d(4e-4, 1e-4, 1e-4).asDiagonal();
  out.probability = probability;
  return out;
}
slam::Garment map_garment(slam::Id id, const Eigen::Vector3d& at, bool in_map = true) {
  slam::Garment out;
  out.id = id;
  out.in_map = in_map;
  out.position_world = at;
  return out;
}

TEST(GarmentMetrics, CountsWhatIsFoundMissedAndFalse) {
  const std::vector<dataset::TrueGarment> truth{
      {"polo",
       {0, 0, 0},
       {true_part("polo collar", {0.2, 0, 0}), true_part("polo sleeves", {0, 0.3, 0}),
        true_part("polo sleeves", {0, -0.3, 0}, 0.05)}},
      {"jeans", {1, 0, 0}, {true_part("jeans hips", {1.2, 0, 0})}}};
  std::vector<slam::Garment> found{map_garment(3, {0.06, 0.08, 0}), map_garment(7, {5, 0, 0}),
                                   map_garment(9, {1, 0, 0}, false)};
  found[0].parts = {map_part("polo collar", {0.24, 0.03, 0}),     // 5 cm off
                    map_part("polo sleeves", {0, 0.41, 0}),       // too far
                    map_part("polo sleeves", {0, -0.32, 0}),      // of a part that hardly shows
                    map_part("polo collar", {0.2, 0, 0}, 0.01)};  // not likely
  found[1].parts = {map_part("jeans hips", {5, 0, 0})};           // of a garment that is none
  const auto evaluation = evaluate_garments(truth, found, {});
  EXPECT_EQ(evaluation.garments, 2);
  EXPECT_EQ(evaluation.false_garments, 1);
  EXPECT_EQ(evaluation.candidates, 1);
  ASSERT_EQ(evaluation.found.size(), 1u);
  EXPECT_EQ(evaluation.found[0].id, 3);
  EXPECT_NEAR(evaluation.found[0].error_m, 0.1, 1e-12);
  ASSERT_EQ(evaluation.parts.size(), 3u);  // the hidden sleeve is neither found nor missed
  EXPECT_TRUE(evaluation.parts[0].found);
  EXPECT_NEAR(evaluation.parts[0].error_m, 0.05, 1e-12);
  EXPECT_NEAR(evaluation.parts[0].chi_squared, 0.0016 / 4e-4 + 0.0009 / 1e-4, 1e-9);
  EXPECT_FALSE(evaluation.parts[1].found);
  EXPECT_EQ(evaluation.parts[2].part, "jeans hips");
  EXPECT_FALSE(evaluation.parts[2].found);
  EXPECT_EQ(evaluation.false_parts, 2);  // and the sleeve too far from any

  const auto json = to_json(evaluation, truth);
  EXPECT_EQ(json["found"].size(), 1u);
  EXPECT_EQ(json["parts"][1]["found"], false);
  const auto table = to_table(evaluation, truth);
  EXPECT_NE(table.find("1 of 2 garments found, 1 false, 1 candidates"), std::string::npos) << table;
  EXPECT_NE(table.find("1 of 3 visible parts found, 2 false"), std::string::npos) << table;
  EXPECT_NE(table.find("missed"), std::string::npos) << table;
}

TEST(GarmentMetrics, AssignsForTheLeastTotalAndNotNearestFirst) {
  const std::vector<dataset::TrueGarment> truth{{"a", {0, 0, 0}, {}}, {"b", {0.15, 0, 0}, {}}};
  // The first is nearer to b, but b has another of its own.
  const std::vector<slam::Garment> found{map_garment(1, {0.09, 0, 0}), map_garment(2, {0.3, 0, 0})};
  const auto evaluation = evaluate_garments(truth, found, {});
  ASSERT_EQ(evaluation.found.size(), 2u);
  EXPECT_EQ(evaluation.found[0].id, 1);
  EXPECT_EQ(evaluation.found[1].id, 2);
}

TEST(GarmentMetrics, MovesAGarmentWithItsParts) {
  slam::Garment garment = map_garment(1, {1, 0, 0});
  garment.covariance = Eigen::Vector3d(9e-4, 1e-4, 1e-4).asDiagonal();
  garment.parts = {map_part("polo collar", {2, 0, 0})};
  garment.parts[0].approach_world = Eigen::Vector3d::UnitX();
  const slam::Rigid3d T{Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ())),
                        {0, 0, 3}};
  const auto moved = transformed(garment, T);
  EXPECT_LT((moved.position_world - Eigen::Vector3d(0, 1, 3)).norm(), 1e-12);
  EXPECT_NEAR(moved.covariance(1, 1), 9e-4, 1e-12);
  EXPECT_LT((moved.parts[0].position_world - Eigen::Vector3d(0, 2, 3)).norm(), 1e-12);
  EXPECT_NEAR(moved.parts[0].covariance(1, 1), 4e-4, 1e-12);
  EXPECT_LT((moved.parts[0].approach_world - Eigen::Vector3d::UnitY()).norm(), 1e-12);
}

}  // namespace
}  // namespace weft::evaluation
