#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tools/weft/process_set.hpp"
#include "tools/weft/session.hpp"
#include "weft/clock_pong_t.hpp"
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

/// Programs, settings and models of the processes of this host; models of any host that do not fit
/// together, as far as their files are here; a TTL of 0 in a set of several hosts. running:
/// processes that hold a camera already, which is then not opened again.
std::vector<Finding> check_set(const ProcessSet& set, const StageRegistry& registry,
                               const std::string& host, const std::set<std::string>& running = {});

/// Stages, on any host, that run with other settings or models than the set and the files it names
/// make here: a file was changed since they started, or differs between the hosts. Stages whose
/// files are not here are not looked at, nor are programs of the user's own.
std::vector<Finding> differences_from_files(const ProcessSet& set, const StageRegistry& registry,
                                            const std::vector<weft::stage_status_t>& statuses);

/// Processes that the set gives to other hosts and of which nothing is heard, though some of the
/// set is: a host that is down, or a network that lets no multicast through. Sources may have come
/// to their end, and are not missed.
std::vector<Finding> silent_hosts(const ProcessSet& set, const std::string& this_host,
                                  const std::vector<weft::stage_status_t>& statuses);

/// The interface that packets to an IPv4 address leave by. table: as /proc/net/route has it. Empty:
/// no route.
std::string route_interface(const std::string& table, const std::string& address);

/// The depth cameras that are plugged in, and whether this user may open them. devices: one folder
/// a device, as in /sys/bus/usb/devices; nodes: of the files to open, as /dev/bus/usb.
std::vector<Finding> check_cameras(const std::string& devices = "/sys/bus/usb/devices",
                                   const std::string& nodes = "/dev/bus/usb");

/// Multicast route and loopback, receive buffer, memory for the pieces of messages from other
/// hosts, cameras, disk. record_bytes_per_s: what a recording takes; 0: not known.
std::vector<Finding> check_machine(const stage::LcmUrl& url, const std::string& record_folder,
                                   double record_bytes_per_s = 0);

/// How far the clocks of other hosts are from this one's, by a message there and back: of the
/// question, sent at t1 and received at t2, and the answer, sent at t3 and received at t4, the
/// offset is ((t2 - t1) + (t3 - t4)) / 2, and wrong by half the time on the way at most. Of each
/// host the quickest exchange counts. (NTP's formula: RFC 5905, section 8.)
class ClockExchange {
 public:
  /// session: tells this asker's questions from others'.
  explicit ClockExchange(std::int64_t session) : session_(session) {}
  /// The next question; utime: when it will be sent.
  weft::header_t question(std::int64_t now_us);
  /// An answer. Those to other questions are ignored.
  void take(const weft::clock_pong_t& pong, std::int64_t now_us);

  struct Host {
    std::int64_t offset_us = 0;  // its clock minus this one's
    std::int64_t on_the_way_us = 0;
    int exchanges = 0;
  };
  const std::map<std::string, Host>& hosts() const { return hosts_; }
  /// Clocks of other hosts, and processes that began before their host's clock was set. heard: the
  /// hosts whose stages report.
  std::vector<Finding> findings(const std::string& this_host,
                                const std::set<std::string>& heard) const;

 private:
  const std::int64_t session_;
  std::vector<std::int64_t> sent_us_;  // by seq
  std::map<std::string, Host> hosts_;
  std::map<std::string, std::pair<std::string, std::int64_t>> set_by_us_;  // process: host, us
};

}  // namespace weft
