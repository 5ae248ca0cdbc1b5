#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tools/weft/bus.hpp"
#include "tools/weft/source_log.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {

struct PlayerOptions {
  int window = 4;  // frames in flight; their order and answers do not depend on it. A set with
                   // feedback edges gets one at a time
  std::chrono::milliseconds ready_timeout{60000};   // for all stages to report RUNNING
  std::chrono::milliseconds answer_timeout{60000};  // then a frame counts as unanswered
  std::chrono::milliseconds first_patience{3000};  // before sending again, while a speed is unknown
  std::function<bool(std::size_t index)>
      may_send;  // asked often before a frame is sent; empty: yes
};

/// A stage as its STAGE_STATUS describes it, channels as on the wire.
struct StageChannels {
  std::string stage;
  std::vector<std::string> inputs;  // of the same frame
  std::vector<std::string> outputs;
  std::map<std::string, int> feedback;  // inputs over feedback edges, and from how many frames back
  bool operator==(const StageChannels&) const = default;
};

/// Everything that was said about one frame.
struct PlayedFrame {
  std::size_t index = 0;
  SourceFrame source;
  std::vector<BusMessage> outputs;      // in pipeline order, the first answer on each, part by part
  std::vector<std::string> unanswered;  // channels without an answer
  std::vector<weft::stage_timing_t> timings;  // in pipeline order, at most one a stage
};

/// Feeds frames to running stages in lock-step: a few frames in flight, each sent again to a stage
/// whose answer is overdue or that was restarted. Lost messages and killed stages cost time, never
/// an answer.
class Player {
 public:
  /// stages: names of the instances that must be running. idle: called a few times a second; throws
  /// to end the replay, for example because a process does not start.
  Player(Bus& bus, std::vector<std::string> stages, PlayerOptions options,
         std::function<void()> idle);

  /// Waits until every stage has reported RUNNING. Throws Error naming those that did not.
  void wait_ready();

  /// The stages in pipeline order: each after those whose outputs it reads. After wait_ready().
  const std::vector<StageChannels>& pipeline() const { return pipeline_; }
  /// Channels that some stage reads, if only as feedback, and none writes: what a log must supply.
  std::vector<std::string> open_inputs() const;

  /// Plays `count` frames and hands each to `done`, in order. source(index) supplies them.
  void play(std::size_t count, const std::function<SourceFrame(std::size_t)>& source,
            const std::function<void(PlayedFrame&&)>& done);

  /// Newest report of each stage.
  const std::map<std::string, weft::stage_status_t>& statuses() const { return statuses_; }
  std::int64_t resends() const { return resends_; }
  std::int64_t restarts() const { return restarts_; }
  /// Answers to a repeated input that were not the first answer again: a broken contract.
  const std::vector<std::string>& inconsistencies() const { return inconsistencies_; }

 private:
  using Clock = std::chrono::steady_clock;
  struct Pending {       // one stage's work on one frame
    bool ready = false;  // all inputs are known
    bool answered = false;
    Clock::time_point since;        // of the newest sending of its inputs
    Clock::time_point ready_since;  // of the first
    int attempts = 0;
  };
  struct Flight {
    std::size_t index = 0;
    SourceFrame source;
    std::map<std::string, std::vector<std::vector<std::uint8_t>>> outputs;  // by channel and part
    std::map<std::string, weft::stage_timing_t> timings;
    std::vector<Pending> stages;  // parallel to pipeline_
    std::optional<Clock::time_point> complete_since;
    bool given_up = false;
  };

  void sort_pipeline();
  void receive(std::chrono::milliseconds timeout);
  void take_status(const BusMessage& message);
  void take_timing(const BusMessage& message);
  void take_output(BusMessage&& message);
  void update_ready(Flight& flight);
  bool entry_stages_answered(const Flight& flight) const;
  void send(const Flight& flight, const std::string* channel, int attempts);
  void send_feedback(const FrameName& frame, const StageChannels& stage, bool again);
  void remember_feedback(const Flight& flight);
  void resend_overdue();
  void resend(Flight& flight, std::size_t stage);
  static bool has_output(const Flight& flight, const std::string& channel);
  bool finished(Flight& flight) const;
  PlayedFrame finish(Flight&& flight) const;
  std::chrono::milliseconds patience(std::size_t stage, int attempts) const;

  Bus& bus_;
  std::vector<std::string> stage_names_;
  PlayerOptions options_;
  std::function<void()> idle_;
  Clock::time_point idle_called_{};
  std::vector<StageChannels> pipeline_;
  std::map<std::string, weft::stage_status_t> statuses_;
  std::vector<std::string> restarted_;  // since resend_overdue() last ran
  std::map<FrameName, Flight> flights_;
  int frames_back_ = 0;  // the most of all feedback edges
  // What finished frames have on channels that somebody reads as feedback: by session, then seq.
  std::map<std::pair<std::string, std::int64_t>, std::map<std::int64_t, std::vector<BusMessage>>>
      feedback_;
  std::vector<std::chrono::milliseconds> slowest_;  // answer of each stage so far
  std::vector<std::optional<std::size_t>> newest_answered_;
  std::int64_t resends_ = 0;
  std::int64_t restarts_ = 0;
  std::vector<std::string> inconsistencies_;
};

}  // namespace weft
