#include <OpenNI.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stop_token>
#include <thread>

#include "openni_driver/scene.hpp"
#include "procs/capture/log.hpp"
#include "procs/capture/openni_camera.hpp"
#include "procs/capture/source.hpp"
#include "stage/log.hpp"
#include "support/files.hpp"

#ifdef __SANITIZE_ADDRESS__
/// OpenNI2 keeps what it allocated when its drivers are unloaded; which of them it was cannot be
/// told any more, so that no suppression could name it.
extern "C" const char* __asan_default_options() { return "detect_leaks=0"; }
#endif

/// Runs against a copy of libOpenNI2 whose only drivers are the test camera and the player of
/// recordings (tests/openni_driver).
namespace weft::capture_process {
namespace {

using test::error_of;

/// The number of the camera's frame this is; every pixel must be that frame's.
int check_frame(const rgbd::RgbdFrame& frame) {
  const test::DriverScene scene{frame.camera.width, frame.camera.height};
  const int number = frame.depth.at<std::uint16_t>(0, 0) - 1000;
  int wrong = 0;
  for (int v = 0; v < scene.height; ++v) {
    for (int u = 0; u < scene.width; ++u) {
      const cv::Vec3b bgr = frame.colour.at<cv::Vec3b>(v, u);
      wrong += frame.depth.at<std::uint16_t>(v, u) != scene.depth(number, u, v);
      for (int channel = 0; channel < 3; ++channel)
        wrong += bgr[2 - channel] != scene.colour(number, u, v, channel);
    }
  }
  EXPECT_EQ(wrong, 0) << "frame " << number;
  return number;
}

class OpenNi : public testing::TestWithParam<std::pair<int, int>> {
 protected:
  OpenNiOptions options() const {
    OpenNiOptions options;
    options.width_px = GetParam().first;
    options.height_px = GetParam().second;
    options.timeout_s = 60.0;  // for a busy machine
    return options;
  }
};

/// Records all that the test camera serves.
void record(const std::string& path, int width, int height) {
  ASSERT_EQ(openni::OpenNI::initialize(), openni::STATUS_OK);
  {
    openni::Device device;
    ASSERT_EQ(device.open(openni::ANY_DEVICE), openni::STATUS_OK);
    ASSERT_EQ(device.setImageRegistrationMode(openni::IMAGE_REGISTRATION_DEPTH_TO_COLOR),
              openni::STATUS_OK);
    openni::VideoStream depth, colour;
    ASSERT_EQ(depth.create(device, openni::SENSOR_DEPTH), openni::STATUS_OK);
    ASSERT_EQ(colour.create(device, openni::SENSOR_COLOR), openni::STATUS_OK);
    for (openni::VideoStream* stream : {&depth, &colour}) {
      openni::VideoMode mode = stream->getVideoMode();
      mode.setResolution(width, height);
      ASSERT_EQ(stream->setVideoMode(mode), openni::STATUS_OK);
    }
    openni::Recorder recorder;
    ASSERT_EQ(recorder.create(path.c_str()), openni::STATUS_OK);
    ASSERT_EQ(recorder.attach(depth, false), openni::STATUS_OK);
    ASSERT_EQ(recorder.attach(colour, false), openni::STATUS_OK);
    ASSERT_EQ(recorder.start(), openni::STATUS_OK);
    ASSERT_EQ(depth.start(), openni::STATUS_OK);
    ASSERT_EQ(colour.start(), openni::STATUS_OK);
    // Images may be missed here, but not the last ones: they stay until they are read.
    openni::VideoStream* streams[] = {&depth, &colour};
    for (int last[] = {0, 0}; std::min(last[0], last[1]) < test::kDriverFrames;) {
      int ready = -1;
      ASSERT_EQ(openni::OpenNI::waitForAnyStream(streams, 2, &ready, 20000), openni::STATUS_OK);
      openni::VideoFrameRef image;
      ASSERT_EQ(streams[ready]->readFrame(&image), openni::STATUS_OK);
      last[ready] = image.getFrameIndex();
    }
    // In this order: OpenNI2 may lock up when a recorder goes while frames come in.
    depth.stop();
    colour.stop();
    recorder.stop();
    recorder.destroy();
  }
  openni::OpenNI::shutdown();
}

TEST_P(OpenNi, ACamerasFramesArriveBitForBit) {
  OpenNiCamera camera("any", options());
  EXPECT_FALSE(camera.is_recording());
  // A busy machine may miss some, but not the last one: it stays until it is read.
  for (int last = -1; last < test::kDriverFrames - 1;) {
    rgbd::RgbdFrame frame;
    std::int64_t time_us = -1;
    ASSERT_TRUE(camera.next(frame, time_us, {}));
    EXPECT_EQ(frame.camera.width, GetParam().first);
    EXPECT_EQ(frame.camera.height, GetParam().second);
    const int number = check_frame(frame);
    EXPECT_GT(number, last);
    last = number;
    EXPECT_NEAR(static_cast<double>(time_us), number * 1e6 / test::kDriverRateHz, 1.0);
    EXPECT_NEAR(frame.camera.fx,
                GetParam().first / 2.0 / std::tan(test::kDriverFieldOfViewRad / 2.0), 1e-3);
    EXPECT_EQ(frame.depth_unit_m, 0.001);
  }
}

TEST_P(OpenNi, ARecordingIsReadBackBitForBitAndEnds) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.oni";
  record(path, GetParam().first, GetParam().second);
  OpenNiOptions options;
  options.timeout_s = 60.0;
  OpenNiCamera camera(path, options);  // of the recording's size, whatever the options say
  EXPECT_TRUE(camera.is_recording());
  EXPECT_EQ(camera.frame_count(), test::kDriverFrames);
  int frames = 0;
  rgbd::RgbdFrame frame;
  for (std::int64_t time_us = 0; camera.next(frame, time_us, {}); ++frames) {
    ASSERT_EQ(frame.camera.width, GetParam().first);
    EXPECT_EQ(check_frame(frame), frames);
  }
  EXPECT_EQ(frames, test::kDriverFrames);
}

INSTANTIATE_TEST_SUITE_P(Sizes, OpenNi,
                         testing::Values(std::pair{640, 480}, std::pair{320, 240},
                                         std::pair{1280, 720}));

TEST(OpenNiRecording, BecomesALogAndBackBitForBit) {
  const test::TemporaryFolder folder;
  record(folder / "a.oni", 320, 240);
  Settings settings = Settings::empty("test");
  settings.set("device=" + (folder / "a.oni"));
  settings.set("encoding.colour=png");
  settings.set("openni.timeout_s=60");
  std::string logs[2];
  for (const char* name : {"1.lcm", "2.lcm"}) {
    const auto source = make_source(settings);
    LogOptions options;
    options.session = source->default_session();
    const LogResult result = write_log(*source, folder / name, options);
    EXPECT_TRUE(result.errors.empty());
    EXPECT_EQ(result.frames, test::kDriverFrames);
    logs[name[0] - '1'] = test::read_bytes(folder / name);
  }
  EXPECT_EQ(logs[0], logs[1]);
  stage::LogReader log(folder / "1.lcm");
  stage::LogEvent event;
  std::int64_t first_utime = 0;
  for (int i = 0; i < test::kDriverFrames; ++i) {
    ASSERT_TRUE(log.next(event));
    rgbd_frame_t message;
    ASSERT_GT(message.decode(event.data.data(), 0, static_cast<int>(event.data.size())), 0);
    EXPECT_EQ(message.header.seq, i);
    EXPECT_EQ(check_frame(messages::from_message(message)), i);
    if (i == 0) first_utime = message.header.utime;
    EXPECT_NEAR(static_cast<double>(message.header.utime - first_utime),
                i * 1e6 / test::kDriverRateHz, 2.0);
  }
  EXPECT_FALSE(log.next(event));
}

TEST(OpenNiErrors, WithoutACameraSayWhatWasLookedFor) {
  const std::string error = error_of([] { OpenNiCamera("1d27/0601@9/9", {}); });
  EXPECT_NE(error.find("no camera \"1d27/0601@9/9\" found"), std::string::npos) << error;
  EXPECT_NE(error.find("openni2/OpenNI2/Drivers: lib"), std::string::npos) << error;
  EXPECT_NE(error.find("USB devices of depth cameras"), std::string::npos) << error;
  EXPECT_NE(error.find("udev rules: /lib/udev/rules.d/60-libopenni2-0.rules"), std::string::npos);
  EXPECT_NE(error.find(".oni"), std::string::npos);
}

TEST(OpenNiErrors, ASizeTheCameraDoesNotOfferIsNamedWithThoseItDoes) {
  OpenNiOptions options;
  options.width_px = 641;
  const std::string error = error_of([&] { OpenNiCamera("any", options); });
  EXPECT_NE(error.find("641x480@30; it offers 640x480@30 320x240@30 1280x720@30"),
            std::string::npos)
      << error;
}

TEST(OpenNiErrors, ARecordingThatIsNoneIsAnError) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.oni";
  EXPECT_EQ(error_of([&] { OpenNiCamera(path, {}); }), path + ": no such recording");
  for (const std::string& bytes : {std::string(), std::string("NI"), std::string(5000, 'x')}) {
    test::write_bytes(path, bytes);
    EXPECT_EQ(error_of([&] { OpenNiCamera(path, {}); }).find(path), 0u);
  }
}

TEST(OpenNiErrors, ACameraThatFallsSilentIsAnErrorAndAStopIsNot) {
  OpenNiOptions options;
  options.timeout_s = 0.5;
  options.width_px = 320;
  options.height_px = 240;
  OpenNiCamera camera("any", options);
  rgbd::RgbdFrame frame;
  std::int64_t time_us = 0;
  std::stop_source stopped;
  stopped.request_stop();
  EXPECT_FALSE(camera.next(frame, time_us, stopped.get_token()));
  const std::string error = error_of([&] {
    for (int i = 0; i <= test::kDriverFrames; ++i) camera.next(frame, time_us, {});
  });
  EXPECT_NE(error.find("no pair of images"), std::string::npos) << error;
}

}  // namespace
}  // namespace weft::capture_process
