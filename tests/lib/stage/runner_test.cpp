#include "stage/runner.hpp"

#include <gtest/gtest.h>

#include <random>
#include <stdexcept>

#include "driver.hpp"
#include "fake_stage.hpp"
#include "weft/map_update_t.hpp"

namespace weft::stage {
namespace {

using namespace fake;

RunnerOptions lock_step() {
  RunnerOptions options;
  options.lock_step = true;
  return options;
}

words_t words_of(const Outgoing& out) { return decode<words_t>(out.answer->messages.at(0).bytes); }

TEST(Runner, AnswersWithTheFramesHeaderAndStatus) {
  auto stage = counter();
  Driver driver(stage, {});
  const auto out = driver.send("RGBD_FRAME", frame(header(7)));
  ASSERT_EQ(out.size(), 1u);
  EXPECT_FALSE(out[0].repeat);
  ASSERT_EQ(out[0].answer->messages.size(), 1u);
  EXPECT_EQ(out[0].answer->messages[0].channel, "WORDS");
  const auto words = words_of(out[0]);
  EXPECT_EQ(encode(words.header), encode(header(7)));
  EXPECT_EQ(words.status.code, status_t::OK);
  EXPECT_EQ(words.status.text, "");
  EXPECT_EQ(words.vocabulary_size, 10);
  EXPECT_EQ(driver.runner.counters().frames_in, 1);
  EXPECT_EQ(driver.runner.counters().frames_out, 1);
}

TEST(Runner, KeepsTheFramesNameWhateverTheStageWrites) {
  auto plain = counter();
  FakeStage stage(plain.interface(), [](const Inputs&, Outputs& out) {
    auto& words = out.at<words_t>("WORDS");
    words.header.seq = 99;
    words.header.camera = "other";
    words.header.utime = 1;
    words.header.coordinate_frame = "base";
  });
  Driver driver(stage, {});
  auto expected = header(3);
  expected.coordinate_frame = "base";
  EXPECT_EQ(encode(words_of(driver.send("RGBD_FRAME", frame(header(3))).at(0)).header),
            encode(expected));
}

TEST(Runner, MapsChannels) {
  auto stage = counter();
  RunnerOptions options;
  options.channels = {{"RGBD_FRAME", "RGBD_FRAME@left"}, {"WORDS", "WORDS@chi2fast"}};
  Driver driver(stage, options);
  EXPECT_EQ(driver.runner.channels(), std::vector<std::string>{"RGBD_FRAME@left"});
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(0))).empty());
  const auto out = driver.send("RGBD_FRAME@left", frame(header(0)));
  ASSERT_EQ(out.size(), 1u);
  EXPECT_EQ(out[0].answer->messages[0].channel, "WORDS@chi2fast");
}

TEST(Runner, RefusesAWrongMap) {
  auto stage = joiner();
  for (const ChannelMap& map :
       {ChannelMap{{"NO_SUCH", "X"}}, ChannelMap{{"FOREGROUND", "RGBD_FRAME"}},
        ChannelMap{{"WORDS", "FOREGROUND"}}, ChannelMap{{"WORDS", ""}},
        ChannelMap{{"WORDS", std::string(64, 'x')}}}) {
    RunnerOptions options;
    options.channels = map;
    EXPECT_THROW(Runner(stage, options), Error);
  }
}

TEST(Runner, JoinsByNameInAnyOrder) {
  auto stage = joiner();
  for (int order = 0; order < 2; ++order) {
    Driver driver(stage, {});
    auto fg = message<foreground_t>(header(4));
    fg.garment_px = 5;
    // Another camera, another session and another seq are other frames.
    EXPECT_TRUE(driver.send("FOREGROUND", message<foreground_t>(header(4, 2))).empty());
    EXPECT_TRUE(driver.send("FOREGROUND", message<foreground_t>(header(4, 1, "right"))).empty());
    EXPECT_TRUE(driver.send("FOREGROUND", message<foreground_t>(header(5))).empty());
    if (order == 0) {
      EXPECT_TRUE(driver.send("FOREGROUND", fg).empty());
    } else {
      EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(4))).empty());
    }
    const auto out =
        order == 0 ? driver.send("RGBD_FRAME", frame(header(4))) : driver.send("FOREGROUND", fg);
    ASSERT_EQ(out.size(), 1u);
    ASSERT_EQ(out[0].answer->messages.size(), 2u);
    EXPECT_EQ(words_of(out[0]).vocabulary_size, 15);
    EXPECT_EQ(encode(words_of(out[0]).header), encode(header(4)));
  }
}

