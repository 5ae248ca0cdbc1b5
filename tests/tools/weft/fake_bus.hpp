#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "stage/runner.hpp"
#include "stage/telemetry.hpp"
#include "tools/weft/bus.hpp"
#include "weft/stage_status_t.hpp"

namespace weft {

/// Runners in this thread, joined by a queue that a test may make lose and double messages.
class FakeBus : public Bus {
 public:
  using Factory = std::function<std::unique_ptr<stage::Stage>()>;
  /// What becomes of a message on its way to one receiver: 0 lost, 1 delivered, 2 delivered twice.
  std::function<int(const std::string& receiver, const std::string& channel)> fate =
      [](const auto&, const auto&) { return 1; };
  /// May change a copy on its way to the player.
  std::function<void(const std::string& channel, int copy, std::vector<std::uint8_t>& data)> alter =
      [](const auto&, int, auto&) {};

  void add(const std::string& name, Factory factory) {
    nodes_.push_back({name, std::move(factory), nullptr, nullptr, 0});
    restart(name);
  }
  /// As if the process had been killed and started again.
  void restart(const std::string& name) {
    for (auto& node : nodes_) {
      if (node.name != name) continue;
      node.runner.reset();
      node.stage = node.factory();
      stage::RunnerOptions options;
      options.lock_step = true;
      node.runner = std::make_unique<stage::Runner>(*node.stage, options);
      ++node.starts;
      auto identity = stage::make_identity(node.runner->interface(), name, {});
      identity.started_us = node.starts;
      to_player_.push_back(
          {"STAGE_STATUS", stage::status_message(identity, node.runner->counters(),
                                                 weft::stage_status_t::RUNNING, 0)});
    }
  }
  void publish(const std::string& channel, const std::vector<std::uint8_t>& data) override {
    deliver(channel, data);
  }
  std::optional<BusMessage> receive(std::chrono::milliseconds) override {
    ++time_us_;
    for (auto& node : nodes_) {
      node.runner->advance(time_us_);
      if (auto job = node.runner->start(time_us_)) {
        job->run();
        node.runner->finish(std::move(job), time_us_, 1);
      }
      const auto identity = stage::make_identity(node.runner->interface(), node.name, {});
      for (const auto& [answer, repeat] : node.runner->take_outgoing()) {
        for (const auto& message : answer->messages) deliver(message.channel, message.bytes);
        if (!repeat) deliver("STAGE_TIMING", stage::timing_message(identity, *answer, time_us_));
      }
    }
    if (to_player_.empty()) return std::nullopt;
    auto message = std::move(to_player_.front());
    to_player_.pop_front();
    return message;
  }

 private:
  struct Node {
    std::string name;
    Factory factory;
    std::unique_ptr<stage::Stage> stage;
    std::unique_ptr<stage::Runner> runner;
    int starts = 0;
  };
  void deliver(const std::string& channel, const std::vector<std::uint8_t>& data) {
    for (auto& node : nodes_) {
      for (int i = fate(node.name, channel); i > 0; --i)
        node.runner->receive(channel, data.data(), data.size(), time_us_);
    }
    for (int copy = 0, copies = fate("player", channel); copy < copies; ++copy) {
      to_player_.push_back({channel, data});
      alter(channel, copy, to_player_.back().data);
    }
  }
  std::vector<Node> nodes_;
  std::deque<BusMessage> to_player_;
  std::int64_t time_us_ = 1;
};

}  // namespace weft
