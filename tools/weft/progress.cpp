#include "tools/weft/progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

namespace weft {

Progress::Progress(std::string what, long total)
    : what_(std::move(what)),
      total_(total),
      terminal_(isatty(STDERR_FILENO) != 0),
      started_(Clock::now()),
      printed_(started_) {}

Progress::~Progress() { finish(); }

void Progress::update(long done, const std::string& note) {
  done_ = done;
  const auto now = Clock::now();
  if (now - printed_ < (terminal_ ? std::chrono::milliseconds(100) : std::chrono::seconds(10)))
    return;
  printed_ = now;
  print(done, note, false);
}

void Progress::finish() {
  if (finished_) return;
  finished_ = true;
  print(done_, "", true);
}

void Progress::print(long done, const std::string& note, bool last) {
  const double seconds = std::chrono::duration<double>(Clock::now() - started_).count();
  const double rate = seconds > 0 ? static_cast<double>(done) / seconds : 0;
  std::string line = fmt::format("{}: {}/{}, {:.1f}/s", what_, done, total_, rate);
  if (!last && rate > 0)
    line += fmt::format(", {:.0f} s left", static_cast<double>(total_ - done) / rate);
  if (!note.empty()) line += ", " + note;
  std::fprintf(stderr, terminal_ ? "\r\033[K%s%s" : "%s%s", line.c_str(),
               terminal_ && !last ? "" : "\n");
  std::fflush(stderr);
}

}  // namespace weft
