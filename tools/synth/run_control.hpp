#pragma once

#include <chrono>
#include <string>

/// What long commands share: being stopped, and one line that says how far they are.
namespace weft::synth {

/// SIGINT and SIGTERM are noticed instead of fatal; a second one ends the program at once.
void catch_stop_signals();
bool stop_requested();

/// One line on the standard error: rewritten on a terminal, else a line every ten seconds.
class ProgressLine {
 public:
  ProgressLine();
  void show(const std::string& text);
  /// A line of its own that stays.
  void note(const std::string& text);

 private:
  bool terminal_;
  std::chrono::steady_clock::time_point shown_;
};

/// "50 s", "12 min", "3.4 h"; "" for less than nothing.
std::string time_text(double seconds);

}  // namespace weft::synth
