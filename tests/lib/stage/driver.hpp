#pragma once

#include <utility>
#include <vector>

#include "fake_stage.hpp"
#include "stage/runner.hpp"

namespace weft::stage::fake {

/// A runner with a clock of its own, which processes what is ready unless told to wait.
class Driver {
 public:
  Driver(Stage& stage, RunnerOptions options) : runner(stage, std::move(options)) {}

  template <class Message>
  std::vector<Outgoing> send(const std::string& channel, const Message& m) {
    return send_bytes(channel, encode(m));
  }
  std::vector<Outgoing> send_bytes(const std::string& channel, const Bytes& bytes) {
    runner.receive(channel, bytes.data(), bytes.size(), now);
    if (busy) return runner.take_outgoing();
    return process();
  }
  std::vector<Outgoing> process() {
    while (auto job = runner.start(now)) {
      job->run();
      runner.finish(std::move(job), now, 0);
    }
    return runner.take_outgoing();
  }
  std::vector<Outgoing> wait(std::int64_t us) {
    now += us;
    runner.advance(now);
    return process();
  }

  Runner runner;
  std::int64_t now = 5'000'000;
  bool busy = false;  // as if process() took long
};

}  // namespace weft::stage::fake
