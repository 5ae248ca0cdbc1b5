#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "stage/channels.hpp"
#include "stage/seq_set.hpp"
#include "stage/stage.hpp"

/// The stage contract (docs/stage-contract.md) as a state machine without threads, sockets or a
/// clock: messages go in, answers come out, time is an argument. Host runs it in a process over
/// LCM, InProcess runs several in one thread.
namespace weft::stage {

struct FrameName {
  std::string camera;
  std::int64_t session = 0;
  std::int64_t seq = 0;
  // clang-tidy takes the comparison with 0 that the compiler writes for a null pointer.
  auto operator<=>(const FrameName&) const = default;  // NOLINT(modernize-use-nullptr)
};

struct RunnerOptions {
  /// No drops and no deadlines: a player waits for every answer and resends what got lost.
  bool lock_step = false;
  /// Live: complete frames that may wait; one more and the oldest is DROPPED.
  int queue_limit = 4;
  /// Live: how long a frame waits for its missing inputs (or, when the stage is stateful, for the
  /// frame before it) after its first message.
  std::int64_t deadline_us = 2'000'000;
  /// Repeats of an input that come within this time get one answer together. Without it a source
  /// message sent again would be answered as often as there are paths through the set.
  std::int64_t repeat_delay_us = 0;
  /// Bounds of memory: frames that wait for inputs, bytes of waiting messages, answers kept.
  int max_pending = 256;
  std::size_t max_pending_bytes = 64u << 20;
  int max_cached = 256;
  std::size_t max_cached_bytes = 32u << 20;
  ChannelMap channels;

  void validate() const;
};

/// One message to send.
struct Publication {
  std::string channel;  // on the wire
  std::vector<std::uint8_t> bytes;
};

/// What a stage says about one frame, with the times STAGE_TIMING needs.
struct Answer {
  weft::header_t header;
  std::int8_t status_code = 0;
  std::vector<Publication> messages;  // one for each output; several when it takes parts
  std::int64_t received_us = 0;       // the frame's last input
  std::int64_t started_us = 0;
  std::int64_t finished_us = 0;
  std::int64_t cpu_us = 0;
  int queue_length = 0;
};

struct Outgoing {
  std::shared_ptr<const Answer> answer;
  bool repeat = false;  // sent before: no STAGE_TIMING
};

/// As in STAGE_STATUS.
struct Counters {
  std::int64_t frames_in = 0;
  std::int64_t frames_out = 0;  // answered OK or NOTHING
  std::int64_t frames_dropped = 0;
  std::int64_t frames_failed = 0;
  std::int64_t frames_missing_input = 0;
  std::int64_t gaps = 0;
  std::int64_t repeats = 0;
  std::int64_t decode_failures = 0;
  std::int64_t invalid_inputs = 0;
  std::string last_error;

  void count_answer(std::int8_t status_code);
};

class Runner {
 public:
  /// One frame on its way through Stage::process. run() touches nothing of the runner, so that it
  /// may be called without the lock that guards the runner.
  class Job {
   public:
    void run();

   private:
    friend class Runner;
    Job(Stage& stage, const FrameName& name) : stage_(stage), name_(name) {}
    Stage& stage_;
    FrameName name_;
    weft::header_t header_;
    std::unique_ptr<Inputs> inputs_;
    std::vector<std::pair<const Port*, std::shared_ptr<void>>> outputs_;
    std::vector<bool> arrived_;
    std::int64_t received_us_ = 0;
    std::int64_t started_us_ = 0;
    int queue_length_ = 0;
    bool reopened_ = false;
    Reason failure_ = Reason::kNone;
    std::string failure_text_;
  };

  Runner(Stage& stage, RunnerOptions options);

  /// The input channels on the wire.
  std::vector<std::string> channels() const;
  /// Takes one message; bytes may be anything. Messages of unknown channels are ignored.
  void receive(const std::string& channel, const std::uint8_t* data, std::size_t size,
               std::int64_t now_us);
  /// Live: deadlines that have passed. Also sends the repeats that are due.
  void advance(std::int64_t now_us);
  /// When advance() or start() next has something to do without a new message.
  std::optional<std::int64_t> next_wakeup() const;
  /// The next frame to process, if one is ready. Only one job at a time.
  std::unique_ptr<Job> start(std::int64_t now_us);
  void finish(std::unique_ptr<Job> job, std::int64_t now_us, std::int64_t cpu_us);
  /// Lock-step, when nobody is left to send anything: the first frame that waits for nothing but
  /// feedback goes on without it. False when there is none.
  bool forgo_feedback(std::int64_t now_us);
  /// Everything to publish since the last call, in order.
  std::vector<Outgoing> take_outgoing();

