#include "stage/runner.hpp"

#include <algorithm>
#include <iterator>
#include <limits>

#include "weft/header_t.hpp"

namespace weft::stage {
namespace {

using weft::status_t;

constexpr std::int64_t kMaxSeq = std::int64_t{1} << 53;
constexpr std::size_t kMaxStreams = 256;
constexpr std::size_t kMaxReceivedBytes = 16u << 20;
constexpr std::size_t kMaxText = 500;

std::string shorten(std::string text) {
  if (text.size() > kMaxText) text = text.substr(0, kMaxText) + "...";
  return text;
}

const char* code_name(int code) {
  switch (code) {
    case status_t::OK:
      return "OK";
    case status_t::NOTHING:
      return "NOTHING";
    case status_t::FAILED:
      return "FAILED";
    case status_t::DROPPED:
      return "DROPPED";
    case status_t::MISSING_INPUT:
      return "MISSING_INPUT";
    default:
      return "unknown";
  }
}

/// What makes a header no name of a frame; empty when it is one.
std::string header_fault(const weft::header_t& header) {
  if (header.camera.empty() || header.camera.size() > kMaxNameLength)
    return "the camera's name has " + std::to_string(header.camera.size()) +
           " characters, not 1 to " + std::to_string(kMaxNameLength);
  if (header.coordinate_frame.size() > kMaxNameLength)
    return "the coordinate frame's name has more than " + std::to_string(kMaxNameLength) +
           " characters";
  if (header.seq < 0 || header.seq > kMaxSeq)
    return "seq " + std::to_string(header.seq) + " is out of range";
  return {};
}

std::string describe(const FrameName& name) {
  return name.camera + "/" + std::to_string(name.session) + "/" + std::to_string(name.seq);
}

/// One code for the frame: FAILED if any output failed, OK if any is OK, else the first.
std::int8_t overall(const std::vector<std::int8_t>& codes) {
  for (const auto wanted : {status_t::FAILED, status_t::OK})
    if (std::find(codes.begin(), codes.end(), wanted) != codes.end()) return wanted;
  return codes.empty() ? status_t::OK : codes.front();
}

}  // namespace

void RunnerOptions::validate() const {
  const auto check = [](const char* name, std::int64_t value, std::int64_t low) {
    if (value < low)
      throw Error(std::string(name) + " is " + std::to_string(value) + " but must be at least " +
                  std::to_string(low));
  };
  check("queue_limit", queue_limit, 1);
  check("deadline_us", deadline_us, 1);
  check("repeat_delay_us", repeat_delay_us, 0);
  check("max_pending", max_pending, 1);
  check("max_cached", max_cached, 1);
}

void Counters::count_answer(std::int8_t status_code) {
  switch (status_code) {
    case status_t::FAILED:
      ++frames_failed;
      break;
    case status_t::DROPPED:
      ++frames_dropped;
      break;
    case status_t::MISSING_INPUT:
      ++frames_missing_input;
      break;
    default:
      ++frames_out;
  }
}

Runner::Runner(Stage& stage, RunnerOptions options)
    : stage_(stage), interface_(stage.interface()), options_(std::move(options)) {
  options_.validate();
  check_channels(options_.channels, interface_);
  if (interface_.inputs.empty())
    throw Error("stage " + interface_.name + " has no inputs; a source runs in a SourceHost");
  for (std::size_t i = 0; i < interface_.inputs.size(); ++i) {
    const std::string channel = wire_channel(options_.channels, interface_.inputs[i].channel);
    ports_[channel] = i;
    if (interface_.inputs[i].frames_back == 0) continue;
    feedback_[i];
    if (options_.lock_step) none_ports_[channel + kNoneSuffix] = i;
  }
  if (feedback_.size() == interface_.inputs.size())
    throw Error("stage " + interface_.name + " has feedback alone; nothing would begin a frame");
}

std::vector<std::string> Runner::channels() const {
  std::vector<std::string> names;
  for (const Port& port : interface_.inputs)
    names.push_back(wire_channel(options_.channels, port.channel));
  for (const auto& [channel, port] : none_ports_) names.push_back(channel);
  return names;
}

Runner::Stream& Runner::stream_of(const FrameName& name) {
  auto [it, is_new] = streams_.try_emplace({name.camera, name.session});
  it->second.touched = ++order_;
  if (is_new) {
    it->second.index = order_;
    if (streams_.size() > kMaxStreams) {
      const auto oldest = std::min_element(
          streams_.begin(), streams_.end(),
          [](const auto& a, const auto& b) { return a.second.touched < b.second.touched; });
      counters_.gaps += oldest->second.arrived.missing();
      streams_.erase(oldest);
    }
  }
  return it->second;
}

void Runner::receive(const std::string& channel, const std::uint8_t* data, std::size_t size,
                     std::int64_t now_us) {
  const auto found = ports_.find(channel);
  if (found == ports_.end()) {
    if (const auto none = none_ports_.find(channel); none != none_ports_.end())
      receive_none(channel, none->second, data, size, now_us);
    return;
  }
  const std::size_t port = found->second;
  const MessageType& type = interface_.inputs[port].type;
  std::shared_ptr<void> message;
  if (size <= kMaxReceivedBytes) {
    try {
      message = type.decode(data, static_cast<int>(size));
    } catch (const std::exception&) {
      // The same as bytes that do not decode: counted below.
    }
  }
  if (!message) {
    ++counters_.decode_failures;
    note(channel + ": " + std::to_string(size) + " bytes are no " + type.name +
         " of this build; compare the fingerprints in STAGE_STATUS");
    return;
  }
  const weft::header_t& header = type.header(message.get());
  if (const auto fault = header_fault(header); !fault.empty()) {
    // It names no frame, so there is nothing to answer.
    ++counters_.invalid_inputs;
    note(channel + ": " + fault);
    return;
  }

  const FrameName name{header.camera, header.session, header.seq};
  if (interface_.inputs[port].frames_back > 0) {
    receive_feedback(port, name, std::move(message), size, now_us);
    return;
  }
  const int part_count = type.part_count ? type.part_count(message.get()) : 1;
  const bool last_part = part_count <= 1 || type.part_index(message.get()) == part_count - 1;
  Stream& stream = stream_of(name);
  stream.arrived.insert(name.seq);
  if (const auto cached = cache_.find(name); cached != cache_.end()) {
    receive_repeat(cached->second, name, port, last_part, now_us);
    return;
  }
  const bool answered_before = stream.answered.contains(name.seq);
  auto pending = pending_.find(name);
  if (pending == pending_.end()) {
    const bool waiting = std::any_of(ready_.begin(), ready_.end(),
                                     [&](const auto& each) { return each.second.name == name; });
    // Computed again, a frame with live feedback could get another answer.
    const bool once = interface_.stateful || (!feedback_.empty() && !options_.lock_step);
    if (waiting || busy_ == name || (answered_before && once)) {
      ++counters_.repeats;
      return;
    }
    // No drop: the player sends again what was not answered.
    const bool full = ready_.size() >= static_cast<std::size_t>(options_.max_pending) ||
                      held_bytes_ >= options_.max_pending_bytes;
    if (options_.lock_step && full && !ready_.empty()) return;
    Frame frame;
    frame.name = name;
    frame.order = ++order_;
    frame.first_us = now_us;
    frame.slots.resize(interface_.inputs.size());
    frame.reopened = answered_before;
    ++(answered_before ? counters_.repeats : counters_.frames_in);
    pending = pending_.emplace(name, std::move(frame)).first;
  }

  Frame& frame = pending->second;
  Slot& slot = frame.slots[port];
  if (slot.complete) {
    ++counters_.repeats;
    return;
  }
  frame.last_us = now_us;
  frame.bytes += size;
  held_bytes_ += size;
  fill(name, slot, port, std::move(message), size);

  const auto newest = newest_stream_.find(name.camera);
  const bool behind = stream.position && name.seq < *stream.position;
  const bool superseded =
      !options_.lock_step && newest != newest_stream_.end() && stream.index < newest->second;
  if (interface_.stateful && (behind || superseded)) {
    const Frame late = std::move(frame);
    pending_.erase(pending);
    held_bytes_ -= late.bytes;
    const std::string text = behind ? "arrived after a later frame of its session was processed"
                                    : "arrived after a newer session of its camera had begun";
    answer_for(late, options_.lock_step ? status_t::FAILED : status_t::DROPPED, Reason::kLate, text,
               now_us);
    return;
  }
  settle(name, now_us);
  if (pending_.contains(name)) make_room(name, now_us);
}

/// What the player says about a frame that is not in its log: a header_t.
void Runner::receive_none(const std::string& channel, std::size_t port, const std::uint8_t* data,
                          std::size_t size, std::int64_t now_us) {
  weft::header_t header{};
  const bool decoded = size <= kMaxReceivedBytes &&
                       header.decode(data, 0, static_cast<int>(size)) == static_cast<int>(size);
  if (!decoded) {
    ++counters_.decode_failures;
    note(channel + ": " + std::to_string(size) + " bytes are no header_t");
  } else if (const auto fault = header_fault(header); !fault.empty()) {
    ++counters_.invalid_inputs;
    note(channel + ": " + fault);
  } else {
    receive_feedback(port, {header.camera, header.session, header.seq}, nullptr, 0, now_us);
  }
}

/// message: null for none.
void Runner::receive_feedback(std::size_t port, const FrameName& name,
                              std::shared_ptr<void> message, std::size_t size,
                              std::int64_t now_us) {
  Feedback& feedback = feedback_.at(port);
  const auto [at, is_new] = feedback.entries.try_emplace(name);
  if (at->second.slot.complete) {
    ++counters_.repeats;
    return;
  }
  if (is_new) feedback.order.push_back(name);
  at->second.bytes += size;
  feedback.bytes += size;
  if (message) {
    fill(name, at->second.slot, port, std::move(message), size);
  } else {
    at->second.slot.complete = true;
  }
  const bool complete = at->second.slot.complete;
  while (feedback.order.size() > static_cast<std::size_t>(options_.max_cached) ||
         (feedback.bytes > options_.max_cached_bytes && feedback.order.size() > 1)) {
    const auto oldest = feedback.entries.find(feedback.order.front());
    feedback.bytes -= oldest->second.bytes;
    feedback.entries.erase(oldest);
    feedback.order.pop_front();
  }
  if (!complete || !options_.lock_step) return;
  const FrameName reader{name.camera, name.session, name.seq + interface_.inputs[port].frames_back};
  if (const auto waiting = pending_.find(reader); waiting != pending_.end()) {
    waiting->second.last_us = now_us;
    settle(reader, now_us);
  }
}

/// The message that a frame gets over a feedback edge, or null for none; nullopt when a lock-step
/// frame has to wait for it.
std::optional<std::shared_ptr<void>> Runner::feedback_for(std::size_t port,
                                                          const FrameName& name) const {
  const Port& input = interface_.inputs[port];
  if (name.seq < input.frames_back) return nullptr;
  const auto usable = [&](const Slot& slot) {
    if (!slot.complete || !slot.message || !slot.invalid.empty()) return false;
    const std::int8_t code = input.type.status(slot.message.get()).code;
    return code == status_t::OK || code == status_t::NOTHING;
  };
  const FrameName wanted{name.camera, name.session, name.seq - input.frames_back};
  const auto& entries = feedback_.at(port).entries;
  if (options_.lock_step) {
    const auto found = entries.find(wanted);
    if (found == entries.end() || !found->second.slot.complete) return std::nullopt;
    const Slot& slot = found->second.slot;
    return usable(slot) ? slot.message : nullptr;
  }
  for (auto at = entries.upper_bound(wanted); at != entries.begin();) {
    --at;
    if (at->first.camera != name.camera || at->first.session != name.session) break;
    if (usable(at->second.slot)) return at->second.slot.message;
  }
  return nullptr;
}

bool Runner::has_inputs(const Frame& frame) const {
  for (std::size_t i = 0; i < frame.slots.size(); ++i)
    if (interface_.inputs[i].frames_back == 0 && !frame.slots[i].complete) return false;
  return true;
}

/// Takes a pending frame on when nothing is missing any more.
void Runner::settle(const FrameName& name, std::int64_t now_us) {
  const auto pending = pending_.find(name);
  if (!has_inputs(pending->second)) return;
  if (options_.lock_step) {
    std::map<std::size_t, std::shared_ptr<void>> messages;
    for (const auto& [port, feedback] : feedback_) {
      auto message = feedback_for(port, name);
      if (!message) return;
      messages[port] = std::move(*message);
    }
    for (auto& [port, message] : messages) pending->second.slots[port].message = std::move(message);
  }
  Frame whole = std::move(pending->second);
  pending_.erase(pending);
  complete(std::move(whole), now_us);
}

bool Runner::forgo_feedback(std::int64_t now_us) {
  const auto waiting = std::find_if(pending_.begin(), pending_.end(),
                                    [&](const auto& each) { return has_inputs(each.second); });
  if (waiting == pending_.end()) return false;
  const FrameName name = waiting->first;
  for (const auto& [port, feedback] : feedback_) {
    if (feedback_for(port, name)) continue;
    receive_feedback(port,
                     {name.camera, name.session, name.seq - interface_.inputs[port].frames_back},
                     nullptr, 0, now_us);
  }
  return true;
}

void Runner::receive_repeat(Cached& cached, const FrameName& name, std::size_t port, bool last_part,
                            std::int64_t now_us) {
  if (!cached.arrived[port]) {
    // It came after the frame was answered without it: too late, but not a repeat.
    cached.arrived[port] = last_part;
    return;
  }
  ++counters_.repeats;
  if (!last_part) return;
  if (options_.repeat_delay_us == 0) {
    outgoing_.push_back({cached.answer, true});
  } else {
    owed_.try_emplace(name, now_us + options_.repeat_delay_us);
  }
}

void Runner::fill(const FrameName& name, Slot& slot, std::size_t port,
                  std::shared_ptr<void> message, std::size_t size) {
  const Port& input = interface_.inputs[port];
  const MessageType& type = input.type;
  const auto invalid = [&](const std::string& why) {
    ++counters_.invalid_inputs;
    slot.invalid = input.channel + ": " + why;
    slot.message = message;
    slot.parts.clear();
    slot.complete = true;
    note(describe(name) + ": " + slot.invalid);
  };
  if (size > kMaxMessageBytes) {
    invalid("a message of " + std::to_string(size) + " bytes; one holds " +
            std::to_string(kMaxMessageBytes) + ", more travels in numbered parts");
    return;
  }
  const std::int8_t code = type.status(message.get()).code;
  if (code < status_t::OK || code > status_t::MISSING_INPUT) {
    invalid("status code " + std::to_string(code) + " is unknown");
    return;
  }
  const int count = type.part_count ? type.part_count(message.get()) : 1;
  const int index = type.part_index ? type.part_index(message.get()) : 0;
  if (count < 1 || count > kMaxParts || index < 0 || index >= count) {
    invalid("part " + std::to_string(index) + " of " + std::to_string(count) + " cannot be");
    return;
  }
  if (count == 1 && slot.parts.empty()) {
    slot.message = std::move(message);
    slot.complete = true;
    return;
  }
  if (slot.parts.empty()) slot.parts.resize(static_cast<std::size_t>(count));
  if (slot.parts.size() != static_cast<std::size_t>(count)) {
    invalid("a part says that there are " + std::to_string(count) + " parts, another says " +
            std::to_string(slot.parts.size()));
    return;
  }
  auto& place = slot.parts[static_cast<std::size_t>(index)];
  if (place) {
    ++counters_.repeats;
    return;
  }
  place = std::move(message);
  if (++slot.parts_have < count) return;
  slot.message = type.join(slot.parts);
  slot.parts.clear();
  slot.complete = true;
}

const weft::header_t& Runner::header_of(const Frame& frame) const {
  for (std::size_t i = 0; i < frame.slots.size(); ++i) {
    if (interface_.inputs[i].frames_back > 0) continue;  // of another frame
    const Slot& slot = frame.slots[i];
    const MessageType& type = interface_.inputs[i].type;
    if (slot.message) return type.header(slot.message.get());
    for (const auto& part : slot.parts)
      if (part) return type.header(part.get());
  }
  throw Error("a frame without a message");  // a frame begins with one
}

void Runner::complete(Frame frame, std::int64_t now_us) {
  // In the order of the ports, not of arrival: the answer depends on the inputs alone.
  for (const Slot& slot : frame.slots) {
    if (slot.invalid.empty()) continue;
    held_bytes_ -= frame.bytes;
    answer_for(frame, status_t::FAILED, Reason::kInvalidInput, slot.invalid, now_us);
    return;
  }
  for (std::size_t i = 0; i < frame.slots.size(); ++i) {
    if (interface_.inputs[i].frames_back > 0) continue;
    const status_t& status = interface_.inputs[i].type.status(frame.slots[i].message.get());
    if (status.code == status_t::OK || status.code == status_t::NOTHING) continue;
    held_bytes_ -= frame.bytes;
    answer_for(frame, status_t::MISSING_INPUT, Reason::kUpstreamFailed,
               interface_.inputs[i].channel + " is " + code_name(status.code) + ": " + status.text,
               now_us);
    return;
  }
  ready_.emplace(frame.order, std::move(frame));
  if (options_.lock_step || ready_.size() <= static_cast<std::size_t>(options_.queue_limit)) return;
  const Frame oldest = std::move(ready_.begin()->second);
  ready_.erase(ready_.begin());
  held_bytes_ -= oldest.bytes;
  answer_for(oldest, status_t::DROPPED, Reason::kLate,
             "the stage was behind: " + std::to_string(options_.queue_limit) +
                 " newer frames were waiting",
             now_us);
}

void Runner::give_up(Frame& frame, std::int64_t now_us) {
  held_bytes_ -= frame.bytes;
  std::string text;
  for (std::size_t i = 0; i < frame.slots.size(); ++i) {
    const Slot& slot = frame.slots[i];
    if (slot.complete || interface_.inputs[i].frames_back > 0) continue;
    if (!text.empty()) text += ", ";
    text += interface_.inputs[i].channel;
    if (!slot.parts.empty()) {
      text += " (" + std::to_string(slot.parts_have) + " of " + std::to_string(slot.parts.size()) +
              " parts)";
    }
  }
  answer_for(frame, status_t::MISSING_INPUT, Reason::kDeadline, "did not arrive in time: " + text,
             now_us);
}

void Runner::make_room(const FrameName& keep, std::int64_t now_us) {
  while (pending_.size() > static_cast<std::size_t>(options_.max_pending) ||
         held_bytes_ > options_.max_pending_bytes) {
    auto oldest = pending_.end();
    for (auto it = pending_.begin(); it != pending_.end(); ++it) {
      if (it->first != keep &&
          (oldest == pending_.end() || it->second.order < oldest->second.order))
        oldest = it;
    }
    if (oldest == pending_.end()) oldest = pending_.find(keep);
    if (oldest == pending_.end()) return;
    Frame frame = std::move(oldest->second);
    pending_.erase(oldest);
    note(describe(frame.name) + ": given up, too many frames wait for their inputs");
    if (options_.lock_step) {
      held_bytes_ -= frame.bytes;  // not an answer: the player sends again
      --(frame.reopened ? counters_.repeats : counters_.frames_in);
    } else {
      give_up(frame, now_us);
    }
  }
}

void Runner::advance(std::int64_t now_us) {
  for (auto it = owed_.begin(); it != owed_.end();) {
    if (it->second > now_us) {
      ++it;
      continue;
    }
    if (const auto cached = cache_.find(it->first); cached != cache_.end())
      outgoing_.push_back({cached->second.answer, true});
    it = owed_.erase(it);
  }
  if (options_.lock_step) return;
  std::vector<std::pair<std::uint64_t, FrameName>> overdue;
  for (const auto& [name, frame] : pending_)
    if (frame.first_us + options_.deadline_us <= now_us) overdue.emplace_back(frame.order, name);
  std::sort(overdue.begin(), overdue.end());
  for (const auto& [order, name] : overdue) {
    auto node = pending_.extract(name);
    give_up(node.mapped(), now_us);
  }
}

std::optional<std::int64_t> Runner::next_wakeup() const {
  auto earliest = std::numeric_limits<std::int64_t>::max();
  for (const auto& [name, due] : owed_) earliest = std::min(earliest, due);
  if (!options_.lock_step) {
    for (const auto& [name, frame] : pending_)
      earliest = std::min(earliest, frame.first_us + options_.deadline_us);
    if (interface_.stateful) {
      for (const auto& [order, frame] : ready_)
        earliest = std::min(earliest, frame.first_us + options_.deadline_us);
    }
  }
  if (earliest == std::numeric_limits<std::int64_t>::max()) return std::nullopt;
  return earliest;
}

bool Runner::may_start(const Frame& frame, std::int64_t now_us) const {
  if (!interface_.stateful) return true;
  const auto before = [&](const FrameName& other) {
    return other.camera == frame.name.camera && other.session == frame.name.session &&
           other.seq < frame.name.seq;
  };
  for (const auto& [order, other] : ready_)
    if (before(other.name)) return false;
  const auto stream = streams_.find({frame.name.camera, frame.name.session});
  const bool begun = stream != streams_.end() && stream->second.position;
  if (begun && stream->second.answered.next_absent(*stream->second.position) == frame.name.seq)
    return true;
  for (const auto& [name, other] : pending_)
    if (before(name)) return false;
  // The frames between never came. In lock-step they are missing from the log; live, they may be
  // late.
  return !begun || options_.lock_step || frame.first_us + options_.deadline_us <= now_us;
}

std::unique_ptr<Runner::Job> Runner::start(std::int64_t now_us) {
  if (busy_) return nullptr;
  const auto found = std::find_if(ready_.begin(), ready_.end(),
                                  [&](const auto& each) { return may_start(each.second, now_us); });
  if (found == ready_.end()) return nullptr;
  Frame& frame = found->second;
  std::unique_ptr<Job> job(new Job(stage_, frame.name));
  job->queue_length_ = static_cast<int>(ready_.size());
  job->header_ = header_of(frame);
  std::vector<std::pair<const Port*, std::shared_ptr<void>>> inputs;
  for (std::size_t i = 0; i < frame.slots.size(); ++i) {
    if (!options_.lock_step && interface_.inputs[i].frames_back > 0)
      frame.slots[i].message = *feedback_for(i, frame.name);
    inputs.emplace_back(&interface_.inputs[i], std::move(frame.slots[i].message));
  }
  job->inputs_ = std::make_unique<Inputs>(job->header_, std::move(inputs));
  job->outputs_ = make_outputs(job->header_, status_t::OK, Reason::kNone, "");
  job->arrived_.assign(frame.slots.size(), true);
  job->received_us_ = frame.last_us;
  job->started_us_ = now_us;
  job->reopened_ = frame.reopened;
  if (interface_.stateful) {
    Stream& stream = stream_of(frame.name);
    stream.position = frame.name.seq + 1;
    if (newest_stream_.size() > kMaxStreams) newest_stream_.clear();
    auto& newest = newest_stream_[frame.name.camera];
    newest = std::max(newest, stream.index);
  }
  busy_ = frame.name;
  held_bytes_ -= frame.bytes;
  ready_.erase(found);
  return job;
}

void Runner::Job::run() {
  Outputs outputs(outputs_);
  try {
    stage_.process(*inputs_, outputs);
    return;
  } catch (const InvalidInput& e) {
    failure_ = Reason::kInvalidInput;
    failure_text_ = e.what();
  } catch (const std::exception& e) {
    failure_ = Reason::kInternalError;
    failure_text_ = e.what();
  } catch (...) {
    failure_ = Reason::kInternalError;
    failure_text_ = "the stage threw something that is no exception";
  }
}

void Runner::finish(std::unique_ptr<Job> job, std::int64_t now_us, std::int64_t cpu_us) {
  busy_.reset();
  Answer answer;
  answer.header = job->header_;
  answer.received_us = job->received_us_;
  answer.started_us = job->started_us_;
  answer.finished_us = now_us;
  answer.cpu_us = cpu_us;
  answer.queue_length = job->queue_length_;
  auto& outputs = job->outputs_;
  if (job->failure_ != Reason::kNone) {
    if (job->failure_ == Reason::kInvalidInput) ++counters_.invalid_inputs;
    outputs = make_outputs(job->header_, status_t::FAILED, job->failure_, job->failure_text_);
    note(describe(job->name_) + ": " + job->failure_text_);
  }
  std::vector<std::int8_t> codes;
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const auto& [port, message] = outputs[i];
    weft::header_t& header = port->type.header(message.get());
    header.utime = job->header_.utime;
    header.camera = job->header_.camera;
    header.session = job->header_.session;
    header.seq = job->header_.seq;
    const std::string channel = wire_channel(options_.channels, port->channel);
    std::vector<Publication> publications;
    std::string problem;
    Reason reason = Reason::kTooLarge;
    try {
      publications.push_back({channel, port->type.encode(message.get())});
      const std::size_t size = publications.front().bytes.size();
      if (size > kMaxMessageBytes) {
        publications.clear();
        std::vector<std::shared_ptr<void>> parts;
        if (port->type.split) parts = port->type.split(message.get(), kMaxMessageBytes);
        if (parts.empty() || parts.size() > static_cast<std::size_t>(kMaxParts)) {
          problem = "the answer takes " + std::to_string(size) + " bytes; " +
                    (parts.empty() ? "a message holds " + std::to_string(kMaxMessageBytes)
                                   : std::to_string(kMaxParts) + " messages hold less");
        } else {
          for (const auto& part : parts)
            publications.push_back({channel, port->type.encode(part.get())});
        }
      }
    } catch (const std::exception& e) {
      problem = std::string("cannot encode the answer: ") + e.what();
      reason = Reason::kInternalError;
    }
    std::int8_t code = port->type.status(message.get()).code;
    if (!problem.empty()) {
      code = status_t::FAILED;
      note(describe(job->name_) + ": " + port->channel + ": " + problem);
      const auto failed = make_outputs(job->header_, code, reason, problem);
      publications = {{channel, port->type.encode(failed[i].second.get())}};
    } else if (code == status_t::FAILED) {
      note(describe(job->name_) + ": " + port->channel + ": " +
           port->type.status(message.get()).text);
    }
    codes.push_back(code);
    std::move(publications.begin(), publications.end(), std::back_inserter(answer.messages));
  }
  answer.status_code = overall(codes);
  deliver(std::move(answer), job->name_, std::move(job->arrived_), job->reopened_);
}

