#include "slam/garment_map.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>

#include "base/error.hpp"
#include "synthetic_world.hpp"

namespace weft::slam {
namespace {

Eigen::Matrix3d isotropic(double sigma_m) {
  return sigma_m * sigma_m * Eigen::Matrix3d::Identity();
}

/// Key frames that look down at a table at y = 0.5 (y points down), from 1.2 m.
struct TableTop {
  TableTop() {
    MapPlane& table = map.planes[0];
    table.id = 0;
    table.normal_world = {0, -1, 0};
    table.distance_m = -0.5;
    table.confirmed = true;
    for (int i = -10; i <= 10; ++i)
      for (int j = -10; j <= 10; ++j)
        table.cloud_world.push_back(
            {0.05f * static_cast<float>(i), 0.5f, 1.0f + 0.05f * static_cast<float>(j)});
    MapPlane& floor = map.planes[1];
    floor.id = 1;
    floor.normal_world = {0, -1, 0};
    floor.distance_m = -1.2;
    floor.confirmed = true;
    floor.cloud_world = {{0.0f, 1.2f, 1.0f}};
  }

  Id look_from(const Eigen::Vector3d& position) {
    KeyFrame key_frame;
    key_frame.id = next++;
    key_frame.camera = test::kinect();
    key_frame.T_camera_world = Rigid3d{exp_rotation({-0.6, 0.0, 0.0}), position}.inverse();
    map.key_frames[key_frame.id] = key_frame;
    return key_frame.id;
  }
  GarmentSighting see(Id key_frame, const Eigen::Vector3d& position_world,
                      std::vector<std::pair<std::string, Eigen::Vector3d>> parts = {}) const {
    const Rigid3d& T = map.key_frames.at(key_frame).T_camera_world;
    GarmentSighting out;
    out.position_camera = T * position_world;
    out.covariance_camera = isotropic(0.01);
    for (const auto& [name, at] : parts) {
      PartSighting part;
      part.part = name;
      part.probability = 0.8;
      part.position_camera = T * at;
      part.covariance_camera = isotropic(0.005);
      out.parts.push_back(part);
    }
    return out;
  }

