#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "stage/lcm_url.hpp"
#include "stage/process.hpp"
#include "tools/weft/bus.hpp"
#include "tools/weft/children.hpp"
#include "tools/weft/player.hpp"
#include "tools/weft/process_set.hpp"

namespace weft {

/// How the stages of a set talk to each other.
enum class Transport {
  kPrivateNetwork,  // processes, in a network namespace of their own
  kLoopback,        // processes, over this host's multicast with TTL 0
  kAttach,          // processes that run already
  kInProcess,       // all stages in this process
};

/// The first of private network, loopback and in process that works here. Enters the namespace, so
/// call it before any thread is started. why: what was chosen and what did not work, for a person.
Transport choose_transport(std::string& why);

/// Whether SIGINT or SIGTERM came; catch_stop_signals() makes them noticed instead of fatal.
void catch_stop_signals();
bool stop_requested();

/// The user ended the program; no error.
struct Interrupted {};

/// Stages by the name of their program, for sets that run in one process.
using StageRegistry = std::map<std::string, stage::StageFactory>;

/// A bus over LCM that receives the channels of this regular expression.
std::unique_ptr<Bus> make_lcm_bus(const stage::LcmUrl& url, const std::string& channels = ".*");
/// All stages of a set in this thread.
std::unique_ptr<Bus> make_in_process_bus(const ProcessSet& set, const StageRegistry& registry);

stage::LcmUrl url_of(const ProcessSet& set);
/// Its settings file's, and over them those of the set. Throws Error where a file is not there.
Settings settings_of(const ProcessSpec& process);

/// A set that runs in lock-step from here to the end of this object, and its player.
class Session {
 public:
  /// log_folder: what the processes write. Throws Error when they cannot be started.
  Session(const ProcessSet& set, Transport transport, const StageRegistry& registry,
          const std::string& log_folder, const PlayerOptions& options);
  ~Session();
  Player& player() { return *player_; }
  /// Process numbers by name; for tests that kill one. Not for kAttach and kInProcess.
  Children& children() { return *children_; }

 private:
  std::unique_ptr<Children> children_;
  std::unique_ptr<Bus> bus_;
  std::unique_ptr<Player> player_;
};

}  // namespace weft
