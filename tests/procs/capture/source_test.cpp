#include "procs/capture/source.hpp"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <tuple>

#include "procs/capture/log.hpp"
#include "stage/log.hpp"
#include "support/files.hpp"

namespace weft::capture_process {
namespace {

using test::error_of;

cv::Mat colour_image(int shade) { return cv::Mat(24, 32, CV_8UC3, cv::Scalar(shade, 90, 40)); }
cv::Mat depth_image(int depth) { return cv::Mat(24, 32, CV_16UC1, cv::Scalar(depth)); }

/// Scans a, b (broken) and c.
void write_scans(const test::TemporaryFolder& folder) {
  for (const char* name : {"a", "b", "c"}) {
    cv::imwrite(folder / (std::string(name) + "_rgb.png"), colour_image(name[0]));
    cv::imwrite(folder / (std::string(name) + "_depth.png"), depth_image(name[0]));
  }
  test::write_bytes(folder / "b_depth.png", "broken");
}

Settings settings_of(const std::vector<std::string>& assignments) {
  Settings settings = Settings::empty("test");
  for (const std::string& each : assignments) settings.set(each);
  return settings;
}

std::vector<rgbd_frame_t> frames_of_log(const std::string& path) {
  std::vector<rgbd_frame_t> frames;
  stage::LogReader log(path);
  for (stage::LogEvent event; log.next(event);) {
    EXPECT_EQ(event.channel, "RGBD_FRAME");
    frames.emplace_back();
    EXPECT_EQ(frames.back().decode(event.data.data(), 0, static_cast<int>(event.data.size())),
              static_cast<int>(event.data.size()));
  }
  return frames;
}

TEST(CaptureSource, AFolderBecomesALogAndABrokenScanAFailedFrame) {
  const test::TemporaryFolder folder;
  write_scans(folder);
  const auto source = make_source(settings_of({"dataset=" + folder.string(), "loop=2"}));
  EXPECT_EQ(source->frame_count(), 6);
  const LogResult result = write_log(*source, folder / "x.lcm", {.rate_hz = 4.0});
  EXPECT_EQ(result.frames, 6);
  ASSERT_EQ(result.errors.size(), 2u);
  EXPECT_NE(result.errors[0].find(folder / "b_depth.png"), std::string::npos);
  const auto frames = frames_of_log(folder / "x.lcm");
  ASSERT_EQ(frames.size(), 6u);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    EXPECT_EQ(frames[i].header.seq, static_cast<std::int64_t>(i));
    EXPECT_EQ(frames[i].header.utime - frames[0].header.utime,
              static_cast<std::int64_t>(i) * 250'000);
    EXPECT_EQ(frames[i].header.coordinate_frame, "camera");
    if (i % 3 == 1) {
      EXPECT_EQ(frames[i].status.code, status_t::FAILED);
      EXPECT_EQ(frames[i].status.reason, static_cast<int>(stage::Reason::kSourceError));
      EXPECT_NE(frames[i].status.text.find("neither a PNG nor a JPEG"), std::string::npos);
    } else {
      EXPECT_EQ(frames[i].status.code, status_t::OK);
      EXPECT_EQ(frames[i].source, i % 3 == 0 ? "a" : "c");
      EXPECT_EQ(messages::from_message(frames[i]).depth.at<std::uint16_t>(5, 5),
                i % 3 == 0 ? 'a' : 'c');
    }
  }
}

TEST(CaptureSource, ViewsAreShownUnderTheirNames) {
  const test::TemporaryFolder folder;
  write_scans(folder);
  const auto source = make_source(
      settings_of({"dataset=" + folder.string(), "views.rotations=4", "views.mirror=true"}));
  EXPECT_EQ(source->frame_count(), 24);
  write_log(*source, folder / "x.lcm", {});
  const auto frames = frames_of_log(folder / "x.lcm");
  ASSERT_EQ(frames.size(), 24u);
  EXPECT_EQ(frames[1].source, "a@r90");
  EXPECT_EQ(frames[1].camera_model.width, 24);
  EXPECT_EQ(frames[7].source, "a@r270m");
}

TEST(CaptureSource, TheSameFilesGiveTheSameLogWhereverTheyLie) {
  const test::TemporaryFolder here, there;
  write_scans(here);
  write_scans(there);
  std::string logs[2];
  std::int64_t sessions[2];
  for (int i = 0; i < 2; ++i) {
    const auto& folder = i == 0 ? here : there;
    std::filesystem::remove(folder / "b_rgb.png");
    const auto source = make_source(settings_of({"dataset=" + folder.string()}));
    sessions[i] = source->default_session();
    write_log(*source, folder / "x.lcm", {.session = sessions[i]});
    logs[i] = test::read_bytes(folder / "x.lcm");
  }
  EXPECT_EQ(sessions[0], sessions[1]);
  EXPECT_EQ(logs[0], logs[1]);
  const auto other = make_source(settings_of({"dataset=" + here.string(), "views.mirror=true"}));
  EXPECT_NE(other->default_session(), sessions[0]);
}

TEST(CaptureSource, OnePairIsASource) {
  const test::TemporaryFolder folder;
  write_scans(folder);
  const auto source = make_source(settings_of(
      {"colour=" + (folder / "a_rgb.png"), "depth=" + (folder / "a_depth.png"), "scans.fx_px=77"}));
  EXPECT_EQ(write_log(*source, folder / "x.lcm", {}).frames, 1);
  EXPECT_EQ(frames_of_log(folder / "x.lcm").at(0).camera_model.fx, 77.0);
}

/// Three frames in the layout of the TUM benchmark, at 10 Hz from 5.25 s on.
void write_recording(const test::TemporaryFolder& folder) {
  std::string colours = "# colour\n", depths = "# depth\n";
  for (const char* sub : {"rgb", "depth"}) std::filesystem::create_directory(folder / sub);
  for (int i = 0; i < 3; ++i) {
    const std::string name = std::to_string(i) + ".png";
    const std::string stamp = "5." + std::to_string(250 + 100 * i);
    cv::imwrite(folder / ("rgb/" + name), colour_image(10 + i));
    cv::imwrite(folder / ("depth/" + name), depth_image(5000 + i));
    colours += stamp + " rgb/" + name + "\n";
    depths += stamp + " depth/" + name + "\n";
  }
  test::write_bytes(folder / "rgb.txt", colours);
  test::write_bytes(folder / "depth.txt", depths);
  test::write_bytes(folder / "camera.yaml",
                    "{width: 32, height: 24, fx: 30, fy: 31, cx: 15, cy: 11, depth_factor: 5000}");
}

TEST(CaptureSource, ARecordingKeepsItsTimesAndItsCamera) {
  const test::TemporaryFolder folder;
  write_recording(folder);
  for (const char* format : {"auto", "tum"}) {
    const auto source = make_source(
        settings_of({"dataset=" + folder.string(), std::string("format=") + format, "loop=2"}));
    EXPECT_EQ(source->frame_count(), 6);
    EXPECT_EQ(write_log(*source, folder / "x.lcm", {}).errors.size(), 0u);
    const auto frames = frames_of_log(folder / "x.lcm");
    ASSERT_EQ(frames.size(), 6u);
    for (std::size_t i = 0; i < 6; ++i) {
      EXPECT_EQ(frames[i].header.seq, static_cast<std::int64_t>(i));
      EXPECT_EQ(frames[i].header.utime, 5'250'000 + static_cast<std::int64_t>(i) * 100'000);
      EXPECT_EQ(frames[i].source, std::to_string(i % 3) + ".png");
      EXPECT_EQ(frames[i].camera_model.fy, 31.0);
      EXPECT_EQ(frames[i].depth_unit_m, 1.0 / 5000.0);
      EXPECT_EQ(messages::from_message(frames[i]).depth.at<std::uint16_t>(5, 5), 5000 + i % 3);
    }
  }
}

TEST(CaptureSource, ARecordingOfAnotherFormatIsRefused) {
  const test::TemporaryFolder folder;
  write_recording(folder);
  const auto error = [&](const std::string& more) {
    return error_of([&] { make_source(settings_of({"dataset=" + folder.string(), more})); });
  };
  EXPECT_NE(error("format=7scenes").find("it looks like tum"), std::string::npos);
  EXPECT_NE(error("views.mirror=true").find("format=pairs"), std::string::npos);
  EXPECT_NE(error("format=kitti").find("format"), std::string::npos);
  // Taken as single scans, it has neither times nor its own camera.
  const auto scans = make_source(settings_of({"dataset=" + folder.string(), "format=pairs"}));
  EXPECT_EQ(scans->frame_count(), 3);
}

TEST(CaptureSource, RealRecordingsAreTold) {
  for (const auto& [name, format, frames] : {std::tuple("tum-fr3-cabinet-58", "cube_slam", 58),
                                             {"7scenes-redkitchen-200", "7scenes", 200},
                                             {"icl-livingroom1-211", "icl", 211}}) {
    const auto folder = test::data_folder() / name;
    WEFT_NEEDS_DATA(folder);
    const auto source =
        make_source(settings_of({"dataset=" + folder.string(), std::string("format=") + format}));
    EXPECT_EQ(source->frame_count(), frames) << name;
  }
}

TEST(CaptureSource, ExactlyOneSourceIsNeeded) {
  for (const auto& assignments : std::vector<std::vector<std::string>>{
           {}, {"dataset=a", "device=any"}, {"pcd=a", "colour=a", "depth=b"}})
    EXPECT_NE(error_of([&] { make_source(settings_of(assignments)); }).find("exactly one source"),
              std::string::npos);
  EXPECT_NE(error_of([&] { make_source(settings_of({"colour=a"})); }).find("needs both"),
            std::string::npos);
  EXPECT_NE(error_of([&] { make_source(settings_of({"dataset=/none"})); }).find("/none"),
            std::string::npos);
  EXPECT_NE(error_of([&] { make_source(settings_of({"datasett=/none"})); }).find("datasett"),
            std::string::npos);
}

TEST(CaptureProgram, WritesALogAndSaysWhatFailed) {
  const test::TemporaryFolder folder;
  write_scans(folder);
  const auto run = [&](const std::string& arguments) {
    const std::string command = std::string(WEFT_BINARY_DIR "/bin/weft-capture ") + arguments +
                                " > " + (folder / "out.txt") + " 2>&1";
    const int status = std::system(command.c_str());
    return std::pair(WIFEXITED(status) ? WEXITSTATUS(status) : -1,
                     test::read_bytes(folder / "out.txt"));
  };
  const std::string log = folder / "x.lcm";
  auto [status, text] = run("--dataset " + folder.string() + " --out " + log + " --rotations 2");
  EXPECT_EQ(status, 1);  // scan b is broken
  EXPECT_NE(text.find("b_depth.png"), std::string::npos) << text;
  EXPECT_NE(text.find("6 frames, 2 of them failed"), std::string::npos) << text;
  EXPECT_EQ(frames_of_log(log).size(), 6u);
  std::filesystem::remove(folder / "b_rgb.png");
  std::tie(status, text) = run("--dataset " + folder.string() + " --out " + log);
  EXPECT_EQ(status, 0) << text;
  EXPECT_EQ(frames_of_log(log).size(), 2u);
  std::tie(status, text) = run("--dataset " + folder.string() + " --out " + log + " --nonsense");
  EXPECT_EQ(status, 2) << text;
  std::tie(status, text) = run("--help");
  EXPECT_EQ(status, 0);
  EXPECT_NE(text.find("--dataset"), std::string::npos);
  EXPECT_NE(text.find("--trigger"), std::string::npos);
}

TEST(CaptureRealScans, CtuBecomesALogOfSingleMessages) {
  const auto data = test::data_folder() / "ctu-garments-3";
  WEFT_NEEDS_DATA(data);
  const test::TemporaryFolder folder;
  const auto source = make_source(settings_of({"dataset=" + data.string()}));
  const LogResult result = write_log(*source, folder / "x.lcm", {});
  EXPECT_EQ(result.frames, 3);
  EXPECT_EQ(result.messages, 3);
  EXPECT_TRUE(result.errors.empty());
  EXPECT_EQ(frames_of_log(folder / "x.lcm").at(0).source, "00023");
}

}  // namespace
}  // namespace weft::capture_process