TEST(Runner, CountsWhatDoesNotDecode) {
  auto stage = counter();
  Driver driver(stage, {});
  EXPECT_TRUE(driver.send_bytes("RGBD_FRAME", {}).empty());
  EXPECT_TRUE(driver.send_bytes("RGBD_FRAME", {1, 2, 3}).empty());
  EXPECT_TRUE(driver.send("RGBD_FRAME", message<words_t>(header(0))).empty());
  auto trailing = encode(frame(header(0)));
  trailing.push_back(0);
  EXPECT_TRUE(driver.send_bytes("RGBD_FRAME", trailing).empty());
  EXPECT_EQ(driver.runner.counters().decode_failures, 4);
  EXPECT_EQ(driver.runner.counters().frames_in, 0);
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(0))).size(), 1u);
}

TEST(Runner, CountsHeadersThatNameNoFrame) {
  auto stage = counter();
  Driver driver(stage, {});
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(-1))).empty());
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(INT64_MAX))).empty());
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(0, 1, ""))).empty());
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(0, 1, std::string(5000, 'c')))).empty());
  auto long_frame = header(0);
  long_frame.coordinate_frame = std::string(5000, 'f');
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(long_frame)).empty());
  EXPECT_EQ(driver.runner.counters().invalid_inputs, 5);
  EXPECT_EQ(driver.runner.held().streams, 0u);
}

TEST(Runner, AnswersImpossibleContentWithFailed) {
  auto stage = counter();
  Driver driver(stage, lock_step());
  int seq = 0;
  const auto expect_failed = [&](rgbd_frame_t m) {
    m.header = header(seq++);
    const auto out = driver.send("RGBD_FRAME", m);
    ASSERT_EQ(out.size(), 1u);
    EXPECT_EQ(words_of(out[0]).status.code, status_t::FAILED);
    EXPECT_EQ(words_of(out[0]).status.reason, static_cast<int>(Reason::kInvalidInput));
    EXPECT_EQ(words_of(out[0]).header.seq, m.header.seq);
  };
  auto m = frame(header(0));
  m.status.code = 77;
  expect_failed(m);
  m = frame(header(0));
  m.part_count = 0;
  expect_failed(m);
  m.part_count = INT32_MAX;
  expect_failed(m);
  m.part_count = 2;
  m.part_index = 2;
  expect_failed(m);
  m.part_index = -1;
  expect_failed(m);
  m = frame(header(0));
  m.data.resize(kMaxMessageBytes);  // what the rest takes makes it too long
  m.data_size = static_cast<std::int32_t>(m.data.size());
  expect_failed(m);
  EXPECT_EQ(driver.runner.counters().invalid_inputs, 6);
  EXPECT_EQ(driver.runner.counters().frames_failed, 6);
}

TEST(Runner, AnswersForAStageThatThrows) {
  auto plain = joiner();
  int kind = 0;
  FakeStage stage(plain.interface(), [&](const Inputs&, Outputs& out) {
    out.at<words_t>("WORDS").vocabulary_size = 1234;  // half an answer must not get out
    if (kind == 0) throw InvalidInput("no such depth encoding");
    if (kind == 1) throw std::runtime_error("broken");
    throw 42;
  });
  Driver driver(stage, {});
  for (kind = 0; kind < 3; ++kind) {
    driver.send("RGBD_FRAME", frame(header(kind)));
    const auto out = driver.send("FOREGROUND", message<foreground_t>(header(kind)));
    ASSERT_EQ(out.size(), 1u);
    ASSERT_EQ(out[0].answer->messages.size(), 2u);
    EXPECT_EQ(out[0].answer->status_code, status_t::FAILED);
    const auto words = words_of(out[0]);
    const auto grasps = decode<grasps_t>(out[0].answer->messages[1].bytes);
    EXPECT_EQ(words.status.code, status_t::FAILED);
    EXPECT_EQ(grasps.status.code, status_t::FAILED);
    EXPECT_EQ(words.vocabulary_size, 0);
    EXPECT_EQ(words.status.reason,
              static_cast<int>(kind == 0 ? Reason::kInvalidInput : Reason::kInternalError));
    EXPECT_EQ(words.status.text == "no such depth encoding", kind == 0);
  }
  EXPECT_EQ(driver.runner.counters().frames_failed, 3);
  EXPECT_EQ(driver.runner.counters().invalid_inputs, 1);
}

