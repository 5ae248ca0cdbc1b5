#include "tools/weft/player.hpp"

#include <algorithm>
#include <set>
#include <thread>

#include "base/error.hpp"
#include "stage/channels.hpp"
#include "tools/weft/message.hpp"
#include "weft/map_update_t.hpp"

namespace weft {
namespace {

using std::chrono::milliseconds;

/// A stage that has answered a later frame has lost this one; its answer may just be on the way.
constexpr milliseconds kOvertakenGrace{100};
constexpr milliseconds kLeastPatience{500};
/// STAGE_TIMING comes after the answers; a lost one is not worth waiting longer for.
constexpr milliseconds kTimingPatience{300};
constexpr milliseconds kPartPause{4};

bool contains(const std::vector<std::string>& list, const std::string& text) {
  return std::find(list.begin(), list.end(), text) != list.end();
}

/// Index and number of an answer's parts; of all types MAP_UPDATE's alone comes in parts.
std::pair<std::size_t, std::size_t> part_of(const std::vector<std::uint8_t>& message) {
  const auto update = decode_message<weft::map_update_t>(message);
  if (!update || update->part_count < 2 || update->part_count > stage::kMaxParts ||
      update->part_index < 0 || update->part_index >= update->part_count)
    return {0, 1};
  return {static_cast<std::size_t>(update->part_index),
          static_cast<std::size_t>(update->part_count)};
}

std::string joined(const std::vector<std::string>& list) {
  std::string text;
  for (const auto& each : list) text += (text.empty() ? "" : ", ") + each;
  return text;
}

}  // namespace

Player::Player(Bus& bus, std::vector<std::string> stages, PlayerOptions options,
               std::function<void()> idle)
    : bus_(bus), stage_names_(std::move(stages)), options_(options), idle_(std::move(idle)) {}

void Player::wait_ready() {
  const auto deadline = Clock::now() + options_.ready_timeout;
  for (;;) {
    std::vector<std::string> missing;
    for (const auto& name : stage_names_) {
      const auto status = statuses_.find(name);
      if (status == statuses_.end() || status->second.state != weft::stage_status_t::RUNNING)
        missing.push_back(name);
    }
    if (missing.empty()) break;
    if (Clock::now() > deadline)
      throw Error("not ready after " + std::to_string(options_.ready_timeout.count() / 1000) +
                  " s: " + joined(missing) + "; see the logs of these processes");
    receive(milliseconds(50));
  }
  sort_pipeline();
  slowest_.assign(pipeline_.size(), milliseconds(0));
  newest_answered_.assign(pipeline_.size(), std::nullopt);
  restarted_.clear();
}

void Player::sort_pipeline() {
  std::vector<StageChannels> left;
  std::map<std::string, std::string> writer;
  for (const auto& name : stage_names_) {
    StageChannels stage{name, {}, {}, {}};
    for (const auto& port : statuses_.at(name).fingerprints) {
      const bool output = port.direction == weft::type_fingerprint_t::OUTPUT;
      if (port.direction > weft::type_fingerprint_t::OUTPUT) {
        const int back = port.direction - weft::type_fingerprint_t::OUTPUT;
        stage.feedback[port.channel] = back;
        frames_back_ = std::max(frames_back_, back);
        continue;
      }
      (output ? stage.outputs : stage.inputs).push_back(port.channel);
      if (!output) continue;
      const auto [other, is_new] = writer.emplace(port.channel, name);
      if (!is_new)
        throw Error("stages " + other->second + " and " + name + " both write " + port.channel +
                    "; give one of them another channel with map: in the process set");
    }
    left.push_back(std::move(stage));
  }
  pipeline_.clear();
  std::set<std::string> written;
  while (!left.empty()) {
    const auto next = std::find_if(left.begin(), left.end(), [&](const StageChannels& stage) {
      return std::all_of(stage.inputs.begin(), stage.inputs.end(), [&](const std::string& input) {
        return !writer.contains(input) || written.contains(input);
      });
    });
    if (next == left.end()) {
      std::vector<std::string> circle;
      for (const auto& stage : left) circle.push_back(stage.stage);
      throw Error("these stages wait for each other's outputs: " + joined(circle) +
                  "; one of them must read what it gets as feedback, from a frame before");
    }
    written.insert(next->outputs.begin(), next->outputs.end());
    pipeline_.push_back(std::move(*next));
    left.erase(next);
  }
}

std::vector<std::string> Player::open_inputs() const {
  std::vector<std::string> open;
  for (const auto& stage : pipeline_) {
    auto inputs = stage.inputs;
    for (const auto& [channel, back] : stage.feedback) inputs.push_back(channel);
    for (const auto& input : inputs) {
      const bool written =
          std::any_of(pipeline_.begin(), pipeline_.end(),
                      [&](const StageChannels& other) { return contains(other.outputs, input); });
      if (!written && !contains(open, input)) open.push_back(input);
    }
  }
  return open;
}

void Player::play(std::size_t count, const std::function<SourceFrame(std::size_t)>& source,
                  const std::function<void(PlayedFrame&&)>& done) {
  const int window = frames_back_ > 0 ? 1 : options_.window;
  std::size_t sent = 0;
  std::vector<FrameName> order;  // of the frames in flight
  while (sent < count || !order.empty()) {
    while (sent < count && order.size() < static_cast<std::size_t>(window) &&
           (order.empty() || entry_stages_answered(flights_.at(order.back()))) &&
           (!options_.may_send || options_.may_send(sent))) {
      Flight flight;
      flight.index = sent;
      flight.source = source(sent++);
      flight.stages.resize(pipeline_.size());
      const auto name = flight.source.name;
      const auto [at, is_new] = flights_.emplace(name, std::move(flight));
      if (!is_new) throw Error("frame " + to_string(name) + " was played twice");
      order.push_back(name);
      for (const auto& stage : pipeline_) send_feedback(name, stage, false);
      send(at->second, nullptr, 0);
      update_ready(at->second);
    }
    receive(milliseconds(10));
    resend_overdue();
    while (!order.empty() && finished(flights_.at(order.front()))) {
      const auto at = flights_.find(order.front());
      order.erase(order.begin());
      Flight flight = std::move(at->second);
      flights_.erase(at);
      remember_feedback(flight);
      done(finish(std::move(flight)));
    }
  }
}

void Player::receive(milliseconds timeout) {
  if (Clock::now() - idle_called_ > milliseconds(100)) {
    idle_called_ = Clock::now();
    idle_();
  }
  // Whatever has arrived is taken before anything is judged overdue.
  for (auto message = bus_.receive(timeout); message; message = bus_.receive(milliseconds(0))) {
    if (message->channel == "STAGE_STATUS") {
      take_status(*message);
    } else if (message->channel == "STAGE_TIMING") {
      take_timing(*message);
    } else {
      take_output(std::move(*message));
    }
  }
}

void Player::take_status(const BusMessage& message) {
  auto status = decode_message<weft::stage_status_t>(message.data);
  if (!status || !contains(stage_names_, status->stage)) return;
  const auto old = statuses_.find(status->stage);
  if (old != statuses_.end() && old->second.header.session != status->header.session) {
    ++restarts_;
    if (status->state == weft::stage_status_t::RUNNING) restarted_.push_back(status->stage);
  } else if (old != statuses_.end() && old->second.state != weft::stage_status_t::RUNNING &&
             status->state == weft::stage_status_t::RUNNING) {
    restarted_.push_back(status->stage);
  }
  statuses_[status->stage] = std::move(*status);
}

void Player::take_timing(const BusMessage& message) {
  const auto timing = decode_message<weft::stage_timing_t>(message.data);
  if (!timing || !contains(stage_names_, timing->stage)) return;
  const auto flight =
      flights_.find({timing->header.camera, timing->header.session, timing->header.seq});
  if (flight != flights_.end()) flight->second.timings.emplace(timing->stage, *timing);
}

void Player::take_output(BusMessage&& message) {
  const auto stage = std::find_if(
      pipeline_.begin(), pipeline_.end(),
      [&](const StageChannels& each) { return contains(each.outputs, message.channel); });
  if (stage == pipeline_.end()) return;
  const auto header = read_frame_header(message.data);
  if (!header) return;
  const auto at = flights_.find(header->frame);
  if (at == flights_.end()) return;
  Flight& flight = at->second;
  const auto [index_of_part, part_count] = part_of(message.data);
  auto& parts = flight.outputs[message.channel];
  if (parts.empty()) parts.resize(part_count);
  auto* part = parts.size() == part_count ? &parts[index_of_part] : nullptr;
  if (part && part->empty()) {
    *part = std::move(message.data);
  } else {
    if (!part || *part != message.data)
      inconsistencies_.push_back(message.channel + " of frame " + to_string(header->frame) +
                                 " by stage " + stage->stage);
    return;
  }
  const auto index = static_cast<std::size_t>(stage - pipeline_.begin());
  auto& pending = flight.stages[index];
  pending.answered =
      std::all_of(stage->outputs.begin(), stage->outputs.end(),
                  [&](const std::string& output) { return has_output(flight, output); });
  if (pending.answered) {
    if (pending.ready && pending.attempts == 0) {
      const auto took =
          std::chrono::duration_cast<milliseconds>(Clock::now() - pending.ready_since);
      slowest_[index] = std::max(slowest_[index], took);
    }
    newest_answered_[index] = std::max(newest_answered_[index].value_or(0), flight.index);
  }
  update_ready(flight);
}

void Player::update_ready(Flight& flight) {
  const auto now = Clock::now();
  for (std::size_t i = 0; i < pipeline_.size(); ++i) {
    auto& pending = flight.stages[i];
    if (pending.ready) continue;
    pending.ready = std::all_of(
        pipeline_[i].inputs.begin(), pipeline_[i].inputs.end(), [&](const std::string& input) {
          return has_output(flight, input) ||
                 std::any_of(flight.source.events.begin(), flight.source.events.end(),
                             [&](const stage::LogEvent& event) { return event.channel == input; });
        });
    if (pending.ready) pending.since = pending.ready_since = now;
  }
  const bool complete = std::all_of(flight.stages.begin(), flight.stages.end(),
                                    [](const Pending& p) { return p.answered; });
  if (complete && !flight.complete_since) flight.complete_since = now;
}

/// The stages that read only sources take the largest messages: the next frame is sent when they
/// have taken this one, so that two never share a receiver's socket buffer.
bool Player::entry_stages_answered(const Flight& flight) const {
  for (std::size_t i = 0; i < pipeline_.size(); ++i) {
    const bool entry = std::all_of(
        pipeline_[i].inputs.begin(), pipeline_[i].inputs.end(), [&](const std::string& input) {
          return std::any_of(flight.source.events.begin(), flight.source.events.end(),
                             [&](const stage::LogEvent& event) { return event.channel == input; });
        });
    if (entry && !flight.stages[i].answered && !flight.given_up) return false;
  }
  return true;
}

milliseconds Player::patience(std::size_t stage, int attempts) const {
  const auto known = slowest_[stage] * 4;
  const auto base =
      slowest_[stage].count() == 0 ? options_.first_patience : std::max(known, kLeastPatience);
  return base * (1 << std::min(attempts, 4));
}

/// Sends the sources of a frame, or those of one channel. A frame in parts is larger than a
/// receiver's socket buffer, so the receivers get time to empty it.
void Player::send(const Flight& flight, const std::string* channel, int attempts) {
  bool first = true;
  for (const auto& event : flight.source.events) {
    if (channel && event.channel != *channel) continue;
    if (!first) std::this_thread::sleep_for(kPartPause * (attempts + 1));
    first = false;
    bus_.publish(event.channel, event.data);
  }
}

/// Before a frame's inputs: that a frame before it, which it waits for, has no message. again: and
/// the messages that there are, which the stage may have lost.
void Player::send_feedback(const FrameName& frame, const StageChannels& stage, bool again) {
  for (const auto& [channel, back] : stage.feedback) {
    if (frame.seq < back) continue;
    const auto& known = feedback_[{frame.camera, frame.session}];
    const auto at = known.find(frame.seq - back);
    bool found = false;
    for (std::size_t i = 0; at != known.end() && i < at->second.size(); ++i) {
      if (at->second[i].channel != channel) continue;
      if (found) std::this_thread::sleep_for(kPartPause);
      found = true;
      if (again) bus_.publish(channel, at->second[i].data);
    }
    if (found) continue;
    weft::header_t header{};
    header.camera = frame.camera;
    header.session = frame.session;
    header.seq = frame.seq - back;
    bus_.publish(channel + stage::kNoneSuffix, encode_message(header));
  }
}

void Player::remember_feedback(const Flight& flight) {
  if (frames_back_ == 0) return;
  const auto read_back = [&](const std::string& channel) {
    return std::any_of(pipeline_.begin(), pipeline_.end(), [&](const StageChannels& stage) {
      return stage.feedback.contains(channel);
    });
  };
  const auto& [camera, session, seq] = flight.source.name;
  auto& known = feedback_[{camera, session}];
  for (const auto& event : flight.source.events)
    if (read_back(event.channel)) known[seq].push_back({event.channel, event.data});
  for (const auto& [channel, parts] : flight.outputs)
    if (read_back(channel) && has_output(flight, channel))
      for (const auto& data : parts) known[seq].push_back({channel, data});
  known.erase(known.begin(), known.lower_bound(seq + 1 - frames_back_));
}

void Player::resend_overdue() {
  const auto now = Clock::now();
  for (auto& [name, flight] : flights_) {
    for (std::size_t i = 0; i < pipeline_.size(); ++i) {
      auto& pending = flight.stages[i];
      if (!pending.ready || pending.answered || flight.given_up) continue;
      const auto waited = std::chrono::duration_cast<milliseconds>(now - pending.since);
      const bool overtaken = pending.attempts == 0 &&
                             newest_answered_[i].value_or(0) > flight.index &&
                             waited > kOvertakenGrace;
      if (contains(restarted_, pipeline_[i].stage) || overtaken ||
          waited > patience(i, pending.attempts))
        resend(flight, i);
      if (now - pending.ready_since > options_.answer_timeout && pending.attempts > 0)
        flight.given_up = true;
    }
  }
  restarted_.clear();
}

void Player::resend(Flight& flight, std::size_t stage) {
  send_feedback(flight.source.name, pipeline_[stage], true);
  for (const auto& input : pipeline_[stage].inputs) {
    if (has_output(flight, input)) {
      bool first = true;
      for (const auto& data : flight.outputs.at(input)) {
        if (!first) std::this_thread::sleep_for(kPartPause);
        first = false;
        bus_.publish(input, data);
      }
    }
    send(flight, &input, flight.stages[stage].attempts + 1);
  }
  auto& pending = flight.stages[stage];
  pending.since = Clock::now();
  ++pending.attempts;
  ++resends_;
}

bool Player::has_output(const Flight& flight, const std::string& channel) {
  const auto found = flight.outputs.find(channel);
  return found != flight.outputs.end() &&
         std::none_of(found->second.begin(), found->second.end(),
                      [](const std::vector<std::uint8_t>& part) { return part.empty(); });
}

bool Player::finished(Flight& flight) const {
  if (flight.given_up) return true;
  if (!flight.complete_since) return false;
  return flight.timings.size() >= pipeline_.size() ||
         Clock::now() - *flight.complete_since > kTimingPatience;
}

PlayedFrame Player::finish(Flight&& flight) const {
  PlayedFrame frame;
  frame.index = flight.index;
  frame.source = std::move(flight.source);
  for (const auto& stage : pipeline_) {
    for (const auto& channel : stage.outputs) {
      if (!has_output(flight, channel)) {
        frame.unanswered.push_back(channel);
        continue;
      }
      for (auto& data : flight.outputs.at(channel))
        frame.outputs.push_back({channel, std::move(data)});
    }
    const auto timing = flight.timings.find(stage.stage);
    if (timing != flight.timings.end()) frame.timings.push_back(std::move(timing->second));
  }
  return frame;
}

}  // namespace weft
