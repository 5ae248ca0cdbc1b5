#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stage/channels.hpp"
#include "stage/runner.hpp"
#include "stage/stage.hpp"

namespace weft::stage {

/// Several stages in one thread over memq://, in lock-step: the same Runner as in a process of its
/// own, the same answers, always in the same order. For tests, and for machines without multicast.
///
///   InProcess set;
///   set.add(make_foreground(settings));
///   set.add(make_describe(settings), "describe-sift", {{"WORDS", "WORDS_SIFT"}});
///   set.observe([&](const std::string& channel, const std::vector<std::uint8_t>& bytes) { ... });
///   for (event of a log's source channels) { set.inject(event.channel, event.data); set.run(); }
///   for (const auto& report : set.reports()) ...
class InProcess {
 public:
  /// Called for every message published, source events and STAGE_TIMING included, in order.
  using Observer =
      std::function<void(const std::string& channel, const std::vector<std::uint8_t>& bytes)>;

  struct Report {
    std::string stage;
    Counters counters;
    std::size_t waiting = 0;  // frames that still lack an input
  };

  InProcess();
  ~InProcess();
  /// name: of the instance; empty: the interface's own. Throws Error when two instances have one
  /// name.
  void add(std::shared_ptr<Stage> stage, const std::string& name = "",
           const ChannelMap& channels = {});
  void observe(Observer observer);
  /// Queues a source event. The events go in one by one, each when the stages are done with the one
  /// before.
  void inject(const std::string& channel, std::vector<std::uint8_t> bytes);
  /// Until nothing is left to do. A frame that then waits for feedback alone goes on without it:
  /// the frame that it waits for is not there.
  void run();
  /// Publishes the STAGE_STATUS of every stage; state: of stage_status_t.
  void publish_status(std::int8_t state);
  std::vector<Report> reports() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace weft::stage