TEST(Runner, SaysNothingForTheStage) {
  auto plain = joiner();
  FakeStage stage(plain.interface(), [](const Inputs&, Outputs& out) {
    out.at<grasps_t>("GRASPS").status.code = status_t::FAILED;
    out.nothing(Reason::kNoGarment, "the mask is empty");
  });
  Driver driver(stage, {});
  driver.send("RGBD_FRAME", frame(header(0)));
  const auto out = driver.send("FOREGROUND", message<foreground_t>(header(0)));
  EXPECT_EQ(words_of(out.at(0)).status.code, status_t::NOTHING);
  EXPECT_EQ(words_of(out.at(0)).status.reason, static_cast<int>(Reason::kNoGarment));
  EXPECT_EQ(decode<grasps_t>(out[0].answer->messages[1].bytes).status.code, status_t::FAILED);
  EXPECT_EQ(out[0].answer->status_code, status_t::FAILED);
}

TEST(Runner, PassesOnThatAnInputFailed) {
  for (const int code : {+status_t::FAILED, +status_t::DROPPED, +status_t::MISSING_INPUT}) {
    auto stage = joiner();
    Driver driver(stage, lock_step());
    auto fg = message<foreground_t>(header(0), static_cast<std::int8_t>(code));
    fg.status.text = "why";
    EXPECT_TRUE(driver.send("FOREGROUND", fg).empty());
    const auto out = driver.send("RGBD_FRAME", frame(header(0)));
    ASSERT_EQ(out.size(), 1u);
    EXPECT_EQ(words_of(out[0]).status.code, status_t::MISSING_INPUT);
    EXPECT_EQ(words_of(out[0]).status.reason, static_cast<int>(Reason::kUpstreamFailed));
    EXPECT_NE(words_of(out[0]).status.text.find("FOREGROUND"), std::string::npos);
    EXPECT_NE(words_of(out[0]).status.text.find("why"), std::string::npos);
    EXPECT_EQ(driver.runner.counters().frames_missing_input, 1);
  }
  // NOTHING is an input like any other.
  auto stage = joiner();
  Driver driver(stage, lock_step());
  driver.send("FOREGROUND", message<foreground_t>(header(0), status_t::NOTHING));
  const auto out = driver.send("RGBD_FRAME", frame(header(0)));
  EXPECT_EQ(words_of(out.at(0)).status.code, status_t::OK);
}

TEST(Runner, FailureDoesNotDependOnTheOrderOfArrival) {
  auto stage = joiner();
  std::vector<Bytes> answers;
  for (int order = 0; order < 2; ++order) {
    Driver driver(stage, lock_step());
    auto fg = message<foreground_t>(header(0), status_t::FAILED);
    fg.status.text = "a";
    fg.header.utime = 5;  // not even this
    auto rgbd = frame(header(0));
    rgbd.status.code = status_t::DROPPED;
    rgbd.status.text = "b";
    if (order == 0) driver.send("FOREGROUND", fg);
    auto out = driver.send("RGBD_FRAME", rgbd);
    if (order == 1) out = driver.send("FOREGROUND", fg);
    answers.push_back(out.at(0).answer->messages.at(0).bytes);
  }
  EXPECT_EQ(answers[0], answers[1]);
}

TEST(Runner, RepeatsTheSameBytes) {
  auto plain = counter();
  int calls = 0;
  FakeStage stage(plain.interface(), [&](const Inputs&, Outputs& out) {
    out.at<words_t>("WORDS").vocabulary_size = ++calls;  // impure on purpose
  });
  Driver driver(stage, {});
  const auto first = driver.send("RGBD_FRAME", frame(header(0)));
  const auto again = driver.send("RGBD_FRAME", frame(header(0)));
  ASSERT_EQ(again.size(), 1u);
  EXPECT_TRUE(again[0].repeat);
  EXPECT_EQ(again[0].answer->messages[0].bytes, first.at(0).answer->messages[0].bytes);
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(driver.runner.counters().repeats, 1);
  EXPECT_EQ(driver.runner.counters().frames_in, 1);
  EXPECT_EQ(driver.runner.counters().frames_out, 1);
}

TEST(Runner, IgnoresRepeatsOfWhatIsNotYetAnswered) {
  auto stage = joiner();
  Driver driver(stage, {});
  driver.send("RGBD_FRAME", frame(header(0)));
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(0))).empty());
  driver.busy = true;
  EXPECT_TRUE(driver.send("FOREGROUND", message<foreground_t>(header(0))).empty());
  EXPECT_TRUE(driver.send("FOREGROUND", message<foreground_t>(header(0))).empty());  // queued
  auto job = driver.runner.start(driver.now);
  ASSERT_TRUE(job);
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(0))).empty());  // in process()
  EXPECT_FALSE(driver.runner.start(driver.now));
  job->run();
  driver.runner.finish(std::move(job), driver.now, 0);
  EXPECT_EQ(driver.runner.take_outgoing().size(), 1u);
  EXPECT_EQ(driver.runner.counters().repeats, 3);
  EXPECT_EQ(driver.runner.counters().frames_in, 1);
}

