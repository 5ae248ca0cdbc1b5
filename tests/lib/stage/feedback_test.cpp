#include <gtest/gtest.h>

#include <map>

#include "base/random.hpp"
#include "driver.hpp"
#include "fake_stage.hpp"
#include "stage/in_process.hpp"

/// Feedback edges: an input that is the message of frame n - k.
namespace weft::stage {
namespace {

using namespace fake;

constexpr std::int32_t kNone = -1;

/// RGBD_FRAME and WORDS(n - k) to FOREGROUND: a number that only the right words give.
std::int32_t tracked(std::int64_t seq, std::int32_t words) {
  return static_cast<std::int32_t>((seq * 7919 + 31 * words + 5) % 1'000'003);
}
std::int32_t mapped(std::int32_t mask) { return (mask * 17 + 3) % 999'983; }

FakeStage tracker(int frames_back, bool stateful = false) {
  Interface interface;
  interface.name = "tracker";
  interface.stateful = stateful;
  interface.inputs = {port<rgbd_frame_t>("RGBD_FRAME"),
                      feedback_port<words_t>("WORDS", frames_back)};
  interface.outputs = {port<foreground_t>("FOREGROUND")};
  return {interface, [](const Inputs& in, Outputs& out) {
            const auto* words = in.feedback<words_t>("WORDS");
            auto& mask = out.at<foreground_t>("FOREGROUND");
            mask.width = words ? static_cast<std::int32_t>(words->header.seq) : kNone;
            mask.garment_px = tracked(in.header().seq, words ? words->vocabulary_size : kNone);
          }};
}

/// FOREGROUND to WORDS.
FakeStage mapper(std::int64_t fails_at = -1) {
  Interface interface;
  interface.name = "mapper";
  interface.inputs = {port<foreground_t>("FOREGROUND")};
  interface.outputs = {port<words_t>("WORDS")};
  return {interface, [fails_at](const Inputs& in, Outputs& out) {
            if (in.header().seq == fails_at) throw Error("this frame was to fail");
            out.at<words_t>("WORDS").vocabulary_size =
                mapped(in.get<foreground_t>("FOREGROUND").garment_px);
          }};
}

RunnerOptions lock_step() {
  RunnerOptions options;
  options.lock_step = true;
  return options;
}

words_t words(const header_t& h, std::int32_t value, std::int8_t code = status_t::OK) {
  auto m = message<words_t>(h, code);
  m.vocabulary_size = value;
  return m;
}

foreground_t mask_of(const Outgoing& out) {
  return decode<foreground_t>(out.answer->messages.at(0).bytes);
}

/// The seq of the words that each answer was made with.
std::vector<std::int32_t> used(const std::vector<Outgoing>& answers) {
  std::vector<std::int32_t> seqs;
  for (const auto& each : answers) seqs.push_back(mask_of(each).width);
  return seqs;
}
using Seqs = std::vector<std::int32_t>;

TEST(Feedback, TheFirstFramesHaveNone) {
  for (const bool live : {true, false}) {
    auto stage = tracker(3);
    Driver driver(stage, live ? RunnerOptions{} : lock_step());
    for (int seq = 0; seq < 3; ++seq) {
      const auto out = driver.send("RGBD_FRAME", frame(header(seq)));
      ASSERT_EQ(used(out), Seqs{kNone});
      EXPECT_EQ(mask_of(out[0]).status.code, status_t::OK);
      EXPECT_EQ(mask_of(out[0]).header.seq, seq);
    }
  }
}

TEST(Feedback, LockStepWaitsForExactlyTheFrameBefore) {
  auto stage = tracker(2);
  Driver driver(stage, lock_step());
  EXPECT_EQ(driver.runner.channels(),
            (std::vector<std::string>{"RGBD_FRAME", "WORDS", "WORDS.none"}));
  driver.send("RGBD_FRAME", frame(header(0)));
  driver.send("RGBD_FRAME", frame(header(1)));
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(2))).empty());
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(3))).empty());
  EXPECT_TRUE(driver.wait(1'000'000'000).empty());
  EXPECT_TRUE(driver.send("WORDS", words(header(2), 9)).empty());
  EXPECT_TRUE(driver.send("WORDS", words(header(0, 2), 9)).empty());
  EXPECT_TRUE(driver.send("WORDS", words(header(0, 1, "right"), 9)).empty());
  const auto third = driver.send("WORDS", words(header(1), 11));
  ASSERT_EQ(used(third), Seqs{1});
  EXPECT_EQ(encode(mask_of(third[0]).header), encode(header(3)));
  EXPECT_EQ(mask_of(third[0]).garment_px, tracked(3, 11));
  const auto second = driver.send("WORDS", words(header(0), 10));
  ASSERT_EQ(used(second), Seqs{0});
  EXPECT_EQ(mask_of(second[0]).garment_px, tracked(2, 10));
  // Words that are there before the frame.
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(4)))), Seqs{2});
  EXPECT_EQ(driver.runner.counters().frames_in, 5);
  EXPECT_EQ(driver.runner.counters().frames_out, 5);
  EXPECT_EQ(driver.runner.counters().gaps, 0);
}

