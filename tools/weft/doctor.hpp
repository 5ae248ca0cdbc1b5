#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/weft/process_set.hpp"
#include "tools/weft/session.hpp"
#include "weft/stage_status_t.hpp"

/// What would stop a machine, or a set on it, from working, each with its remedy.
namespace weft {

struct Finding {
  enum class Kind { kGood, kWarning, kBad };
  Kind kind = Kind::kGood;
  std::string what;
  std::string remedy;  // a command or a change, exactly; empty when all is well
};

/// Stages heard on one bus that do not fit together: two processes of one name, channels whose
/// writer and reader have types of different fingerprints, several builds, one program with several
/// models or settings.
std::vector<Finding> mixed_versions(const std::vector<weft::stage_status_t>& statuses);

/// Programs, settings and models of the processes of this host; a TTL of 0 in a set of several
/// hosts.
std::vector<Finding> check_set(const ProcessSet& set, const StageRegistry& registry,
                               const std::string& host);

/// Multicast route and loopback, receive buffer, cameras, disk.
std::vector<Finding> check_machine(const stage::LcmUrl& url, const std::string& record_folder);

/// How far the clocks of hosts are behind or ahead, from when their reports were sent and came. At
/// least as exact as the network is quick.
struct HostClock {
  std::string host;
  std::int64_t arrived_minus_sent_us = 0;  // the smallest seen
};
Finding judge_clock(const HostClock& clock);

}  // namespace weft