TEST(Runner, AnswersABurstOfRepeatsOnce) {
  auto stage = joiner();
  RunnerOptions options;
  options.repeat_delay_us = 10'000;
  Driver driver(stage, options);
  for (int i = 0; i < 3; ++i) {
    driver.send("RGBD_FRAME", frame(header(0)));
    driver.send("FOREGROUND", message<foreground_t>(header(0)));
  }
  EXPECT_EQ(driver.runner.next_wakeup(), driver.now + 10'000);
  EXPECT_TRUE(driver.wait(9'999).empty());
  const auto out = driver.wait(1);
  ASSERT_EQ(out.size(), 1u);
  EXPECT_TRUE(out[0].repeat);
  EXPECT_TRUE(driver.wait(1'000'000).empty());
  driver.send("RGBD_FRAME", frame(header(0)));
  EXPECT_EQ(driver.wait(10'000).size(), 1u);
}

TEST(Runner, ReprocessesWhatTheCacheForgot) {
  auto stage = counter();
  RunnerOptions options;
  options.max_cached = 3;
  Driver driver(stage, options);
  const auto first = driver.send("RGBD_FRAME", frame(header(0)));
  for (int seq = 1; seq < 10; ++seq) driver.send("RGBD_FRAME", frame(header(seq)));
  const auto again = driver.send("RGBD_FRAME", frame(header(0)));
  ASSERT_EQ(again.size(), 1u);
  EXPECT_EQ(again[0].answer->messages[0].bytes, first.at(0).answer->messages[0].bytes);
  EXPECT_TRUE(again[0].repeat);  // no second STAGE_TIMING
  EXPECT_EQ(driver.runner.counters().frames_in, 10);
  EXPECT_EQ(driver.runner.counters().frames_out, 10);
  EXPECT_EQ(driver.runner.counters().repeats, 1);
}

TEST(Runner, NeverContradictsAForgottenAnswer) {
  auto stage = joiner();
  RunnerOptions options;
  options.max_cached = 1;
  Driver driver(stage, options);
  for (int seq = 0; seq < 3; ++seq) {
    driver.send("RGBD_FRAME", frame(header(seq)));
    EXPECT_EQ(driver.send("FOREGROUND", message<foreground_t>(header(seq))).size(), 1u);
  }
  driver.send("RGBD_FRAME", frame(header(0)));  // one of two inputs comes again
  EXPECT_TRUE(driver.wait(10'000'000).empty());
  EXPECT_EQ(driver.runner.held().pending, 0u);
}

TEST(Runner, LiveDropsTheOldestBeyondTheQueue) {
  auto stage = counter();
  RunnerOptions options;
  options.queue_limit = 2;
  Driver driver(stage, options);
  driver.busy = true;
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(0))).empty());
  auto job = driver.runner.start(driver.now);
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(1))).empty());
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(2))).empty());
  for (int seq = 3; seq < 6; ++seq) {
    const auto out = driver.send("RGBD_FRAME", frame(header(seq)));
    ASSERT_EQ(out.size(), 1u);
    EXPECT_EQ(words_of(out[0]).header.seq, seq - 2);
    EXPECT_EQ(words_of(out[0]).status.code, status_t::DROPPED);
    EXPECT_EQ(words_of(out[0]).status.reason, static_cast<int>(Reason::kLate));
  }
  job->run();
  driver.runner.finish(std::move(job), driver.now, 0);
  const auto rest = driver.process();
  ASSERT_EQ(rest.size(), 3u);
  EXPECT_EQ(words_of(rest[0]).header.seq, 0);
  EXPECT_EQ(words_of(rest[1]).header.seq, 4);
  EXPECT_EQ(words_of(rest[2]).header.seq, 5);
  EXPECT_EQ(driver.runner.counters().frames_dropped, 3);
  // A repeat of a dropped frame is answered the same.
  driver.busy = false;
  const auto again = driver.send("RGBD_FRAME", frame(header(1)));
  EXPECT_EQ(words_of(again.at(0)).status.code, status_t::DROPPED);
}

TEST(Runner, LockStepNeverDropsNorTimesOut) {
  auto stage = joiner();
  Driver driver(stage, lock_step());
  driver.busy = true;
  for (int seq = 0; seq < 200; ++seq) {
    EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(seq))).empty());
    if (seq > 0) {
      EXPECT_TRUE(driver.send("FOREGROUND", message<foreground_t>(header(seq))).empty());
    }
  }
  driver.now += 3'600'000'000;
  driver.runner.advance(driver.now);
  EXPECT_TRUE(driver.runner.take_outgoing().empty());
  EXPECT_FALSE(driver.runner.next_wakeup());
  EXPECT_EQ(driver.process().size(), 199u);
  EXPECT_EQ(driver.send("FOREGROUND", message<foreground_t>(header(0))).size(), 0u);
  EXPECT_EQ(driver.process().size(), 1u);
}

