#include "tools/weft/source_log.hpp"

#include <algorithm>
#include <map>
#include <set>

#include "base/error.hpp"
#include "base/hash.hpp"

namespace weft {

SourceLog::SourceLog(const std::string& file, const std::vector<std::string>& channels)
    : file_(file), reader_(file) {
  std::map<FrameName, std::size_t> index;
  std::set<std::uint64_t> seen;
  std::set<std::string> others;
  stage::LogEvent event;
  for (auto position = reader_.offset(); reader_.next(event); position = reader_.offset()) {
    if (std::find(channels.begin(), channels.end(), event.channel) == channels.end()) {
      others.insert(event.channel);
      continue;
    }
    const auto header = read_frame_header(event.data);
    if (!header)
      throw Error(file + ": a message on " + event.channel + " at byte " +
                  std::to_string(position) + " has no frame header");
    Hash64 hash;
    hash.add(event.channel);
    hash.add(event.data.data(), event.data.size());
    if (!seen.insert(hash.value()).second) continue;
    const auto [at, is_new] = index.emplace(header->frame, entries_.size());
    if (is_new) {
      entries_.push_back({header->frame, header->utime, {}});
      note_session(header->frame, header->utime);
    }
    entries_[at->second].positions.push_back(position);
  }
  damage_ = reader_.damage();
  if (entries_.empty()) {
    std::string wanted, found;
    for (const auto& each : channels) wanted += (wanted.empty() ? "" : ", ") + each;
    for (const auto& each : others) found += (found.empty() ? "" : ", ") + each;
    throw Error(file + ": no frame on " + wanted + "; the log holds " +
                (found.empty() ? "nothing" : found));
  }
}

void SourceLog::note_session(const FrameName& frame, std::int64_t utime) {
  const auto& [camera, session_number, seq] = frame;
  auto session = sessions_.begin();
  while (session != sessions_.end() &&
         (session->camera != camera || session->session != session_number))
    ++session;
  if (session == sessions_.end()) {
    session = sessions_.insert(session, {camera, session_number, seq, seq, utime, utime, 0});
  }
  session->seq_first = std::min(session->seq_first, seq);
  session->seq_last = std::max(session->seq_last, seq);
  session->utime_first = std::min(session->utime_first, utime);
  session->utime_last = std::max(session->utime_last, utime);
  ++session->count;
}

void SourceLog::select(const LogRange& range) {
  if (!range.has_frames() && !range.has_times()) return;
  std::int64_t first = entries_.front().utime;
  for (const auto& entry : entries_) first = std::min(first, entry.utime);
  std::erase_if(entries_, [&](const Entry& entry) {
    return !range.holds_frame(entry.name.seq) || !range.holds_time(entry.utime - first);
  });
  if (entries_.empty())
    throw Error(file_ + ": no frame lies in this range; weft log info shows what there is");
  sessions_.clear();
  for (const auto& entry : entries_) note_session(entry.name, entry.utime);
}

std::int64_t SourceLog::utime(std::size_t index) const {
  const auto& entry = entries_[index % entries_.size()];
  return entry.utime + pass_us(entry.name) * static_cast<std::int64_t>(index / entries_.size());
}

std::int64_t SourceLog::pass_us(const FrameName& frame) const {
  const auto& session = session_of(frame);
  const std::int64_t span = session.utime_last - session.utime_first;
  const std::int64_t step = session.count > 1 ? span / (session.count - 1) : 100000;
  return span + std::max<std::int64_t>(step, 1);
}

const SourceLog::Session& SourceLog::session_of(const FrameName& frame) const {
  return *std::find_if(sessions_.begin(), sessions_.end(), [&](const Session& each) {
    return each.camera == frame.camera && each.session == frame.session;
  });
}

SourceFrame SourceLog::read(std::size_t index) {
  const auto& entry = entries_[index % entries_.size()];
  const auto pass = static_cast<std::int64_t>(index / entries_.size());
  SourceFrame frame{entry.name, entry.utime, {}, index / entries_.size()};
  for (const auto position : entry.positions) {
    reader_.seek(position);
    stage::LogEvent event;
    if (!reader_.next(event)) throw Error("the log changed while it was read");
    frame.events.push_back(std::move(event));
  }
  if (pass == 0) return frame;
  const auto& session = session_of(entry.name);
  frame.name.seq += pass * (session.seq_last - session.seq_first + 1);
  frame.utime = utime(index);
  for (auto& event : frame.events)
    event.data = rename_frame(event.data, frame.name.seq, frame.utime);
  return frame;
}

}  // namespace weft