  const Interface& interface() const { return interface_; }
  Counters counters() const;

  /// What the bounds hold on to.
  struct Held {
    std::size_t pending = 0, ready = 0, cached = 0, streams = 0, bytes = 0, cached_bytes = 0;
    std::size_t feedback = 0, feedback_bytes = 0;
  };
  Held held() const;

 private:
  struct Slot {
    std::shared_ptr<void> message;
    std::vector<std::shared_ptr<void>> parts;
    int parts_have = 0;
    std::string invalid;
    bool complete = false;
  };
  struct Feedback {  // what came on a feedback port
    struct Entry {
      Slot slot;  // complete without a message: there is none
      std::size_t bytes = 0;
    };
    std::map<FrameName, Entry> entries;
    std::deque<FrameName> order;  // of arrival
    std::size_t bytes = 0;
  };
  struct Frame {
    FrameName name;
    std::uint64_t order = 0;  // of arrival
    std::int64_t first_us = 0;
    std::int64_t last_us = 0;
    std::size_t bytes = 0;
    std::vector<Slot> slots;
    bool reopened = false;  // answered before, but no longer in the cache
  };
  struct Stream {  // one session of one camera
    SeqSet arrived;
    SeqSet answered;
    std::optional<std::int64_t> position;  // stateful: the next seq to process
    std::uint64_t index = 0;
    std::uint64_t touched = 0;
  };
  struct Cached {
    std::shared_ptr<const Answer> answer;
    std::vector<bool> arrived;  // by input port
    std::size_t bytes = 0;
  };
  using StreamKey = std::pair<std::string, std::int64_t>;

  Stream& stream_of(const FrameName& name);
  void receive_repeat(Cached& cached, const FrameName& name, std::size_t port, bool last_part,
                      std::int64_t now_us);
  void receive_feedback(std::size_t port, const FrameName& name, std::shared_ptr<void> message,
                        std::size_t size, std::int64_t now_us);
  void receive_none(const std::string& channel, std::size_t port, const std::uint8_t* data,
                    std::size_t size, std::int64_t now_us);
  std::optional<std::shared_ptr<void>> feedback_for(std::size_t port, const FrameName& name) const;
  void fill(const FrameName& name, Slot& slot, std::size_t port, std::shared_ptr<void> message,
            std::size_t size);
  bool has_inputs(const Frame& frame) const;
  void settle(const FrameName& name, std::int64_t now_us);
  void complete(Frame frame, std::int64_t now_us);
  void give_up(Frame& frame, std::int64_t now_us);
  void make_room(const FrameName& keep, std::int64_t now_us);
  bool may_start(const Frame& frame, std::int64_t now_us) const;
  const weft::header_t& header_of(const Frame& frame) const;
  std::vector<std::pair<const Port*, std::shared_ptr<void>>> make_outputs(
      const weft::header_t& header, std::int8_t code, Reason reason, const std::string& text) const;
  void answer_for(const Frame& frame, std::int8_t code, Reason reason, const std::string& text,
                  std::int64_t now_us);
  void deliver(Answer answer, const FrameName& name, std::vector<bool> arrived, bool reopened);
  void note(const std::string& error) { counters_.last_error = error; }

  Stage& stage_;
  const Interface& interface_;
  const RunnerOptions options_;
  std::map<std::string, std::size_t> ports_;       // wire channel to input port
  std::map<std::string, std::size_t> none_ports_;  // the same for what says that none will come
  std::map<std::size_t, Feedback> feedback_;       // by input port
  std::map<FrameName, Frame> pending_;
  std::map<std::uint64_t, Frame> ready_;  // by order of arrival
  std::optional<FrameName> busy_;
  std::map<FrameName, Cached> cache_;
  std::deque<FrameName> cache_order_;
  std::size_t cached_bytes_ = 0;
  std::size_t held_bytes_ = 0;
  std::map<FrameName, std::int64_t> owed_;  // repeats to send, and when
  std::map<StreamKey, Stream> streams_;
  std::map<std::string, std::uint64_t> newest_stream_;  // stateful: by camera
  std::vector<Outgoing> outgoing_;
  std::uint64_t order_ = 0;
  Counters counters_;
};

}  // namespace weft::stage
