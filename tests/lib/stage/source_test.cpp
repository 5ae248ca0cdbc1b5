#include "stage/source.hpp"

#include <gtest/gtest.h>

#include "fake_stage.hpp"

namespace weft::stage {
namespace {

using namespace fake;

class FakeSource : public Source {
 public:
  explicit FakeSource(std::function<bool(int, Outputs&)> body) : body_(std::move(body)) {
    interface_.name = "capture";
    interface_.outputs = {port<rgbd_frame_t>("RGBD_FRAME")};
  }
  const Interface& interface() const override { return interface_; }
  bool next(Outputs& outputs, const std::stop_token&) override { return body_(calls_++, outputs); }

 private:
  Interface interface_;
  std::function<bool(int, Outputs&)> body_;
  int calls_ = 0;
};

TEST(Source, NamesItsFrames) {
  FakeSource source([](int call, Outputs& out) {
    auto& m = out.at<rgbd_frame_t>("RGBD_FRAME");
    m.header.seq = 77;
    m.header.camera = "nonsense";
    if (call == 1) m.header.utime = 123;
    EXPECT_EQ(m.part_count, 1);  // preset, so that a failed frame is a whole one
    return call < 3;
  });
  SourceRunner runner(source, {"left", 5, {{"RGBD_FRAME", "RGBD_FRAME@left"}}});
  for (int seq = 0; seq < 3; ++seq) {
    const auto answer = runner.next(1000 + seq);
    ASSERT_TRUE(answer);
    ASSERT_EQ(answer->messages.size(), 1u);
    EXPECT_EQ(answer->messages[0].channel, "RGBD_FRAME@left");
    const auto m = decode<rgbd_frame_t>(answer->messages[0].bytes);
    EXPECT_EQ(m.header.camera, "left");
    EXPECT_EQ(m.header.session, 5);
    EXPECT_EQ(m.header.seq, seq);
    EXPECT_EQ(m.header.coordinate_frame, "camera");
    EXPECT_EQ(m.header.utime, seq == 1 ? 123 : 1000 + seq);
    EXPECT_EQ(encode(answer->header), encode(m.header));
  }
  EXPECT_FALSE(runner.next(0));
}

TEST(Source, FailsOneFrameAndGoesOn) {
  FakeSource source([](int call, Outputs& out) {
    out.at<rgbd_frame_t>("RGBD_FRAME").source = "half";
    if (call == 1) throw Error("scene2/depth.png: cannot be read");
    return call < 3;
  });
  SourceRunner runner(source, {});
  std::vector<rgbd_frame_t> frames;
  while (const auto answer = runner.next(0))
    frames.push_back(decode<rgbd_frame_t>(answer->messages.at(0).bytes));
  ASSERT_EQ(frames.size(), 3u);
  EXPECT_EQ(frames[0].status.code, status_t::OK);
  EXPECT_EQ(frames[1].status.code, status_t::FAILED);
  EXPECT_EQ(frames[1].status.reason, static_cast<int>(Reason::kSourceError));
  EXPECT_EQ(frames[1].status.text, "scene2/depth.png: cannot be read");
  EXPECT_EQ(frames[1].source, "");
  EXPECT_EQ(frames[1].header.seq, 1);
  EXPECT_EQ(frames[2].header.seq, 2);
  EXPECT_EQ(runner.counters().frames_failed, 1);
  EXPECT_EQ(runner.counters().frames_out, 2);
}

TEST(Source, CutsLargeFramesIntoPartsThatAStageJoins) {
  // 0 bytes, one message exactly, one byte more, and 1280x720 raw.
  auto empty = frame(header(0), 0);
  empty.header.camera = "camera";
  const std::size_t fits = kMaxMessageBytes - static_cast<std::size_t>(empty.getEncodedSize());
  for (const std::size_t size : {std::size_t{0}, fits, fits + 1, std::size_t{1280 * 720 * 5}}) {
    const auto whole = frame(header(0), size);
    FakeSource source([&](int, Outputs& out) {
      out.at<rgbd_frame_t>("RGBD_FRAME") = whole;
      return true;
    });
    SourceRunner runner(source, {"camera", 1, {}});
    const auto answer = runner.next(0);
    ASSERT_TRUE(answer);
    EXPECT_EQ(answer->messages.size() > 1, size > fits) << size;
    auto expected = whole;
    expected.header.camera = "camera";
    auto plain = counter();
    int calls = 0;
    FakeStage stage(plain.interface(), [&](const Inputs& in, Outputs&) {
      ++calls;
      EXPECT_EQ(encode(in.get<rgbd_frame_t>("RGBD_FRAME")), encode(expected));
    });
    Runner receiver(stage, {});
    for (const auto& message : answer->messages) {
      EXPECT_LE(message.bytes.size(), kMaxMessageBytes);
      receiver.receive(message.channel, message.bytes.data(), message.bytes.size(), 0);
    }
    auto job = receiver.start(0);
    ASSERT_TRUE(job);
    job->run();
    receiver.finish(std::move(job), 0, 0);
    EXPECT_EQ(calls, 1);
  }
}

TEST(Source, FailsAFrameBeyondAllParts) {
  FakeSource source([&](int, Outputs& out) {
    auto& m = out.at<rgbd_frame_t>("RGBD_FRAME");
    m = frame(m.header, static_cast<std::size_t>(kMaxParts) * kMaxMessageBytes);
    return true;
  });
  SourceRunner runner(source, {});
  const auto answer = runner.next(9);
  ASSERT_EQ(answer->messages.size(), 1u);
  const auto m = decode<rgbd_frame_t>(answer->messages[0].bytes);
  EXPECT_EQ(m.status.code, status_t::FAILED);
  EXPECT_EQ(m.status.reason, static_cast<int>(Reason::kTooLarge));
  EXPECT_EQ(m.header.utime, 9);
}

TEST(Source, RefusesImpossibleNames) {
  FakeSource source([](int, Outputs&) { return true; });
  EXPECT_THROW(SourceRunner(source, {"", 0, {}}), Error);
  EXPECT_THROW(SourceRunner(source, {std::string(1000, 'c'), 0, {}}), Error);
  EXPECT_THROW(SourceRunner(source, {"c", 0, {{"WORDS", "X"}}}), Error);
}

}  // namespace
}  // namespace weft::stage