TEST(Runner, LiveGivesUpAtTheDeadline) {
  auto stage = joiner();
  RunnerOptions options;
  options.deadline_us = 1000;
  Driver driver(stage, options);
  driver.send("FOREGROUND", message<foreground_t>(header(0)));
  EXPECT_EQ(driver.runner.next_wakeup(), driver.now + 1000);
  EXPECT_TRUE(driver.wait(999).empty());
  const auto out = driver.wait(1);
  ASSERT_EQ(out.size(), 1u);
  const auto words = words_of(out[0]);
  EXPECT_EQ(encode(words.header), encode(header(0)));
  EXPECT_EQ(words.status.code, status_t::MISSING_INPUT);
  EXPECT_EQ(words.status.reason, static_cast<int>(Reason::kDeadline));
  EXPECT_NE(words.status.text.find("RGBD_FRAME"), std::string::npos);
  // Too late: answered once and for all. Sent once more, it is a repeat.
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(0))).empty());
  const auto again = driver.send("RGBD_FRAME", frame(header(0)));
  EXPECT_EQ(again.at(0).answer->messages[0].bytes, out[0].answer->messages[0].bytes);
  EXPECT_EQ(driver.runner.counters().frames_missing_input, 1);
}

TEST(Runner, JoinsNumberedParts) {
  const auto whole = frame(header(0), 1000);
  const auto type = message_type<rgbd_frame_t>();
  const std::size_t max = static_cast<std::size_t>(whole.getEncodedSize()) - 700;
  const auto parts = type.split(&whole, max);
  ASSERT_EQ(parts.size(), 4u);
  std::vector<Bytes> bytes;
  for (const auto& part : parts) {
    bytes.push_back(type.encode(part.get()));
    EXPECT_LE(bytes.back().size(), max);
  }
  auto plain = counter();
  FakeStage stage(plain.interface(), [&](const Inputs& in, Outputs&) {
    EXPECT_EQ(encode(in.get<rgbd_frame_t>("RGBD_FRAME")), encode(whole));
  });
  std::vector<std::size_t> order{0, 1, 2, 3};
  do {
    Driver driver(stage, lock_step());
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_TRUE(driver.send_bytes("RGBD_FRAME", bytes[order[i]]).empty());
      EXPECT_TRUE(driver.send_bytes("RGBD_FRAME", bytes[order[i]]).empty());
    }
    EXPECT_EQ(driver.send_bytes("RGBD_FRAME", bytes[order[3]]).size(), 1u);
    EXPECT_EQ(driver.runner.counters().repeats, 3);
    // Sent again, all parts together get one answer.
    std::size_t answers = 0;
    for (const auto& each : bytes) answers += driver.send_bytes("RGBD_FRAME", each).size();
    EXPECT_EQ(answers, 1u);
    EXPECT_EQ(driver.runner.held().bytes, 0u);
  } while (std::next_permutation(order.begin(), order.end()));
}

TEST(Runner, LosingAPartIsLosingTheFrame) {
  auto stage = counter();
  Driver driver(stage, {});
  auto part = frame(header(0));
  part.part_count = 3;
  driver.send("RGBD_FRAME", part);
  part.part_index = 2;
  driver.send("RGBD_FRAME", part);
  const auto out = driver.wait(10'000'000);
  ASSERT_EQ(out.size(), 1u);
  EXPECT_EQ(words_of(out[0]).status.code, status_t::MISSING_INPUT);
  EXPECT_NE(words_of(out[0]).status.text.find("2 of 3 parts"), std::string::npos);
  EXPECT_EQ(driver.runner.counters().frames_missing_input, 1);
  EXPECT_EQ(driver.runner.held().bytes, 0u);
}

TEST(Runner, PartsThatDisagreeAreInvalid) {
  auto stage = counter();
  Driver driver(stage, {});
  auto part = frame(header(0));
  part.part_count = 3;
  driver.send("RGBD_FRAME", part);
  part.part_count = 4;
  part.part_index = 1;
  EXPECT_EQ(words_of(driver.send("RGBD_FRAME", part).at(0)).status.code, status_t::FAILED);
}

