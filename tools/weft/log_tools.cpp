#include "tools/weft/log_tools.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <regex>
#include <set>
#include <unordered_map>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "stage/lcm_url.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/log_out.hpp"
#include "tools/weft/progress.hpp"

namespace weft {
namespace {

using stage::LogEvent;
using stage::LogReader;

/// Shown for logs that take a while.
class ReadProgress {
 public:
  explicit ReadProgress(std::int64_t bytes) {
    if (bytes > 256'000'000) progress_.emplace("MB", static_cast<long>(bytes / 1'000'000));
  }
  void update(std::int64_t bytes) {
    if (progress_) progress_->update(static_cast<long>(bytes / 1'000'000));
  }

 private:
  std::optional<Progress> progress_;
};

/// Reads all events; each(event, offset).
template <class Each>
void read_all(LogReader& log, const Each& each) {
  ReadProgress progress(log.size());
  LogEvent event;
  for (auto offset = log.offset();; offset = log.offset()) {
    const auto damages = log.damage_count();
    if (!log.next(event)) break;
    if (log.damage_count() > damages) {  // the event stands after what was skipped
      offset = log.offset() - 28 - static_cast<std::int64_t>(event.channel.size()) -
               static_cast<std::int64_t>(event.data.size());
    }
    each(event, offset);
    progress.update(log.offset());
  }
}

std::vector<std::regex> expressions(const std::vector<std::string>& texts) {
  std::vector<std::regex> out;
  for (const auto& text : texts) {
    try {
      out.emplace_back(text);
    } catch (const std::regex_error& e) {
      throw Error("'" + text + "' is not a regular expression: " + e.what());
    }
  }
  return out;
}

bool any_matches(const std::vector<std::regex>& list, const std::string& channel) {
  return std::any_of(list.begin(), list.end(),
                     [&](const std::regex& each) { return std::regex_match(channel, each); });
}

}  // namespace

std::string EventJudge::fault(const LogEvent& event) {
  auto& known = type_of_channel_[event.channel];
  switch (types_.check(event.data)) {
    case MessageTypes::Verdict::kWhole:
      if (known.empty()) known = types_.type_of(event.data);
      return "";
    case MessageTypes::Verdict::kDamaged:
      return "a message on " + event.channel + " is no whole " + types_.type_of(event.data);
    case MessageTypes::Verdict::kUnknown:
      if (!known.empty())
        return "a message on " + event.channel + ", a channel of " + known +
               ", is of no known type";
      return event.followed
                 ? ""
                 : "a message on " + event.channel +
                       " of an unknown type, whose length does not lead to another event";
  }
  return "";
}

LogSurvey survey_log(const std::string& file, const MessageTypes& types) {
  LogSurvey survey;
  LogReader log(file);
  survey.bytes = log.size();
  EventJudge judge(types);
  std::map<std::pair<std::string, std::pair<std::string, std::int64_t>>, stage::SeqSet> seen;
  std::int64_t last_time = std::numeric_limits<std::int64_t>::min();
  std::optional<std::int64_t> last_number;
  read_all(log, [&](const LogEvent& event, std::int64_t offset) {
    auto fault = judge.fault(event);
    if (!fault.empty() && log.look_inside()) return;  // which is damage of the log, then
    ++survey.events;
    survey.first_us = std::min(survey.first_us, event.timestamp_us);
    survey.last_us = std::max(survey.last_us, event.timestamp_us);
    survey.backward_steps += event.timestamp_us < last_time;
    last_time = event.timestamp_us;
    survey.number_jumps += last_number && event.number != *last_number + 1;
    last_number = event.number;
    auto& channel = survey.channels[event.channel];
    if (channel.messages++ == 0) channel.type = types.type_of(event.data);
    channel.bytes += static_cast<std::int64_t>(event.data.size());
    channel.largest = std::max(channel.largest, static_cast<std::int64_t>(event.data.size()));
    if (!fault.empty()) {
      ++survey.faulty_events;
      if (survey.problems.size() < LogReader::kMaxDamages)
        survey.problems.push_back({offset, log.offset() - offset, std::move(fault)});
      return;
    }
    if (event.channel == stage::kTimingChannel || event.channel == stage::kStatusChannel) return;
    const auto header = read_frame_header(event.data);
    if (!header) return;
    channel.not_ok += header->status_code != 0;
    const auto& [camera, session, seq] = header->frame;
    if (seq < 0) return;
    auto& seqs = seen[{event.channel, {camera, session}}];
    channel.frames += !seqs.contains(seq);
    seqs.insert(seq);
    const auto at = survey.sessions.try_emplace({camera, session}, seq, seq).first;
    at->second.first = std::min(at->second.first, seq);
    at->second.second = std::max(at->second.second, seq);
  });
  for (const auto& [key, seqs] : seen) survey.channels[key.first].missing += seqs.missing();
  survey.skipped_bytes = log.damaged_bytes();
  survey.problem_count = survey.faulty_events + log.damage_count();
  for (const auto& damage : log.damage())
    survey.problems.push_back({damage.offset, damage.bytes, damage.what});
  std::sort(survey.problems.begin(), survey.problems.end(),
            [](const auto& a, const auto& b) { return a.offset < b.offset; });
  survey.problems.resize(std::min(survey.problems.size(), LogReader::kMaxDamages));
  return survey;
}

CopyCounts repair_log(const std::string& file, const std::string& out, const MessageTypes& types) {
  LogReader log(file);
  LogOut to(out, {file});
  EventJudge judge(types);
  CopyCounts counts;
  read_all(log, [&](const LogEvent& event, std::int64_t) {
    const bool faulty = !judge.fault(event).empty();
    if (faulty && log.look_inside()) return;
    ++counts.read;
    if (!faulty) {
      to.write(event.timestamp_us, event.channel, event.data);
    } else {
      ++counts.left_out_faulty;
    }
  });
  counts.written = to.events();
  counts.damage = log.damage();
  to.commit();
  return counts;
}

CopyCounts filter_log(const std::string& file, const std::string& out, const LogFilter& filter) {
  const auto wanted = expressions(filter.channels), without = expressions(filter.without);
  LogReader log(file);
  LogOut to(out, {file});
  CopyCounts counts;
  const std::string robot = filter.robot.empty() ? "" : filter.robot + "/";
  const std::string as_robot = filter.as_robot.empty() ? "" : filter.as_robot + "/";
  for (const auto& prefix : {filter.robot, filter.as_robot}) {
    if (const auto fault = stage::prefix_fault(prefix); !prefix.empty() && !fault.empty())
      throw Error(fault);
  }
  std::unordered_map<std::string, std::string> decided;  // the name it gets; empty: left out
  read_all(log, [&](const LogEvent& event, std::int64_t) {
    ++counts.read;
    const auto [at, is_new] = decided.emplace(event.channel, "");
    if (is_new && event.channel.starts_with(robot)) {
      const auto name = event.channel.substr(robot.size());
      if ((wanted.empty() || any_matches(wanted, name)) && !any_matches(without, name))
        at->second = as_robot + name;
    }
    if (at->second.empty()) return;
    if (!filter.camera.empty()) {
      const auto frame = read_frame_name(event.data);
      if (frame && frame->camera != filter.camera) return;
    }
    to.write(event.timestamp_us, at->second, event.data);
  });
  counts.written = to.events();
  counts.damage = log.damage();
  if (counts.written == 0) throw Error(file + ": none of its events passes the filter");
  to.commit();
  return counts;
}

bool LogRange::holds_time(std::int64_t since_first_us) const {
  const double s = static_cast<double>(since_first_us) * 1e-6;
  return (!from_s || s >= *from_s) && (!to_s || s < *to_s);
}

bool LogRange::holds_frame(std::int64_t seq) const {
  return (!from_frame || seq >= *from_frame) && (!to_frame || seq <= *to_frame);
}

CopyCounts cut_log(const std::string& file, const std::string& out, const LogRange& range) {
  LogReader log(file);
  std::int64_t first = std::numeric_limits<std::int64_t>::max();
  std::int64_t frames_first = first, frames_last = std::numeric_limits<std::int64_t>::min();
  // The event counts as of the frame it is about, if it is about one.
  const auto in_range = [&](const LogEvent& event, std::int64_t start) {
    const auto frame = range.has_frames() ? read_frame_name(event.data) : std::nullopt;
    if (frame && !range.holds_frame(frame->seq)) return false;
    if (range.has_frames() && !frame &&
        (event.timestamp_us < frames_first || event.timestamp_us > frames_last))
      return false;
    return range.holds_time(event.timestamp_us - start);
  };
  read_all(log, [&](const LogEvent& event, std::int64_t) {
    first = std::min(first, event.timestamp_us);
    if (!range.has_frames()) return;
    const auto frame = read_frame_name(event.data);
    if (!frame || !range.holds_frame(frame->seq)) return;
    frames_first = std::min(frames_first, event.timestamp_us);
    frames_last = std::max(frames_last, event.timestamp_us);
  });
  CopyCounts counts;
  LogOut to(out, {file});
  log.rewind();
  read_all(log, [&](const LogEvent& event, std::int64_t) {
    ++counts.read;
    if (in_range(event, first)) to.write(event.timestamp_us, event.channel, event.data);
  });
  counts.written = to.events();
  counts.damage = log.damage();
  if (counts.written == 0) throw Error(file + ": nothing lies in this range; see weft log info");
  to.commit();
  return counts;
}

CopyCounts splice_logs(const std::vector<std::string>& files, const std::string& out) {
  // A message about a frame is like no other. Others may well be the same twice, soon after.
  constexpr std::int64_t kApart_us = 2'000'000, kApartNoFrame_us = 50'000;
  constexpr std::size_t kMostRecent = 100'000;
  struct Input {
    std::unique_ptr<LogReader> log;
    LogEvent event;
    bool more = false;
  };
  std::vector<Input> inputs(files.size());
  std::int64_t bytes = 0, done = 0;
  for (std::size_t i = 0; i < files.size(); ++i) {
    inputs[i].log = std::make_unique<LogReader>(files[i]);
    inputs[i].more = inputs[i].log->next(inputs[i].event);
    bytes += inputs[i].log->size();
  }
  struct Written {
    std::int64_t time_us;
    std::vector<bool> held_by;  // inputs that have this event
  };
  std::unordered_map<std::uint64_t, std::vector<Written>> written;  // oldest first
  std::deque<std::pair<std::int64_t, std::uint64_t>> recent;        // time, hash of all in written
  CopyCounts counts;
  LogOut to(out, files);
  ReadProgress progress(bytes);
  for (;;) {
    Input* next = nullptr;
    for (auto& input : inputs) {
      if (input.more && (!next || input.event.timestamp_us < next->event.timestamp_us))
        next = &input;
    }
    if (!next) break;
    const auto& event = next->event;
    const auto from = static_cast<std::size_t>(next - inputs.data());
    ++counts.read;
    while (!recent.empty() &&
           (recent.front().first < event.timestamp_us - kApart_us || recent.size() > kMostRecent)) {
      auto& same = written[recent.front().second];
      same.erase(same.begin());
      if (same.empty()) written.erase(recent.front().second);
      recent.pop_front();
    }
    Hash64 hash;
    hash.add(event.channel);
    hash.add(event.data.data(), event.data.size());
    const auto apart_us = read_frame_name(event.data) ? kApart_us : kApartNoFrame_us;
    auto& same = written[hash.value()];
    const auto original = std::find_if(same.rbegin(), same.rend(), [&](const Written& each) {
      return !each.held_by[from] && each.time_us >= event.timestamp_us - apart_us;
    });
    if (original != same.rend()) {
      original->held_by[from] = true;
      ++counts.copies;
    } else {
      to.write(event.timestamp_us, event.channel, event.data);
      same.push_back({event.timestamp_us, std::vector<bool>(inputs.size())});
      same.back().held_by[from] = true;
      recent.emplace_back(event.timestamp_us, hash.value());
    }
    done += 28 + static_cast<std::int64_t>(event.channel.size() + event.data.size());
    progress.update(done);
    next->more = next->log->next(next->event);
  }
  counts.written = to.events();
  for (const auto& input : inputs)
    counts.damage.insert(counts.damage.end(), input.log->damage().begin(),
                         input.log->damage().end());
  to.commit();
  return counts;
}

}  // namespace weft