std::vector<std::pair<const Port*, std::shared_ptr<void>>> Runner::make_outputs(
    const weft::header_t& header, std::int8_t code, Reason reason, const std::string& text) const {
  std::vector<std::pair<const Port*, std::shared_ptr<void>>> outputs;
  for (const Port& port : interface_.outputs) {
    auto message = port.type.make();
    port.type.header(message.get()) = header;
    status_t& status = port.type.status(message.get());
    status.code = code;
    status.reason = static_cast<std::int16_t>(reason);
    status.text = shorten(text);
    outputs.emplace_back(&port, std::move(message));
  }
  return outputs;
}

void Runner::answer_for(const Frame& frame, std::int8_t code, Reason reason,
                        const std::string& text, std::int64_t now_us) {
  // What was answered once is not contradicted.
  if (frame.reopened && (code == status_t::DROPPED || reason == Reason::kDeadline)) return;
  Answer answer;
  answer.header = header_of(frame);
  answer.status_code = code;
  answer.received_us = frame.last_us;
  answer.started_us = answer.finished_us = now_us;
  answer.queue_length = static_cast<int>(ready_.size());
  for (const auto& [port, message] : make_outputs(answer.header, code, reason, text)) {
    answer.messages.push_back(
        {wire_channel(options_.channels, port->channel), port->type.encode(message.get())});
  }
  std::vector<bool> arrived;
  for (const Slot& slot : frame.slots) arrived.push_back(slot.complete);
  note(describe(frame.name) + ": " + code_name(code) + ": " + shorten(text));
  deliver(std::move(answer), frame.name, std::move(arrived), frame.reopened);
}