  Map map;
  Id next = 0;
};

const Eigen::Vector3d kEye(0.0, -0.2, 0.0);
const Eigen::Vector3d kShirt(-0.1, 0.47, 1.0);

TEST(GarmentMap, AppearsAfterFiveConsecutiveKeyFramesAndNotBefore) {
  TableTop world;
  GarmentMap garments({.needs_part = false});
  for (int k = 0; k < 7; ++k) {
    const Id id = world.look_from(kEye);
    garments.add(world.map, {id}, std::vector{world.see(id, kShirt)});
    ASSERT_EQ(garments.garments().size(), 1u);
    EXPECT_EQ(garments.garments()[0].in_map, k >= 4) << k;
  }
  EXPECT_EQ(garments.garments()[0].supporting_plane, 0);
  // A candidate that is missed once is none: four times, a miss, four times.
  GarmentMap flickering({.needs_part = false});
  for (int k = 0; k < 9; ++k) {
    const Id id = world.look_from(kEye);
    std::vector<GarmentSighting> seen;
    if (k != 4) seen.push_back(world.see(id, kShirt));
    flickering.add(world.map, {id}, seen);
    for (const auto& garment : flickering.garments()) EXPECT_FALSE(garment.in_map) << k;
  }
}

TEST(GarmentMap, BeginsOnlyWherePartsAreAndGoesOnWithoutThem) {
  TableTop world;
  GarmentMap garments({});
  const auto look = [&](bool with_part) {
    const Id key_frame = world.look_from(kEye);
    const auto seen = with_part ? world.see(key_frame, kShirt, {{"polo collar", kShirt}})
                                : world.see(key_frame, kShirt);
    garments.add(world.map, {key_frame}, std::vector{seen});
  };
  for (int i = 0; i < 6; ++i) look(false);
  EXPECT_TRUE(garments.garments().empty());
  look(true);
  for (int i = 0; i < 4; ++i) look(false);
  ASSERT_EQ(garments.garments().size(), 1u);
  EXPECT_TRUE(garments.garments()[0].in_map);
}

TEST(GarmentMap, DisappearsOnlyWhenItShouldBeSeen) {
  TableTop world;
  GarmentMap garments({.needs_part = false});
  for (int k = 0; k < 5; ++k) {
    const Id id = world.look_from(kEye);
    garments.add(world.map, {id}, std::vector{world.see(id, kShirt)});
  }
  ASSERT_TRUE(garments.garments().at(0).in_map);
  for (int k = 0; k < 20; ++k)  // looking elsewhere tells nothing
    garments.add(world.map, {world.look_from({5.0, -0.2, 0.0})}, {});
  ASSERT_EQ(garments.garments().size(), 1u);
  for (int k = 0; k < 4; ++k) garments.add(world.map, {world.look_from(kEye)}, {});
  ASSERT_EQ(garments.garments().size(), 1u);
  const Id again = world.look_from(kEye);  // seen in between: not gone
  garments.add(world.map, {again}, std::vector{world.see(again, kShirt)});
  for (int k = 0; k < 4; ++k) garments.add(world.map, {world.look_from(kEye)}, {});
  ASSERT_EQ(garments.garments().size(), 1u);
  garments.add(world.map, {world.look_from(kEye)}, {});
  EXPECT_TRUE(garments.garments().empty());
}

TEST(GarmentMap, TwoSideBySideAreNotConfusedAsNearestFirstWould) {
  // The camera's pose is off by 12 cm, garments lie 20 cm apart: the first's sighting is nearer to
  // the second garment.
  TableTop world;
  const Eigen::Vector3d a(-0.1, 0.47, 1.0), b(0.1, 0.47, 1.0), off(0.12, 0.0, 0.0);
  GarmentMap garments({.needs_part = false});
  for (int k = 0; k < 5; ++k) {
    const Id id = world.look_from(kEye);
    garments.add(world.map, {id}, std::vector{world.see(id, a), world.see(id, b)});
  }
  ASSERT_EQ(garments.garments().size(), 2u);
  const Id id_a = garments.garments()[0].id, id_b = garments.garments()[1].id;
  ASSERT_LT((a + off - b).norm(), off.norm());
  const Id id = world.look_from(kEye);
  garments.add(world.map, {id}, std::vector{world.see(id, a + off), world.see(id, b + off)});
  ASSERT_EQ(garments.garments().size(), 2u);
  EXPECT_EQ(garments.garments()[0].id, id_a);
  EXPECT_EQ(garments.garments()[1].id, id_b);
  for (const auto& garment : garments.garments()) EXPECT_EQ(garment.sightings, 6);
  EXPECT_LT(garments.garments()[0].position_world.x(), garments.garments()[1].position_world.x());
  EXPECT_NEAR((garments.garments()[1].position_world - garments.garments()[0].position_world).x(),
              0.2, 0.01);
}

TEST(GarmentMap, PartsMergeOverViewsWithTheirUncertainty) {
  TableTop world;
  Random random(3);
  const Eigen::Vector3d left = kShirt + Eigen::Vector3d(-0.15, 0, 0);
  const Eigen::Vector3d right = kShirt + Eigen::Vector3d(0.15, 0, 0);
  const Eigen::Vector3d collar = kShirt + Eigen::Vector3d(0, 0, 0.2);
  GarmentMap garments({.part_bias_m = 0.0, .needs_part = false});
  double first_sigma = 0.0;
  for (int k = 0; k < 20; ++k) {
    const Id id = world.look_from(kEye + Eigen::Vector3d(0.02 * k, 0, 0));
    const auto noisy = [&](const Eigen::Vector3d& x) {
      return Eigen::Vector3d(x + 0.015 * test::gauss3(random));
    };
    auto seen =
        world.see(id, kShirt,
                  {{"sleeves", noisy(right)}, {"sleeves", noisy(left)}, {"collar", noisy(collar)}});
    if (k % 2) std::swap(seen.parts[0], seen.parts[1]);  // the order says nothing
    if (k == 7) {
      seen.parts[2].has_grasp = true;
      seen.parts[2].grasp_score = 0.7;
      seen.parts[2].approach_camera = Eigen::Vector3d(0, 0.8, 0.6);
    }
    garments.add(world.map, {id}, std::vector{seen});
    if (k == 0) first_sigma = std::sqrt(garments.garments()[0].parts[0].covariance(0, 0));
  }
  ASSERT_EQ(garments.garments().size(), 1u);
  const auto& parts = garments.garments()[0].parts;
  ASSERT_EQ(parts.size(), 3u);
  const Eigen::Vector3d truth[] = {right, left, collar};
  for (std::size_t p = 0; p < 3; ++p) {
    EXPECT_LT((parts[p].position_world - truth[p]).norm(), 0.015) << p;
    EXPECT_LT(std::sqrt(parts[p].covariance(0, 0)), 0.5 * first_sigma);
    EXPECT_EQ(parts[p].sightings, 20);
    EXPECT_NEAR(parts[p].probability, 0.8, 0.02);
  }
  EXPECT_TRUE(parts[2].has_grasp);
  EXPECT_NEAR(parts[2].grasp_score, 0.7, 1e-12);
  const Eigen::Vector3d approach =
      world.map.key_frames.at(7).T_camera_world.inverse().rotation * Eigen::Vector3d(0, 0.8, 0.6);
  EXPECT_LT((parts[2].approach_world - approach).norm(), 1e-12);
  // A part that is no longer found fades and goes, the others stay.
  for (int k = 0; k < 20; ++k) {
    const Id id = world.look_from(kEye);
    garments.add(world.map, {id}, std::vector{world.see(id, kShirt, {{"collar", collar}})});
  }
  ASSERT_EQ(garments.garments()[0].parts.size(), 1u);
  EXPECT_EQ(garments.garments()[0].parts[0].part, "collar");
}

/// Views that err alike by a bias and each by its own: however many there are, the error stays
/// within what the map says of it.
TEST(GarmentMap, WhatAllViewsErrByIsNotAveragedAway) {
  Random random(8);
  double sum = 0.0;
  constexpr int kWorlds = 200;
  for (int w = 0; w < kWorlds; ++w) {
    TableTop world;
    GarmentMap garments(
        {.part_sigma_m = 0.01, .part_bias_m = 0.03, .max_chi_squared = 40.0, .needs_part = false});
    const Eigen::Vector3d bias = 0.03 * test::gauss3(random);
    for (int k = 0; k < 12; ++k) {
      const Id id = world.look_from(kEye);
      const Eigen::Vector3d seen = kShirt + bias + 0.0111 * test::gauss3(random);
      garments.add(world.map, {id}, std::vector{world.see(id, kShirt, {{"collar", seen}})});
    }
    ASSERT_EQ(garments.garments()[0].parts.size(), 1u);  // the views agree
    const auto& part = garments.garments()[0].parts[0];
    const Eigen::Vector3d error = part.position_world - kShirt;
    sum += error.dot(part.covariance.inverse() * error) / kWorlds;
  }
  EXPECT_GT(sum, 2.5);
  EXPECT_LT(sum, 3.5);
  // Without a bias of its own a saved part gets it.
  SavedGarments saved;
  saved.next_id = 1;
  saved.garments.emplace_back().id = 0;
  saved.garments[0].parts.emplace_back().covariance = isotropic(0.01);
  const GarmentMap loaded({.part_bias_m = 0.03}, saved);
  EXPECT_NEAR(loaded.garments()[0].parts[0].covariance(1, 1), 0.001, 1e-12);
}

TEST(GarmentMap, LooksFromBesideAKeyFrame) {
  TableTop world;
  const Id key_frame = world.look_from(kEye);
  // The camera stands 40 cm to the right and looks a little to the left.
  const Rigid3d T_camera_world =
      Rigid3d{exp_rotation({-0.6, -0.3, 0.0}), kEye + Eigen::Vector3d(0.4, 0.0, 0.0)}.inverse();
  const GarmentView view{
      key_frame, T_camera_world * world.map.key_frames.at(key_frame).T_camera_world.inverse()};
  GarmentSighting seen;
  seen.position_camera = T_camera_world * kShirt;
  seen.covariance_camera = isotropic(0.01);
  GarmentMap garments({.needs_part = false});
  for (int k = 0; k < 5; ++k) garments.add(world.map, view, std::vector{seen});
  ASSERT_EQ(garments.garments().size(), 1u);
  EXPECT_TRUE(garments.garments()[0].in_map);
  EXPECT_LT((garments.garments()[0].position_world - kShirt).norm(), 1e-9);
  // Held by the key frame: it moves with it.
  world.map.key_frames.at(key_frame).T_camera_world.translation.x() -= 0.1;
  garments.follow(world.map);
  const Eigen::Vector3d moved = garments.garments()[0].position_world - kShirt;
  EXPECT_NEAR(moved.norm(), 0.1, 1e-9);
}

TEST(GarmentMap, FollowsTheMap) {
  TableTop world;
  GarmentMap garments({.needs_part = false});
  for (int k = 0; k < 5; ++k) {
    const Id id = world.look_from(kEye);
    garments.add(world.map, {id}, std::vector{world.see(id, kShirt, {{"collar", kShirt}})});
  }
  // A loop moves all key frames by T.
  const Rigid3d T{exp_rotation({0.0, 0.1, 0.0}), {0.3, 0.0, -0.1}};
  for (auto& [id, key_frame] : world.map.key_frames)
    key_frame.T_camera_world = key_frame.T_camera_world * T.inverse();
  garments.follow(world.map);
  EXPECT_LT((garments.garments()[0].position_world - T * kShirt).norm(), 1e-9);
  EXPECT_LT((garments.garments()[0].parts[0].position_world - T * kShirt).norm(), 1e-9);
  // Its key frame goes: it stays where it is, held by another.
  world.map.key_frames.erase(garments.garments()[0].anchor);
  garments.follow(world.map);
  garments.follow(world.map);
  EXPECT_TRUE(world.map.key_frames.contains(garments.garments()[0].anchor));
  EXPECT_LT((garments.garments()[0].position_world - T * kShirt).norm(), 1e-9);
}

TEST(GarmentMap, RefusesWhatCannotBe) {
  TableTop world;
  GarmentMap garments({.needs_part = false});
  const Id id = world.look_from(kEye);
  const auto good = world.see(id, kShirt, {{"collar", kShirt}});
  EXPECT_THROW(garments.add(world.map, {99}, std::vector{good}), Error);
  const auto refuses = [&](auto change) {
    auto bad = good;
    change(bad);
    EXPECT_THROW(garments.add(world.map, {id}, std::vector{good, bad}), Error);
    EXPECT_TRUE(garments.garments().empty());
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  refuses([&](auto& s) { s.position_camera.x() = nan; });
  refuses([&](auto& s) { s.covariance_camera.setZero(); });
  refuses([&](auto& s) { s.extent_m = -1.0; });
  refuses([&](auto& s) { s.parts[0].probability = 1.5; });
  refuses([&](auto& s) { s.parts[0].covariance_camera(0, 1) = 1.0; });
  refuses([&](auto& s) {
    s.parts[0].has_grasp = true;
    s.parts[0].approach_camera *= 2.0;
  });
}

TEST(GarmentMap, GoesOnWithWhatItSaved) {
  TableTop world;
  GarmentMap garments({.needs_part = false});
  for (int k = 0; k < 3; ++k) {
    const Id id = world.look_from(kEye);
    garments.add(world.map, {id}, std::vector{world.see(id, kShirt, {{"collar", kShirt}})});
  }
  GarmentMap again({.needs_part = false}, garments.saved());
  for (int k = 0; k < 2; ++k) {
    const Id id = world.look_from(kEye);
    again.add(world.map, {id}, std::vector{world.see(id, kShirt)});
  }
  ASSERT_EQ(again.garments().size(), 1u);
  EXPECT_TRUE(again.garments()[0].in_map);
  EXPECT_EQ(again.garments()[0].id, garments.garments()[0].id);
  EXPECT_EQ(again.garments()[0].parts.size(), 1u);

  const auto refuses = [&](auto change) {
    SavedGarments bad = garments.saved();
    change(bad);
    EXPECT_THROW(GarmentMap({}, bad), Error);
  };
  refuses([](auto& s) { s.next_id = 0; });
  refuses([](auto& s) { s.garments.push_back(s.garments[0]); });
  refuses([](auto& s) { s.garments[0].extent_m = -1.0; });
  refuses([](auto& s) { s.garments[0].covariance.setZero(); });
  refuses([](auto& s) { s.garments[0].parts[0].probability = 1.5; });
  refuses([](auto& s) { s.garments[0].parts[0].approach_world.setZero(); });
}

TEST(GarmentMap, APointsCovarianceIsThatOfItsMeasurement) {
  Random random(9);
  const auto camera = test::kinect();
  const Eigen::Vector3d point(0.4, -0.2, 1.3);
  const Eigen::Vector2d pixel = camera.project(point);
  for (const Eigen::Vector2d& slope_m_px : {Eigen::Vector2d(0, 0), Eigen::Vector2d(0.004, -0.01)}) {
    Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
    constexpr int kDraws = 20000;
    for (int i = 0; i < kDraws; ++i) {
      const double du = 2.0 * test::gauss(random), dv = 2.0 * test::gauss(random);
      const double dz = 0.01 * test::gauss(random) + slope_m_px.dot(Eigen::Vector2d(du, dv));
      const Eigen::Vector3d e =
          camera.unproject(pixel.x() + du, pixel.y() + dv, point.z() + dz) - point;
      sum += e * e.transpose() / kDraws;
    }
    const Eigen::Matrix3d expected = point_covariance(camera, point, 2.0, 0.01, slope_m_px);
    EXPECT_LT((sum - expected).norm(), 0.03 * expected.norm());
  }
}

}  // namespace
}  // namespace weft::slam
