#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace weft::test {

/// What a replay's payloads must not depend on.
struct Circumstances {
  std::size_t frames = 1;  // of logs/sample.lcm
  int threads = 0;         // of every stage that has the setting; 0: as the set has it
  bool reversed = false;   // the stages are started last to first
  bool kill = false;       // each stage in turn, one after each frame
  std::map<std::string, std::string> environment;
};

/// The narrowest code of Weft's kernels, of glibc's libm and of OpenCV's dispatcher.
std::map<std::string, std::string> narrow_processor();

/// Sets in config/sets, without the ending.
std::vector<std::string> shipped_sets();
std::filesystem::path set_file(const std::string& set);
/// Why the set cannot be replayed here; empty: it can.
std::string why_not(const std::string& set);
/// Whether all its stages are of the parts pipeline: without memory, and the same bits on every
/// x86-64 processor. Other stages give the same bits on the same processor.
bool is_parts_pipeline(const std::string& set);

/// "SEQ CHANNEL HASH" of all payloads, sorted, of a lock-step replay through the set's processes in
/// a network namespace of their own. folder: for the log it writes and the processes' output,
/// NAME.log. Throws Error when a frame has no answer, or another one to its repetition.
std::vector<std::string> replayed_payloads(const std::string& set, const Circumstances& how,
                                           const std::filesystem::path& folder);
/// The same from a log, of its first `frames` frames.
std::vector<std::string> sorted_payloads(const std::filesystem::path& log);

}  // namespace weft::test
