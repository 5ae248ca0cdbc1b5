#include "dataset/trajectory_file.hpp"

#include <gtest/gtest.h>

#include <random>

#include "support/files.hpp"

namespace weft::dataset {
namespace {

using test::error_of;

TEST(TrajectoryFile, StampsKeepEveryMicrosecond) {
  EXPECT_EQ(parse_stamp_us("1341841278.8427", "x"), 1341841278842700);
  EXPECT_EQ(parse_stamp_us("0", "x"), 0);
  EXPECT_EQ(parse_stamp_us("-1.5", "x"), -1500000);
  EXPECT_EQ(parse_stamp_us("+2.", "x"), 2000000);
  EXPECT_EQ(parse_stamp_us(".25", "x"), 250000);
  EXPECT_EQ(parse_stamp_us("0.0000014", "x"), 1);
  EXPECT_EQ(parse_stamp_us("0.0000015", "x"), 2);
  EXPECT_EQ(parse_stamp_us("0.00000149", "x"), 1);
  EXPECT_EQ(parse_stamp_us("1.3418e3", "x"), 1341800000);
  EXPECT_EQ(parse_stamp_us("4000000000000.000001", "x"), 4000000000000000001);
  for (const char* bad : {"", ".", "-", "1.2.3", "1a", "nan", "inf", "1e300", "99999999999999999"})
    EXPECT_NE(error_of([&] { parse_stamp_us(bad, "file:3"); }).find("file:3"), std::string::npos)
        << bad;
  EXPECT_EQ(format_stamp(1341841278842700), "1341841278.842700");
  EXPECT_EQ(format_stamp(-1500000), "-1.500000");
  EXPECT_EQ(format_stamp(-1), "-0.000001");
}

TEST(TrajectoryFile, ReadsWhatPublishedFilesHold) {
  const auto trajectory = parse_trajectory(
      "# timestamp tx ty tz qx qy qz qw\r\n\n"
      "2.5\t-2.5508\t0.9872\t1.1019\t-0.4871\t0.7673\t-0.3519\t0.2239\t\r\n"
      "1.25 1 2 3 0 0 0 -1\n",
      "x");
  ASSERT_EQ(trajectory.size(), 2u);
  EXPECT_EQ(trajectory[0].utime, 1250000);  // by time
  EXPECT_EQ(trajectory[0].camera_in_world, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(trajectory[0].rotation_world_camera.w(), -1.0);
  EXPECT_EQ(trajectory[1].camera_in_world.x(), -2.5508);
  EXPECT_NEAR(trajectory[1].rotation_world_camera.norm(), 1.0, 1e-15);
  EXPECT_NEAR(trajectory[1].rotation_world_camera.x(), -0.4871, 2e-4);
}

TEST(TrajectoryFile, EveryFaultNamesItsLine) {
  const auto error = [](const std::string& text) {
    return error_of([&] { parse_trajectory(text, "poses.txt"); });
  };
  EXPECT_NE(error("").find("holds no pose"), std::string::npos);
  EXPECT_NE(error("# nothing\n").find("holds no pose"), std::string::npos);
  EXPECT_NE(error("1 2 3\n").find("poses.txt:1: 3 words"), std::string::npos);
  EXPECT_NE(error("\n1 0 0 0 0 0 0 2\n").find("poses.txt:2: the quaternion"), std::string::npos);
  EXPECT_NE(error("1 0 x 0 0 0 0 1\n").find("'x' is no finite number"), std::string::npos);
  EXPECT_NE(error("1 0 nan 0 0 0 0 1\n").find("no finite number"), std::string::npos);
  EXPECT_NE(error("1 0 0 0 0 0 0 1\n1.0 1 0 0 0 0 0 1\n").find("two poses at 1.000000 s"),
            std::string::npos);
  EXPECT_NE(error_of([] { read_trajectory("/no/such/file"); }).find("/no/such/file"),
            std::string::npos);
}

TEST(TrajectoryFile, WhatIsWrittenIsReadBack) {
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  Trajectory trajectory;
  for (int i = 0; i < 50; ++i) {
    StampedPose pose;
    pose.utime = 1'700'000'000'000'000 + 33'333 * i;
    pose.camera_in_world = {normal(random), normal(random), 1e4 * normal(random)};
    pose.rotation_world_camera =
        Eigen::Quaterniond(normal(random), normal(random), normal(random), normal(random))
            .normalized();
    trajectory.push_back(pose);
  }
  const test::TemporaryFolder folder;
  write_trajectory(folder / "a.txt", trajectory);
  const auto back = read_trajectory(folder / "a.txt");
  ASSERT_EQ(back.size(), trajectory.size());
  for (std::size_t i = 0; i < back.size(); ++i) {
    EXPECT_EQ(back[i].utime, trajectory[i].utime);
    EXPECT_LT((back[i].camera_in_world - trajectory[i].camera_in_world).norm(), 1e-9);
    EXPECT_LT(back[i].rotation_world_camera.angularDistance(trajectory[i].rotation_world_camera),
              1e-8);
  }
  EXPECT_NE(error_of([&] {
              write_trajectory("/no/such/folder/a.txt", trajectory);
            }).find("cannot be written"),
            std::string::npos);
}

TEST(TrajectoryFile, RealTruthIsRead) {
  const auto data = test::data_folder();
  WEFT_NEEDS_DATA(data / "tum-fr3-cabinet-58");
  const auto cabinet = read_trajectory((data / "tum-fr3-cabinet-58/truth_cam_poses.txt").string());
  ASSERT_EQ(cabinet.size(), 58u);
  EXPECT_EQ(cabinet[0].utime, 1341841278842700);
  const auto kitchen = read_trajectory((data / "7scenes-redkitchen-200/groundtruth.txt").string());
  EXPECT_EQ(kitchen.size(), 200u);
}

}  // namespace
}  // namespace weft::dataset
