// The mapping half end to end, on a short log of a room by formula that the test makes: real
// processes over real LCM and all stages in one process say the same bytes, the poses are right,
// and the tools read what was said.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/text_file.hpp"
#include "dataset/trajectory_file.hpp"
#include "room_log.hpp"
#include "support/textured_room.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";
const std::string kSource = WEFT_SOURCE_DIR;
constexpr int kFrames = 10;

class MapSet : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("weft-map-" + std::to_string(getpid()));
    fs::create_directories(folder_);
    const auto truth = test::write_room_log(file("room.lcm"), kFrames);
    dataset::write_trajectory(file("truth.txt"), truth);
  }
  static void TearDownTestSuite() {
    if (!HasFailure()) fs::remove_all(folder_);
  }
  static std::string file(const std::string& name) { return (folder_ / name).string(); }
  static void run(std::vector<std::string> args) {
    args.insert(args.begin(), kWeft);
    const auto result = run_command(args);
    ASSERT_EQ(result.status, 0) << result.output;
  }
  static void replay(const std::string& out, const std::vector<std::string>& more) {
    std::vector<std::string> args{
        "replay", file("room.lcm"), "--set", kSource + "/config/sets/map.yaml", "--out", file(out)};
    args.insert(args.end(), more.begin(), more.end());
    run(args);
  }
  static fs::path folder_;
};
fs::path MapSet::folder_;

TEST_F(MapSet, RepeatsToTheBitAndTellsTheTruth) {
  replay("processes.lcm", {"--verify"});
  replay("one.lcm", {"--in-process", "--verify", file("processes.lcm")});

  run({"evaluate", "trajectory", file("processes.lcm"), "--truth", file("truth.txt"), "--set",
       "alignment=none", "--json", file("trajectory.json")});
  const auto judged = nlohmann::json::parse(read_text_file(file("trajectory.json")));
  EXPECT_EQ(judged.at("poses"), kFrames);
  EXPECT_EQ(judged.at("frames"), kFrames);
  EXPECT_EQ(judged.at("tracking").at("tracked"), kFrames);
  EXPECT_EQ(judged.at("tracking").at("maps"), 1);
  EXPECT_LT(judged.at("ate_rmse_m").get<double>(), 0.01);

  run({"export", "map", file("processes.lcm"), "--ply", file("map.ply"), "--pcd", file("map.pcd"),
       "--obj", file("map.obj"), "--json", file("map.json"), "--top", file("top.png"), "--oblique",
       file("oblique.png"), "--path", file("path.txt")});
  const auto map = nlohmann::json::parse(read_text_file(file("map.json")));
  EXPECT_EQ(map.at("path").size(), kFrames);
  EXPECT_GT(map.at("points").size(), 200u);
  // The floor, the wall ahead: normals and distances as in the room, with the camera's first pose
  // as the world.
  int walls = 0;
  const test::TexturedRoom room;
  for (const auto& plane : map.at("planes")) {
    const auto n = plane.at("normal").get<std::vector<double>>();
    for (const auto& wall : room.walls) {
      const double cosine = wall.normal.dot(Eigen::Vector3d(n[0], n[1], n[2]));
      walls += cosine > 0.9998 &&
               std::abs(plane.at("distance_m").get<double>() - wall.distance_m) < 0.02;
    }
  }
  EXPECT_GE(walls, 3);
  EXPECT_EQ(read_text_file(file("map.ply")).substr(0, 4), "ply\n");
  EXPECT_EQ(dataset::read_trajectory(file("path.txt")).size(), std::size_t{kFrames});
}

}  // namespace
}  // namespace weft