TEST(Runner, AnswerThatDoesNotFitFails) {
  Interface interface;
  interface.name = "large";
  interface.inputs = {port<rgbd_frame_t>("RGBD_FRAME")};
  interface.outputs = {port<words_t>("WORDS"), port<grasps_t>("GRASPS")};
  FakeStage stage(interface, [](const Inputs&, Outputs& out) {
    auto& words = out.at<words_t>("WORDS");
    words.cells.resize(100'000);
    words.cell_count = 100'000;
  });
  Driver driver(stage, {});
  const auto out = driver.send("RGBD_FRAME", frame(header(0)));
  const auto words = words_of(out.at(0));
  EXPECT_EQ(words.status.code, status_t::FAILED);
  EXPECT_EQ(words.status.reason, static_cast<int>(Reason::kTooLarge));
  EXPECT_EQ(words.cell_count, 0);
  EXPECT_EQ(decode<grasps_t>(out[0].answer->messages[1].bytes).status.code, status_t::OK);
  EXPECT_EQ(out[0].answer->status_code, status_t::FAILED);
}

/// RGBD_FRAME to MAP_UPDATE of so many bytes, a type that may travel in parts.
FakeStage large_update(std::size_t bytes) {
  Interface interface;
  interface.name = "map";
  interface.inputs = {port<rgbd_frame_t>("RGBD_FRAME")};
  interface.outputs = {port<map_update_t>("MAP_UPDATE"), port<words_t>("WORDS")};
  return {interface, [bytes](const Inputs& in, Outputs& out) {
            auto& update = out.at<map_update_t>("MAP_UPDATE");
            update.map_id = 5;
            for (std::size_t i = 0; i < bytes; ++i)
              update.data.push_back(
                  static_cast<std::uint8_t>(i * 7 + static_cast<std::size_t>(in.header().seq)));
            update.data_size = static_cast<std::int32_t>(bytes);
          }};
}

TEST(Runner, AnAnswerThatMayTravelsInParts) {
  auto stage = large_update(400'000);
  Driver driver(stage, {});
  const auto out = driver.send("RGBD_FRAME", frame(header(0)));
  ASSERT_EQ(out.size(), 1u);
  const auto& messages = out[0].answer->messages;
  ASSERT_EQ(messages.size(), 4u);  // three parts, and the other output
  EXPECT_EQ(messages[3].channel, "WORDS");
  EXPECT_EQ(out[0].answer->status_code, status_t::OK);

  // What reads it gets it whole, in whatever order and how often the parts come.
  Interface interface;
  interface.name = "reader";
  interface.inputs = {port<words_t>("WORDS"), port<map_update_t>("MAP_UPDATE")};
  interface.outputs = {port<grasps_t>("GRASPS")};
  int read = 0;
  FakeStage reader(interface, [&](const Inputs& in, Outputs&) {
    const auto& whole = in.get<map_update_t>("MAP_UPDATE");
    ASSERT_EQ(whole.data.size(), 400'000u);
    EXPECT_EQ(whole.part_count, 1);
    EXPECT_EQ(whole.map_id, 5);
    for (const std::size_t i : {0u, 159'999u, 160'001u, 399'999u})
      EXPECT_EQ(whole.data[i], static_cast<std::uint8_t>(i * 7)) << i;
    ++read;
  });
  Driver other(reader, {});
  for (const std::size_t i : {2u, 3u, 0u, 0u, 1u}) {
    EXPECT_EQ(read, 0);
    EXPECT_LE(messages[i].bytes.size(), kMaxMessageBytes);
    other.send_bytes(messages[i].channel, messages[i].bytes);
  }
  EXPECT_EQ(read, 1);

  // A repeated input gets all parts again.
  driver.send("RGBD_FRAME", frame(header(0)));
  const auto again = driver.wait(1'000'000);
  const auto repeat = again.empty() ? out : again;
  EXPECT_EQ(repeat[0].answer->messages.size(), 4u);
}

TEST(Runner, EvenPartsHaveAnEnd) {
  auto stage = large_update(kMaxMessageBytes * (kMaxParts + 1));
  Driver driver(stage, {});
  const auto out = driver.send("RGBD_FRAME", frame(header(0)));
  const auto update = decode<map_update_t>(out.at(0).answer->messages.at(0).bytes);
  EXPECT_EQ(update.status.code, status_t::FAILED);
  EXPECT_EQ(update.status.reason, static_cast<int>(Reason::kTooLarge));
  EXPECT_EQ(update.part_count, 1);
  EXPECT_EQ(out[0].answer->messages.size(), 2u);
}

TEST(Runner, CountsGapsAndTakesBackLateComers) {
  auto stage = counter();
  Driver driver(stage, {});
  const auto send = [&](std::int64_t seq, std::int64_t session) {
    driver.send("RGBD_FRAME", frame(header(seq, session)));
    return driver.runner.counters().gaps;
  };
  EXPECT_EQ(send(100, 1), 0);  // a late joiner misses nothing
  EXPECT_EQ(send(101, 1), 0);
  EXPECT_EQ(send(105, 1), 3);
  EXPECT_EQ(send(103, 1), 2);
  EXPECT_EQ(send(0, 2), 2);  // a new session starts again
  EXPECT_EQ(send(2, 2), 3);
  EXPECT_EQ(send(2, 2), 3);
}

TEST(Runner, StatefulStageSeesFramesInOrder) {
  std::vector<std::int64_t> order;
  auto stage = remembering(order);
  Driver driver(stage, {});
  driver.busy = true;
  for (const int seq : {2, 0, 1, 3}) driver.send("RGBD_FRAME", frame(header(seq)));
  EXPECT_EQ(driver.process().size(), 4u);
  EXPECT_EQ(order, (std::vector<std::int64_t>{0, 1, 2, 3}));
}

TEST(Runner, StatefulStageWaitsLiveThenSkips) {
  std::vector<std::int64_t> order;
  auto stage = remembering(order);
  RunnerOptions options;
  options.deadline_us = 1000;
  Driver driver(stage, options);
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(0))).size(), 1u);
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(2))).empty());
  EXPECT_EQ(driver.runner.next_wakeup(), driver.now + 1000);
  EXPECT_TRUE(driver.wait(500).empty());
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(1))).size(), 2u);  // it was only late
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(5))).empty());
  EXPECT_EQ(driver.wait(1000).size(), 1u);
  EXPECT_EQ(order, (std::vector<std::int64_t>{0, 1, 2, 5}));
  const auto late = driver.send("RGBD_FRAME", frame(header(4)));
  EXPECT_EQ(words_of(late.at(0)).status.code, status_t::DROPPED);
  EXPECT_EQ(order.size(), 4u);
}