TEST(Feedback, AStatefulStageKeepsTheOrder) {
  auto stage = tracker(1, true);
  Driver driver(stage, lock_step());
  driver.send("RGBD_FRAME", frame(header(0)));
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(1))).empty());
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(2))).empty());
  EXPECT_TRUE(driver.send("WORDS", words(header(1), 2)).empty());  // 1 comes first
  EXPECT_EQ(used(driver.send("WORDS", words(header(0), 1))), (Seqs{0, 1}));
}

TEST(Feedback, LockStepGoesOnWithoutWhatFailedOrIsNotThere) {
  auto stage = tracker(1);
  Driver driver(stage, lock_step());
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(1))).empty());
  EXPECT_EQ(used(driver.send("WORDS", words(header(0), 1, status_t::FAILED))), Seqs{kNone});
  driver.send("WORDS", words(header(1), 1, status_t::MISSING_INPUT));
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(2)))), Seqs{kNone});
  driver.send("WORDS", words(header(2), 1, status_t::NOTHING));
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(3)))), Seqs{2});
  driver.send("WORDS", words(header(3), 1, 17));
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(4)))), Seqs{kNone});
  EXPECT_EQ(driver.runner.counters().invalid_inputs, 1);
  // The player's word.
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(9))).empty());
  EXPECT_TRUE(driver.send("WORDS.none", header(7)).empty());
  EXPECT_EQ(used(driver.send("WORDS.none", header(8))), Seqs{kNone});
  driver.send("WORDS.none", header(9));
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(10)))), Seqs{kNone});
  EXPECT_EQ(driver.runner.counters().frames_out, 6);
  driver.send_bytes("WORDS.none", {1, 2, 3});
  EXPECT_EQ(driver.runner.counters().decode_failures, 1);
  driver.send("WORDS.none", header(-1));
  EXPECT_EQ(driver.runner.counters().invalid_inputs, 2);
}

TEST(Feedback, LiveTakesTheNewestThatHasComeAndNeverWaits) {
  auto stage = tracker(2);
  Driver driver(stage, {});
  EXPECT_EQ(driver.runner.channels(), (std::vector<std::string>{"RGBD_FRAME", "WORDS"}));
  const auto send_frame = [&](std::int64_t seq) {
    return used(driver.send("RGBD_FRAME", frame(header(seq))));
  };
  EXPECT_EQ(send_frame(5), Seqs{kNone});
  driver.send("WORDS", words(header(2), 1));
  EXPECT_EQ(send_frame(6), Seqs{2});
  driver.send("WORDS", words(header(4), 1));
  driver.send("WORDS", words(header(6), 1));
  driver.send("WORDS", words(header(3), 1));  // late
  EXPECT_EQ(send_frame(7), Seqs{4});          // not 6: that is of frame n - 1
  EXPECT_EQ(send_frame(8), Seqs{6});
  driver.send("WORDS", words(header(7), 1, status_t::DROPPED));
  EXPECT_EQ(send_frame(9), Seqs{6});
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(9, 2)))), Seqs{kNone});
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(9, 1, "left2")))), Seqs{kNone});
  EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(9, 1, "a")))), Seqs{kNone});
  EXPECT_EQ(driver.runner.counters().frames_missing_input, 0);
}

TEST(Feedback, IsTakenWhenTheFrameStarts) {
  auto stage = tracker(1);
  Driver driver(stage, {});
  driver.busy = true;
  driver.send("RGBD_FRAME", frame(header(3)));
  driver.send("WORDS", words(header(2), 1));
  EXPECT_EQ(used(driver.process()), Seqs{2});
}

