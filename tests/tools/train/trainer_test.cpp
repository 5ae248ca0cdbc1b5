#include "train/trainer.hpp"

#include <gtest/gtest.h>

#include <set>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::train {
namespace {

TEST(ClusterShapes, FindsTheClustersOfSizes) {
  Random random(1);
  std::vector<detector::Box> boxes;
  for (int i = 0; i < 60; ++i) {
    const double jitter = random.uniform(0.95, 1.05);
    if (i % 3 == 0) boxes.push_back({0, 0, 40 * jitter, 40});
    if (i % 3 == 1) boxes.push_back({0, 0, 160 * jitter, 80});
    if (i % 3 == 2) boxes.push_back({0, 0, 80, 160 * jitter});
  }
  const auto shapes = cluster_shapes(boxes, 3, 7);
  ASSERT_EQ(shapes.size(), 3u);
  std::set<std::pair<int, int>> found;
  for (const auto& shape : shapes) {
    found.insert({static_cast<int>(std::lround(shape.width_px / 10)),
                  static_cast<int>(std::lround(shape.height_px / 10))});
  }
  EXPECT_EQ(found, (std::set<std::pair<int, int>>{{4, 4}, {16, 8}, {8, 16}}));
  EXPECT_EQ(shapes[2].height_px, 40.0);  // the smallest comes last
}

TEST(ClusterShapes, FewerSizesThanShapes) {
  const auto shapes = cluster_shapes({{0, 0, 30, 20}, {5, 5, 30, 20}}, 5, 1);
  ASSERT_EQ(shapes.size(), 1u);
  EXPECT_EQ(shapes[0].width_px, 30.0);
  EXPECT_THROW(cluster_shapes({}, 5, 1), Error);
}

TEST(AreKindred, PairsPartsOfOneKind) {
  int kindred = 0;
  for (const std::string a : detector::kParts) {
    EXPECT_FALSE(are_kindred(a, a));
    for (const std::string b : detector::kParts) {
      EXPECT_EQ(are_kindred(a, b), are_kindred(b, a));
      if (!are_kindred(a, b)) continue;
      ++kindred;
      EXPECT_EQ(a.substr(a.find(' ')), b.substr(b.find(' ')));  // collar and collar
    }
  }
  EXPECT_EQ(kindred, 8);
  EXPECT_TRUE(are_kindred("shirt collar", "polo collar"));
  EXPECT_FALSE(are_kindred("jeans hips", "jeans pants hemline"));
}

TEST(AssignFolds, KeepsSimulationsTogetherAndGarmentsSpread) {
  std::vector<std::string> simulations, garments;
  for (int i = 0; i < 80; ++i) {
    simulations.push_back("s" + std::to_string(i / 2));
    garments.push_back(i / 2 % 4 == 0 ? "polo" : "jeans");
  }
  const auto folds = assign_folds(simulations, garments, 5, 3);
  std::map<std::string, std::set<int>> folds_of_garment;
  for (std::size_t i = 0; i < folds.size(); ++i) {
    EXPECT_EQ(folds[i], folds[i ^ 1]);  // both scenes of a simulation
    folds_of_garment[garments[i]].insert(folds[i]);
  }
  EXPECT_EQ(folds_of_garment["polo"].size(), 5u);
  EXPECT_EQ(folds_of_garment["jeans"].size(), 5u);
  EXPECT_EQ(folds, assign_folds(simulations, garments, 5, 3));
  EXPECT_NE(folds, assign_folds(simulations, garments, 5, 4));
}

TEST(TurnedView, HoldsTheGarmentWhateverTheAngle) {
  rgbd::View view;
  view.kind = rgbd::View::Kind::kRectified;
  view.width = 120;
  view.height = 90;
  view.sensor_from_view << 1.5, 0, 20, 0, 1.5, 30, 0, 0, 1;
  cv::Mat mask = cv::Mat::zeros(90, 120, CV_8UC1);
  mask(cv::Rect(30, 20, 60, 10)) = 255;
  for (int degrees = 0; degrees < 360; degrees += 30) {
    for (const bool mirrored : {false, true}) {
      const auto turned = turned_view(view, mask, degrees * M_PI / 180, mirrored, 5);
      for (const auto& [x, y] : {std::pair{30, 20}, {89, 20}, {30, 29}, {89, 29}}) {
        const auto p = turned.to_view(view.to_sensor({x, y}));
        EXPECT_GE(p.x(), 5.0 - 1e-9);
        EXPECT_GE(p.y(), 5.0 - 1e-9);
        EXPECT_LE(p.x(), turned.width - 6 + 1e-9);
        EXPECT_LE(p.y(), turned.height - 6 + 1e-9);
      }
      // Lengths stay, handedness changes with the mirror.
      const Eigen::Vector2d o = turned.to_view(view.to_sensor({30, 20}));
      const Eigen::Vector2d x = turned.to_view(view.to_sensor({40, 20})) - o;
      const Eigen::Vector2d y = turned.to_view(view.to_sensor({30, 30})) - o;
      EXPECT_NEAR(x.norm(), 10.0, 1e-9);
      EXPECT_NEAR(x.x() * y.y() - x.y() * y.x(), mirrored ? -100.0 : 100.0, 1e-6);
    }
  }
}

}  // namespace
}  // namespace weft::train
