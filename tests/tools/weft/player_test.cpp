#include "tools/weft/player.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/random.hpp"
#include "integration/test_log.hpp"
#include "integration/test_stage.hpp"
#include "tools/weft/fake_bus.hpp"

namespace weft {
namespace {

FakeBus::Factory test_stage_of(const std::string& settings) {
  return [settings] { return test_stage::make_stage(Settings::from_text(settings, "test")); };
}

void add_chain(FakeBus& bus, const std::string& words = "kind: words") {
  bus.add("parts", test_stage_of("kind: parts"));  // not in pipeline order
  bus.add("words", test_stage_of(words));
  bus.add("mask", test_stage_of("kind: mask"));
}

SourceFrame source(std::size_t index) {
  const auto seq = static_cast<std::int64_t>(index);
  auto event = test_stage::test_event(seq, 500);
  return {{"camera", 7, seq}, event.timestamp_us, {event}, 0};
}

using Answers = std::vector<std::pair<std::string, std::vector<std::uint8_t>>>;

Answers play(
    Player& player, std::size_t count,
    const std::function<void(std::size_t)>& after = [](std::size_t) {}) {
  Answers answers;
  std::size_t next = 0;
  player.wait_ready();
  player.play(count, source, [&](PlayedFrame&& frame) {
    EXPECT_EQ(frame.index, next++);
    EXPECT_TRUE(frame.unanswered.empty());
    for (auto& output : frame.outputs) answers.emplace_back(output.channel, output.data);
    after(frame.index);
  });
  EXPECT_EQ(next, count);
  return answers;
}

Answers undisturbed(std::size_t count, int window) {
  FakeBus bus;
  add_chain(bus);
  PlayerOptions options;
  options.window = window;
  Player player(bus, {"mask", "words", "parts"}, options, [] {});
  auto answers = play(player, count);
  EXPECT_EQ(player.resends(), 0);
  return answers;
}

TEST(Player, OrdersThePipelineByItsChannels) {
  FakeBus bus;
  add_chain(bus);
  Player player(bus, {"parts", "mask", "words"}, {}, [] {});
  player.wait_ready();
  ASSERT_EQ(player.pipeline().size(), 3u);
  EXPECT_EQ(player.pipeline()[0].stage, "mask");
  EXPECT_EQ(player.pipeline()[1].stage, "words");
  EXPECT_EQ(player.pipeline()[2].stage, "parts");
  EXPECT_EQ(player.open_inputs(), std::vector<std::string>{"RGBD_FRAME"});
}

TEST(Player, EveryWindowGivesTheSameAnswersInTheSameOrder) {
  const auto one = undisturbed(30, 1);
  ASSERT_EQ(one.size(), 30u * 4);
  EXPECT_EQ(one[0].first, "FOREGROUND");
  EXPECT_EQ(one[1].first, "WORDS_SIFT");
  EXPECT_EQ(one[2].first, "PROBABILITY_MAP");
  EXPECT_EQ(one[3].first, "PART_DETECTIONS");
  EXPECT_EQ(one, undisturbed(30, 4));
  EXPECT_EQ(one, undisturbed(30, 16));
}

TEST(Player, LostAndDoubledMessagesCostTimeAndNoAnswer) {
  FakeBus bus;
  add_chain(bus);
  Random random(3);
  int lost = 0;
  bus.fate = [&](const std::string&, const std::string& channel) {
    if (channel == "STAGE_STATUS") return 1;
    const double roll = random.uniform();
    lost += roll < 0.05;
    return roll < 0.05 ? 0 : roll < 0.15 ? 2 : 1;
  };
  PlayerOptions options;
  options.first_patience = std::chrono::milliseconds(50);
  Player player(bus, {"mask", "words", "parts"}, options, [] {});
  EXPECT_EQ(play(player, 40), undisturbed(40, 4));
  EXPECT_GT(lost, 10);
  EXPECT_GT(player.resends(), 0);
  EXPECT_TRUE(player.inconsistencies().empty());
}

TEST(Player, ARestartedStageGetsTheFramesInFlightAgain) {
  for (const std::string name : {"mask", "words", "parts"}) {
    FakeBus bus;
    add_chain(bus);
    Player player(bus, {"mask", "words", "parts"}, {}, [] {});
    const auto answers = play(player, 20, [&](std::size_t index) {
      if (index == 7) bus.restart(name);
    });
    EXPECT_EQ(answers, undisturbed(20, 4)) << name;
    EXPECT_EQ(player.restarts(), 1) << name;
  }
}

/// track reads the words of two frames before, which depend on its own answer to that frame.
void add_loop(FakeBus& bus) {
  bus.add("words", test_stage_of("kind: words"));
  bus.add("track", test_stage_of("{kind: track, frames_back: 2}"));
}

TEST(Player, StagesMayReadEachOtherOverAFeedbackEdge) {
  FakeBus bus;
  add_loop(bus);
  Player player(bus, {"words", "track"}, {}, [] {});
  const auto answers = play(player, 30);
  ASSERT_EQ(answers.size(), 60u);
  EXPECT_EQ(answers[0].first, "FOREGROUND");
  EXPECT_EQ(player.pipeline()[0].stage, "track");
  EXPECT_EQ(player.pipeline()[0].feedback, (std::map<std::string, int>{{"WORDS_SIFT", 2}}));
  EXPECT_EQ(player.open_inputs(), std::vector<std::string>{"RGBD_FRAME"});
  EXPECT_EQ(player.resends(), 0);

  // The same with messages lost and doubled, and with stages that forget everything.
  Random random(4);
  FakeBus bad;
  add_loop(bad);
  bad.fate = [&](const std::string&, const std::string& channel) {
    const double roll = channel == "STAGE_STATUS" ? 1.0 : random.uniform();
    return roll < 0.05 ? 0 : roll < 0.15 ? 2 : 1;
  };
  PlayerOptions options;
  options.first_patience = std::chrono::milliseconds(50);
  Player other(bad, {"words", "track"}, options, [] {});
  EXPECT_EQ(play(other, 30,
                 [&](std::size_t index) {
                   if (index % 7 == 5) bad.restart(index % 2 ? "track" : "words");
                 }),
            answers);
  EXPECT_GT(other.resends(), 0);
  EXPECT_EQ(other.restarts(), 4);
  EXPECT_TRUE(other.inconsistencies().empty());
}

TEST(Player, FramesWhoseFeedbackIsNotInTheLogGoWithoutIt) {
  FakeBus bus;
  add_loop(bus);
  Player player(bus, {"words", "track"}, {}, [] {});
  player.wait_ready();
  std::size_t played = 0;
  player.play(
      6, [](std::size_t index) { return source(index < 3 ? 10 + index : 20 + index); },
      [&](PlayedFrame&& frame) {
        EXPECT_TRUE(frame.unanswered.empty()) << frame.index;
        ++played;
      });
  EXPECT_EQ(played, 6u);
  EXPECT_EQ(player.resends(), 0);
}

TEST(Player, AFeedbackChannelThatNobodyWritesMustComeFromTheLog) {
  FakeBus bus;
  bus.add("track", test_stage_of("kind: track"));
  Player player(bus, {"track"}, {}, [] {});
  player.wait_ready();
  EXPECT_EQ(player.open_inputs(), (std::vector<std::string>{"RGBD_FRAME", "WORDS_SIFT"}));
}

TEST(Player, AnAnswerThatChangesOnARepeatIsReported) {
  FakeBus bus;
  add_chain(bus);
  bus.fate = [](const std::string& receiver, const std::string& channel) {
    return receiver == "player" && channel == "FOREGROUND" ? 2 : 1;
  };
  bus.alter = [](const std::string& channel, int copy, std::vector<std::uint8_t>& data) {
    if (channel == "FOREGROUND" && copy == 1) data.back() ^= 1;
  };
  Player player(bus, {"mask", "words", "parts"}, {}, [] {});
  EXPECT_EQ(play(player, 3), undisturbed(3, 4));
  ASSERT_EQ(player.inconsistencies().size(), 3u);
  EXPECT_EQ(player.inconsistencies()[0], "FOREGROUND of frame camera/7/0 by stage mask");
}

TEST(Player, AStageThatNeverAnswersLeavesItsChannelsUnanswered) {
  FakeBus bus;
  add_chain(bus);
  bus.fate = [](const std::string& receiver, const std::string& channel) {
    return receiver == "parts" && channel == "WORDS_SIFT" ? 0 : 1;
  };
  PlayerOptions options;
  options.answer_timeout = std::chrono::milliseconds(200);
  options.first_patience = std::chrono::milliseconds(50);
  Player player(bus, {"mask", "words", "parts"}, options, [] {});
  player.wait_ready();
  std::vector<std::string> unanswered;
  player.play(1, source, [&](PlayedFrame&& frame) {
    unanswered = frame.unanswered;
    EXPECT_EQ(frame.outputs.size(), 2u);
  });
  EXPECT_EQ(unanswered, (std::vector<std::string>{"PROBABILITY_MAP", "PART_DETECTIONS"}));
}

TEST(Player, StagesThatDoNotStartAreNamed) {
  FakeBus bus;
  bus.add("mask", test_stage_of("kind: mask"));
  PlayerOptions options;
  options.ready_timeout = std::chrono::milliseconds(50);
  Player player(bus, {"mask", "words"}, options, [] {});
  try {
    player.wait_ready();
    FAIL();
  } catch (const Error& e) {
    EXPECT_NE(std::string(e.what()).find(": words;"), std::string::npos) << e.what();
  }
}

TEST(Player, TwoWritersOfAChannelAreAnError) {
  FakeBus bus;
  bus.add("mask", test_stage_of("kind: mask"));
  bus.add("other", test_stage_of("kind: mask"));
  Player player(bus, {"mask", "other"}, {}, [] {});
  EXPECT_THROW(player.wait_ready(), Error);
}

}  // namespace
}  // namespace weft