TEST(Feedback, ComesInParts) {
  Interface interface;
  interface.name = "parts";
  interface.inputs = {port<foreground_t>("FOREGROUND"), feedback_port<rgbd_frame_t>("BACK", 1)};
  interface.outputs = {port<words_t>("WORDS")};
  for (const bool live : {true, false}) {
    FakeStage stage(interface, [](const Inputs& in, Outputs& out) {
      const auto* back = in.feedback<rgbd_frame_t>("BACK");
      out.at<words_t>("WORDS").vocabulary_size = back ? back->data_size : kNone;
    });
    Driver driver(stage, live ? RunnerOptions{} : lock_step());
    const auto whole = frame(header(0), 1000);
    const auto type = message_type<rgbd_frame_t>();
    const auto parts = type.split(&whole, 400);
    ASSERT_GT(parts.size(), 2u);
    for (const auto& part : parts) {
      EXPECT_TRUE(driver.send_bytes("BACK", type.encode(part.get())).empty());
      if (part == parts.back()) break;
      if (!live) continue;
      const auto out = driver.send("FOREGROUND", message<foreground_t>(header(1)));
      EXPECT_EQ(decode<words_t>(out.at(0).answer->messages[0].bytes).vocabulary_size, kNone);
    }
    const auto out = driver.send("FOREGROUND", message<foreground_t>(header(live ? 2 : 1)));
    ASSERT_EQ(out.size(), 1u);
    EXPECT_EQ(decode<words_t>(out[0].answer->messages[0].bytes).vocabulary_size, 1000);
  }
}

TEST(Feedback, RepeatedIsNoReasonToAnswerAgain) {
  auto stage = tracker(1);
  Driver driver(stage, lock_step());
  driver.send("WORDS", words(header(0), 4));
  const auto first = driver.send("RGBD_FRAME", frame(header(1)));
  ASSERT_EQ(first.size(), 1u);
  // In a circle of stages it would go round for ever.
  EXPECT_TRUE(driver.send("WORDS", words(header(0), 4)).empty());
  EXPECT_TRUE(driver.send("WORDS", words(header(0), 99)).empty());
  EXPECT_TRUE(driver.send("WORDS.none", header(0)).empty());
  const auto again = driver.send("RGBD_FRAME", frame(header(1)));
  ASSERT_EQ(again.size(), 1u);
  EXPECT_TRUE(again[0].repeat);
  EXPECT_EQ(again[0].answer->messages[0].bytes, first[0].answer->messages[0].bytes);
}

TEST(Feedback, WhatTheCacheForgotIsNotContradicted) {
  for (const bool live : {true, false}) {
    auto stage = tracker(1);
    RunnerOptions options;
    options.lock_step = !live;
    options.max_cached = 4;
    Driver driver(stage, options);
    driver.send("WORDS", words(header(0), 100));
    const auto first = driver.send("RGBD_FRAME", frame(header(1)));
    ASSERT_EQ(used(first), Seqs{0});
    for (int seq = 1; seq < 20; ++seq) {
      driver.send("WORDS", words(header(seq), 100 + seq));
      ASSERT_EQ(used(driver.send("RGBD_FRAME", frame(header(seq + 1)))), Seqs{seq});
    }
    const auto repeated = driver.send("RGBD_FRAME", frame(header(1)));
    EXPECT_TRUE(repeated.empty());
    if (live) continue;  // its words are gone as well: another answer would contradict the first
    const auto again = driver.send("WORDS", words(header(0), 100));  // the player sends both
    ASSERT_EQ(again.size(), 1u);
    EXPECT_EQ(again[0].answer->messages[0].bytes, first[0].answer->messages[0].bytes);
  }
}