TEST(Runner, StatefulStageSkipsWhatWasAnsweredWithoutIt) {
  std::vector<std::int64_t> order;
  auto stage = remembering(order);
  Driver driver(stage, lock_step());
  driver.send("RGBD_FRAME", frame(header(0)));
  auto failed = frame(header(1));
  failed.status.code = status_t::FAILED;
  driver.send("RGBD_FRAME", failed);
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(2))).size(), 1u);
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(7))).size(), 1u);  // a gap in the log
  EXPECT_EQ(order, (std::vector<std::int64_t>{0, 2, 7}));
  const auto late = driver.send("RGBD_FRAME", frame(header(5)));
  EXPECT_EQ(words_of(late.at(0)).status.code, status_t::FAILED);
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(0, 2))).size(), 1u);  // a new session
  EXPECT_EQ(order.size(), 4u);
}

TEST(Runner, StatefulStageNeverProcessesAFrameTwice) {
  std::vector<std::int64_t> order;
  auto stage = remembering(order);
  RunnerOptions options = lock_step();
  options.max_cached = 2;
  Driver driver(stage, options);
  for (int seq = 0; seq < 10; ++seq) driver.send("RGBD_FRAME", frame(header(seq)));
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(9))).size(), 1u);
  EXPECT_TRUE(driver.send("RGBD_FRAME", frame(header(3))).empty());
  EXPECT_EQ(order.size(), 10u);
}

TEST(Runner, StatefulStageLeavesAnOldSessionBehind) {
  std::vector<std::int64_t> order;
  auto stage = remembering(order);
  Driver driver(stage, {});
  driver.send("RGBD_FRAME", frame(header(0, 1)));
  driver.send("RGBD_FRAME", frame(header(0, 2)));
  const auto out = driver.send("RGBD_FRAME", frame(header(1, 1)));
  EXPECT_EQ(words_of(out.at(0)).status.code, status_t::DROPPED);
  EXPECT_EQ(driver.send("RGBD_FRAME", frame(header(1, 2))).size(), 1u);
  EXPECT_EQ(order.size(), 3u);
}

TEST(Runner, ReportsTimes) {
  auto stage = joiner();
  Driver driver(stage, {});
  driver.busy = true;
  driver.send("RGBD_FRAME", frame(header(0)));
  driver.now += 10;
  driver.send("FOREGROUND", message<foreground_t>(header(0)));
  driver.now += 100;
  auto job = driver.runner.start(driver.now);
  job->run();
  driver.runner.finish(std::move(job), driver.now + 1000, 77);
  const auto out = driver.runner.take_outgoing();
  const Answer& answer = *out.at(0).answer;
  EXPECT_EQ(answer.received_us, driver.now - 100);
  EXPECT_EQ(answer.started_us, driver.now);
  EXPECT_EQ(answer.finished_us, driver.now + 1000);
  EXPECT_EQ(answer.cpu_us, 77);
  EXPECT_EQ(answer.queue_length, 1);
}