void Runner::deliver(Answer answer, const FrameName& name, std::vector<bool> arrived,
                     bool reopened) {
  if (!reopened) counters_.count_answer(answer.status_code);
  stream_of(name).answered.insert(name.seq);
  Cached cached;
  for (const Publication& message : answer.messages) cached.bytes += message.bytes.size();
  cached.arrived = std::move(arrived);
  cached.answer = std::make_shared<const Answer>(std::move(answer));
  outgoing_.push_back({cached.answer, reopened});
  cached_bytes_ += cached.bytes;
  cache_.emplace(name, std::move(cached));
  cache_order_.push_back(name);
  while (cache_order_.size() > static_cast<std::size_t>(options_.max_cached) ||
         (cached_bytes_ > options_.max_cached_bytes && cache_order_.size() > 1)) {
    const auto oldest = cache_.find(cache_order_.front());
    cached_bytes_ -= oldest->second.bytes;
    owed_.erase(oldest->first);
    cache_.erase(oldest);
    cache_order_.pop_front();
  }
}

std::vector<Outgoing> Runner::take_outgoing() {
  std::vector<Outgoing> out;
  out.swap(outgoing_);
  return out;
}

Counters Runner::counters() const {
  Counters counters = counters_;
  for (const auto& [key, stream] : streams_) {
    const auto missing = stream.arrived.missing();
    counters.gaps = counters.gaps > std::numeric_limits<std::int64_t>::max() - missing
                        ? std::numeric_limits<std::int64_t>::max()
                        : counters.gaps + missing;
  }
  return counters;
}

Runner::Held Runner::held() const {
  Held held{pending_.size(), ready_.size(), cache_.size(),
            streams_.size(), held_bytes_,   cached_bytes_};
  for (const auto& [port, feedback] : feedback_) {
    held.feedback += feedback.entries.size();
    held.feedback_bytes += feedback.bytes;
  }
  return held;
}

}  // namespace weft::stage
