#pragma once

#include <map>
#include <string>
#include <vector>

#include "tools/weft/frame_content.hpp"
#include "tools/weft/log_tools.hpp"
#include "tools/weft/message_types.hpp"
#include "tools/weft/pace.hpp"
#include "tools/weft/session.hpp"
#include "tools/weft/timing_report.hpp"

namespace weft {

struct ReplayOptions {
  std::string log;
  std::string out;           // the log to write; empty: none
  std::string log_folder;    // for what the processes write
  bool open_inputs = false;  // play whatever the stages read and none of them writes
  LogRange range;            // of the log's frames
  Pace* pace = nullptr;      // of the caller; null: as fast as the stages answer
  std::size_t frames = 0;    // 0: once over the log; more than that: the log again, as new frames
  PlayerOptions player;
};

struct ReplayResult {
  std::size_t frames = 0;
  std::size_t answered = 0;  // by every stage, on every channel
  std::size_t failed = 0;    // some stage said FAILED, DROPPED or MISSING_INPUT
  std::int64_t resends = 0;
  std::int64_t restarts = 0;
  std::vector<std::string> unanswered;       // "FRAME: channels", the first ten
  std::vector<std::string> inconsistencies;  // answers that changed on a repeat
  std::vector<std::string> damage;           // of the log that was played
  TimingReport timing;
  bool good() const { return answered == frames && inconsistencies.empty(); }
};

/// Plays the source channels of a log through a set, its sources left out, in lock-step. The log it
/// writes holds, frame by frame, the sources, the answers in pipeline order and the STAGE_TIMINGs,
/// all with the time of the frame; at its end the last STAGE_STATUS of each stage. see: called for
/// each frame, in order.
ReplayResult replay(const ProcessSet& set, Transport transport, const StageRegistry& registry,
                    const ReplayOptions& options,
                    const std::function<void(const PlayedFrame&, const FrameContent&)>& see);

/// Why two logs are not the same: names the first frame and channel whose payloads differ, with the
/// fields that differ, or that is there in one log alone. Empty when they agree on every channel
/// but STAGE_TIMING, STAGE_STATUS and LCM's own.
std::string first_difference(const std::string& log_a, const std::string& log_b,
                             const MessageTypes& types = MessageTypes::built_in());

/// "SEQ CHANNEL HASH" for each payload that first_difference would compare, in the log's order.
std::vector<std::string> payload_hashes(const std::string& log);

}  // namespace weft