TEST(Runner, MemoryIsBounded) {
  auto stage = joiner();
  RunnerOptions options;
  options.max_pending = 20;
  options.max_pending_bytes = 50'000;
  options.max_cached = 30;
  options.max_cached_bytes = 4'000;
  for (const bool in_lock_step : {false, true}) {
    options.lock_step = in_lock_step;
    Driver driver(stage, options);
    std::mt19937 random(7);
    std::int64_t answers = 0;
    for (int i = 0; i < 100'000; ++i) {
      driver.now += 1000;
      const auto h = header(i / 2, 1 + i / 1000, i % 7 ? "left" : "c" + std::to_string(i % 1000));
      auto rgbd = frame(h, random() % 3000);
      if (random() % 10 == 0) {
        rgbd.part_count = 3;
        rgbd.part_index = static_cast<int>(random() % 3);
      }
      for (const auto& out : driver.send("RGBD_FRAME", rgbd)) answers += !out.repeat;
      if (random() % 3)
        for (const auto& out : driver.send("FOREGROUND", message<foreground_t>(h)))
          answers += !out.repeat;
      driver.runner.advance(driver.now);
      const auto held = driver.runner.held();
      ASSERT_LE(held.pending, 20u);
      ASSERT_LE(held.bytes, 50'000u);
      ASSERT_LE(held.cached, 30u);
      ASSERT_LE(held.cached_bytes, 4'000u);
      ASSERT_LE(held.streams, 256u);
    }
    for (const auto& out : driver.wait(10'000'000)) answers += !out.repeat;
    const auto counters = driver.runner.counters();
    EXPECT_EQ(counters.frames_out + counters.frames_dropped + counters.frames_failed +
                  counters.frames_missing_input,
              answers);
    EXPECT_EQ(counters.frames_in,
              answers + static_cast<std::int64_t>(driver.runner.held().pending));
    EXPECT_GT(counters.frames_out, 10'000);
  }
}

TEST(Runner, SurvivesRandomBytes) {
  auto stage = joiner();
  Driver driver(stage, {});
  std::mt19937 random(11);
  const std::vector<Bytes> seeds{encode(frame(header(0), 300)),
                                 encode(message<foreground_t>(header(0)))};
  for (int i = 0; i < 100'000; ++i) {
    Bytes bytes = seeds[random() % 2];
    if (random() % 8 == 0) {
      bytes.resize(random() % 400);
      for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random());
    } else {
      for (unsigned flips = 1 + random() % 4; flips > 0; --flips)
        bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
      if (random() % 4 == 0) bytes.resize(random() % bytes.size());
    }
    driver.now += 100;
    driver.send_bytes(random() % 2 ? "RGBD_FRAME" : "FOREGROUND", bytes);
    driver.runner.advance(driver.now);
  }
  EXPECT_GT(driver.runner.counters().decode_failures, 1000);
  const auto h = header(0, 12345);
  driver.send("RGBD_FRAME", frame(h));
  EXPECT_EQ(driver.send("FOREGROUND", message<foreground_t>(h)).size(), 1u);
}

TEST(Runner, EveryFrameIsAnsweredOnceUnderLossDoublingAndReordering) {
  auto stage = joiner();
  RunnerOptions options;
  options.deadline_us = 50'000;
  Driver driver(stage, options);
  std::mt19937 random(3);
  std::vector<std::pair<std::string, Bytes>> messages;
  std::map<std::int64_t, int> reached;
  for (int seq = 0; seq < 2000; ++seq) {
    for (const std::string channel : {"RGBD_FRAME", "FOREGROUND"}) {
      const Bytes bytes = channel == "RGBD_FRAME" ? encode(frame(header(seq)))
                                                  : encode(message<foreground_t>(header(seq)));
      for (unsigned copies = random() % 10 < 2 ? random() % 3 : 1; copies > 0; --copies) {
        messages.emplace_back(channel, bytes);
        reached[seq] = 0;
      }
    }
  }
  for (std::size_t i = 0; i + 8 < messages.size(); ++i)
    std::swap(messages[i], messages[i + random() % 8]);
  const auto count = [&](const std::vector<Outgoing>& outgoing) {
    for (const auto& out : outgoing)
      if (!out.repeat) ++reached[out.answer->header.seq];
  };
  for (const auto& [channel, bytes] : messages) {
    driver.now += 500;
    driver.runner.advance(driver.now);
    count(driver.send_bytes(channel, bytes));
  }
  count(driver.wait(1'000'000));
  for (const auto& [seq, answers] : reached) EXPECT_EQ(answers, 1) << "frame " << seq;
}

}  // namespace
}  // namespace weft::stage
