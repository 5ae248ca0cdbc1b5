// The mapping half on a short log of a room by formula, against answers kept in the repository.
// Planes are the same bits on every machine, so their payloads are pinned. Poses and map are the
// same bits on one machine only: two replays must agree to the bit, and with the kept answers they
// are compared as numbers. When an answer is meant to change, copy the file that the failed test
// names over the kept one.
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/text_file.hpp"
#include "integration/set_replay.hpp"
#include "room_log.hpp"
#include "tools/weft/run_folder.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

const std::string kWeft = WEFT_BINARY_DIR "/bin/weft";
const std::string kSource = WEFT_SOURCE_DIR;
constexpr int kFrames = 24;

class MapGolden : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = fs::temp_directory_path() / ("weft-map-golden-" + std::to_string(getpid()));
    fs::create_directories(folder_);
    test::write_room_log(file("room.lcm"), kFrames, 3.0);
  }
  void TearDown() override { failed_ = failed_ || HasFailure(); }
  static void TearDownTestSuite() {
    if (!failed_) fs::remove_all(folder_);
  }
  static std::string file(const std::string& name) { return (folder_ / name).string(); }
  static std::string run(std::vector<std::string> args) {
    const auto result = run_command(args);
    EXPECT_EQ(result.status, 0) << result.output;
    return result.output;
  }
  static void replay(const std::string& out, std::vector<std::string> command,
                     const std::vector<std::string>& more = {}) {
    for (const std::string& each : {kWeft, std::string("replay"), file("room.lcm"),
                                    std::string("--set"), kSource + "/config/sets/map.yaml",
                                    std::string("--in-process"), std::string("--out"), file(out)})
      command.push_back(each);
    command.insert(command.end(), more.begin(), more.end());
    run(command);
  }
  void expect_golden(const std::string& log) const;

  static fs::path folder_;
  static bool failed_;
};
fs::path MapGolden::folder_;
bool MapGolden::failed_ = false;

/// Lines of seq, channel and hash, of one channel.
std::string lines_of(const std::string& channel, const std::string& hashes) {
  std::istringstream in(hashes);
  std::string out;
  for (std::string line; std::getline(in, line);)
    if (line.find(" " + channel + " ") != std::string::npos) out += line + "\n";
  return out;
}

/// Lines of a word and numbers: poses as they were said (s, m, quaternion), frames that became key
/// frames, planes (normal, m), the number of points.
std::string summary(const std::string& path_text, const nlohmann::json& map) {
  std::ostringstream out;
  std::istringstream path(path_text);
  for (std::string line; std::getline(path, line);)
    if (!line.empty() && line[0] != '#') out << "pose " << line << "\n";
  for (const auto& key_frame : map.at("key_frames"))
    out << "key_frame " << key_frame.at("frame") << "\n";
  for (const auto& plane : map.at("planes")) {
    out << "plane";
    for (const double x : plane.at("normal")) out << " " << x;
    out << " " << plane.at("distance_m").get<double>() << "\n";
  }
  out << "points " << map.at("points").size() << "\n";
  return out.str();
}

/// The first line in which two summaries differ by more than another processor may make them
/// differ; empty: none.
std::string difference(const std::string& expected, const std::string& now) {
  std::istringstream a(expected), b(now);
  std::string line_a, line_b;
  while (true) {
    const bool more_a = static_cast<bool>(std::getline(a, line_a));
    const bool more_b = static_cast<bool>(std::getline(b, line_b));
    if (!more_a && !more_b) return "";
    const std::string both = line_a + "\n" + line_b;
    if (more_a != more_b) return both;
    std::istringstream words_a(line_a), words_b(line_b);
    std::string kind_a, kind_b;
    words_a >> kind_a;
    words_b >> kind_b;
    if (kind_a != kind_b) return both;
    double x = 0.0, y = 0.0;
    while (words_a >> x) {
      const double most = kind_a == "pose"     ? 0.001  // m, and 0.1 degrees
                          : kind_a == "plane"  ? 0.003  // m, and 0.2 degrees
                          : kind_a == "points" ? 0.05 * x
                                               : 0.0;
      if (!(words_b >> y) || !(std::abs(x - y) <= most)) return both;
    }
    if (words_b >> y) return both;
  }
}

void MapGolden::expect_golden(const std::string& log) const {
  const auto golden = [](const std::string& name) {
    return kSource + "/tests/integration/golden/" + name;
  };
  const auto planes = lines_of("PLANES", run({kWeft, "log", "hash", file(log)}));
  write_text_file(file(log + ".planes.txt"), planes);
  EXPECT_EQ(planes, read_text_file(golden("map-planes.txt")))
      << "now: " << file(log + ".planes.txt") << "; kept: " << golden("map-planes.txt");

  run({kWeft, "export", "map", file(log), "--live", "--path", file(log + ".path.txt"), "--json",
       file(log + ".json")});
  const auto now = summary(read_text_file(file(log + ".path.txt")),
                           nlohmann::json::parse(read_text_file(file(log + ".json"))));
  write_text_file(file(log + ".map.txt"), now);
  EXPECT_EQ(difference(read_text_file(golden("map.txt")), now), "")
      << "now: " << file(log + ".map.txt") << "; kept: " << golden("map.txt");
}

TEST_F(MapGolden, AnswersAsEverAndTwiceToTheBit) {
  replay("one.lcm", {}, {"--verify"});
  expect_golden("one.lcm");
}

TEST_F(MapGolden, AnswersAlikeOnANarrowProcessor) {
  std::vector<std::string> command{"env"};
  for (const auto& [name, value] : test::narrow_processor()) command.push_back(name + "=" + value);
  replay("narrow.lcm", command);
  expect_golden("narrow.lcm");
}

TEST(MapGoldenSummary, TellsDifferencesFromRounding) {
  const std::string kept = "pose 1.5 0 0 0 0 0 0 1\nkey_frame 3\npoints 100\n";
  EXPECT_EQ(difference(kept, kept), "");
  EXPECT_EQ(difference(kept, "pose 1.5 0.0009 0 0 0 0 0 1\nkey_frame 3\npoints 104\n"), "");
  for (const char* other :
       {"pose 1.5 0.0011 0 0 0 0 0 1\nkey_frame 3\npoints 100\n",
        "pose 1.5 0 0 0 0 0 0 1\nkey_frame 4\npoints 100\n",
        "pose 1.5 0 0 0 0 0 0 1\nkey_frame 3\npoints 106\n",
        "pose 1.5 0 0 0 0 0 0 1\nkey_frame 3\n", "pose 1.5 0 0 0 0 0 0\nkey_frame 3\npoints 100\n",
        "pose 1.5 nan 0 0 0 0 0 1\nkey_frame 3\npoints 100\n", ""})
    EXPECT_NE(difference(kept, other), "") << other;
}

}  // namespace
}  // namespace weft
