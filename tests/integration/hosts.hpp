#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/weft/run_folder.hpp"

/// Several hosts on one machine: network namespaces with host names of their own, each with a cable
/// to one switch (a bridge without multicast snooping), Ethernet's MTU of 1500.
namespace weft::test_hosts {

/// Why no hosts can be made here, for GTEST_SKIP; empty when they can. Needs root or a user
/// namespace, and ip.
std::string why_no_hosts();

/// Runs the body, and all that it starts, in a child with network, host name, mounts and processes
/// of its own, of which nothing is left afterwards. A failed EXPECT or ASSERT in the body fails the
/// test. The child is not the test: nothing that the body sets is seen outside.
void in_a_world_of_its_own(const std::function<void()>& body);

/// The hosts and the switch, in the world of the caller. The switch itself has an address
/// (10.9.0.254) and hears everything: what runs outside of any host sees what was sent, even where
/// a host loses it.
class Lan {
 public:
  /// folder: for what the sets write; $WEFT_RUN_DIR of host NAME is FOLDER/NAME.
  Lan(const std::vector<std::string>& names, std::filesystem::path folder);

  /// Runs a program to its end on a host; "" is the switch.
  CommandResult run(const std::string& host, const std::vector<std::string>& command) const;
  /// The program weft, with a host's own folder for running sets.
  CommandResult weft(const std::string& host, std::vector<std::string> args) const;
  /// Starts a program on a host; its output goes to a file.
  pid_t start(const std::string& host, const std::vector<std::string>& command,
              const std::filesystem::path& output) const;
  /// Of a thousand packets that other hosts send, this many never reach a host. Needs nft.
  void lose(const std::string& host, int per_thousand) const;
  /// Packets that lose() has dropped there since it was called last.
  std::int64_t lost_packets(const std::string& host) const;

 private:
  struct Host {
    int network = -1, name = -1;  // descriptors of its namespaces; closed with the world
    std::string address;
  };
  void enter(const std::string& host) const;
  std::filesystem::path folder_;
  std::map<std::string, Host> hosts_;
};

/// SIGINT, then waits. The exit status.
int stop_process(pid_t pid);

/// What became of the frames of one recording, and whether every answer is right: the source
/// messages are played again through the same set in lock-step, and every answer that is OK or
/// NOTHING must have the same bytes.
struct Verdict {
  struct Channel {
    int answered = 0;  // frames with an answer
    int good = 0;      // OK or NOTHING
    int wrong = 0;     // good, but with other bytes than in lock-step
    int changed = 0;   // answered twice, not alike, the second time not only better for a restart
    std::map<int, int> codes;
  };
  int frames = 0;  // source frames recorded
  std::map<std::string, Channel> channels;
  std::vector<std::string> faults;  // the first few, for a person
};
/// set: a file whose processes can all run on one host. work: a folder for what is written.
Verdict judge(const std::filesystem::path& recorded, const std::filesystem::path& set,
              const std::filesystem::path& work);

/// "processes" and "elsewhere" of weft status --json as one object.
nlohmann::json all_processes(const nlohmann::json& status);

}  // namespace weft::test_hosts