TEST(Feedback, MemoryIsBounded) {
  for (const bool live : {true, false}) {
    auto stage = tracker(1);
    RunnerOptions options;
    options.lock_step = !live;
    options.max_cached_bytes = 100'000;
    Driver driver(stage, options);
    auto large = words(header(0), 1);
    for (int seq = 0; seq < 5000; ++seq) {
      large.header.seq = seq;
      large.cell_count = seq % 3 == 0 ? 1000 : 0;
      large.cells.assign(static_cast<std::size_t>(large.cell_count), 1);
      driver.send("WORDS", large);
      driver.send("WORDS.none", header(seq * 2, 7));
    }
    const auto held = driver.runner.held();
    EXPECT_LE(held.feedback, 256u);
    EXPECT_LE(held.feedback_bytes, 100'000u);
    EXPECT_GT(held.feedback, 50u);
    EXPECT_EQ(used(driver.send("RGBD_FRAME", frame(header(5000)))), Seqs{4999});
  }
}

TEST(Feedback, WrongUseIsRefused) {
  EXPECT_THROW(feedback_port<words_t>("WORDS", 0), Error);
  EXPECT_THROW(feedback_port<words_t>("WORDS", 101), Error);
  Interface alone;
  alone.name = "alone";
  alone.inputs = {feedback_port<words_t>("WORDS", 1)};
  alone.outputs = {port<foreground_t>("FOREGROUND")};
  FakeStage nothing_begins(alone, [](const Inputs&, Outputs&) {});
  EXPECT_THROW(Runner(nothing_begins, {}), Error);
  auto stage = tracker(1);
  RunnerOptions options;
  options.channels = {{"WORDS", std::string(60, 'x')}};  // with .none it would be too long
  EXPECT_THROW(Runner(stage, options), Error);
  // Asking for what is not there is an error of the stage, and answered.
  FakeStage careless(stage.interface(),
                     [](const Inputs& in, Outputs&) { in.get<words_t>("WORDS"); });
  Driver driver(careless, {});
  const auto out = driver.send("RGBD_FRAME", frame(header(0)));
  ASSERT_EQ(out.size(), 1u);
  EXPECT_EQ(mask_of(out[0]).status.code, status_t::FAILED);
}

/// What a loop of tracker and mapper must say: by frame, the tracker's number.
std::map<std::int64_t, std::int32_t> expected(const std::vector<std::int64_t>& seqs, int back,
                                              std::int64_t fails_at) {
  std::map<std::int64_t, std::int32_t> masks;
  for (const auto seq : seqs) {
    const auto before = masks.find(seq - back);
    const bool there = before != masks.end() && seq - back != fails_at;
    masks[seq] = tracked(seq, there ? mapped(before->second) : kNone);
  }
  return masks;
}

TEST(Feedback, ALoopInOneProcessHasNoCircleToWaitIn) {
  const std::vector<std::int64_t> whole{0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
  const std::vector<std::int64_t> gaps{4, 5, 6, 9, 10, 11, 12, 15, 16, 20, 21, 22};
  for (const auto& seqs : {whole, gaps}) {
    for (const int back : {1, 2, 5}) {
      for (const bool mapper_first : {true, false}) {
        for (const std::int64_t fails_at : {-1, 6}) {
          InProcess set;
          std::map<std::int64_t, std::int32_t> masks;
          set.observe([&](const std::string& channel, const Bytes& bytes) {
            if (channel != "FOREGROUND") return;
            const auto mask = decode<foreground_t>(bytes);
            EXPECT_TRUE(masks.emplace(mask.header.seq, mask.garment_px).second);
          });
          const auto first = std::make_shared<FakeStage>(tracker(back, true));
          const auto second = std::make_shared<FakeStage>(mapper(fails_at));
          if (mapper_first) set.add(second);
          set.add(first);
          if (!mapper_first) set.add(second);
          for (const auto seq : seqs) set.inject("RGBD_FRAME", encode(frame(header(seq))));
          set.run();
          EXPECT_EQ(masks, expected(seqs, back, fails_at)) << back << " back";
          for (const auto& report : set.reports()) EXPECT_EQ(report.waiting, 0u) << report.stage;
        }
      }
    }
  }
}

TEST(Feedback, LockStepAnswersAreTheSameUnderLossDoublingAndReordering) {
  constexpr int kFrames = 60;
  std::vector<std::int64_t> seqs;
  for (int seq = 0; seq < kFrames; ++seq) seqs.push_back(seq);
  const auto right = expected(seqs, 3, -1);
  Random random(5);
  for (int round = 0; round < 20; ++round) {
    auto stage = tracker(3);
    Driver driver(stage, lock_step());
    std::map<std::int64_t, std::int32_t> masks;
    const auto take = [&](const std::vector<Outgoing>& answers) {
      for (const auto& each : answers) {
        const auto mask = mask_of(each);
        const auto [at, is_new] = masks.emplace(mask.header.seq, mask.garment_px);
        EXPECT_EQ(at->second, mask.garment_px);
      }
    };
    for (int attempt = 0; masks.size() < kFrames; ++attempt) {
      ASSERT_LT(attempt, 100'000);
      const auto seq = static_cast<std::int64_t>(random.below(kFrames));
      if (random.uniform() < 0.5) {
        take(driver.send("RGBD_FRAME", frame(header(seq))));
      } else {
        take(driver.send("WORDS", words(header(seq), mapped(right.at(seq)))));
      }
    }
    EXPECT_EQ(masks, right);
  }
}

}  // namespace
}  // namespace weft::stage
