#include <spdlog/spdlog.h>

#include <condition_variable>
#include <lcm/lcm-cpp.hpp>
#include <mutex>
#include <set>
#include <thread>

#include "stage/clock.hpp"
#include "stage/host.hpp"
#include "stage/telemetry.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/status_t.hpp"

namespace weft::stage {
namespace {
// A device that is gone fails at once, every time.
constexpr std::int64_t kPauseAfterFailure_us = 100'000;
}  // namespace

class SourceHost::Impl {
 public:
  Impl(Source& source, SourceHostOptions options)
      : options_(std::move(options)),
        runner_(source, options_.source),
        identity_(make_identity(source.interface(), options_.name, options_.source.channels)),
        lcm_(connect(options_.url)) {
    check_channels(options_.source.channels, source.interface(), options_.url.prefix);
    publish_status(weft::stage_status_t::STARTING);
    if (options_.on_trigger) {
      lcm_->subscribeFunction(channel_regex(options_.url.wire(kTriggerChannel)), &Impl::on_trigger,
                              this)
          ->setQueueCapacity(0);
    }
    lcm_->subscribeFunction(channel_regex(options_.url.wire(kPingChannel)), &Impl::on_ping, this)
        ->setQueueCapacity(0);
  }

  void run() {
    std::jthread producer([this](const std::stop_token& stop) { produce(stop); });
    std::jthread receiver([this](const std::stop_token& stop) {
      while (!stop.stop_requested()) lcm_->handleTimeout(50);
    });
    run_until_stopped(stop_.get_token(), [this] { publish_status(weft::stage_status_t::RUNNING); });
    producer.request_stop();
    producer.join();
    receiver.request_stop();
    receiver.join();
    publish_status(weft::stage_status_t::STOPPING);
  }

  void request_stop() { stop_.request_stop(); }

  Counters counters() {
    const std::lock_guard lock(mutex_);
    return counters_;
  }

 private:
  static void on_trigger(const lcm::ReceiveBuffer* buffer, const std::string&, Impl* self) {
    self->trigger(buffer);
  }

  static void on_ping(const lcm::ReceiveBuffer* buffer, const std::string&, Impl* self) {
    std::vector<std::uint8_t> answer;
    {
      const std::lock_guard lock(self->mutex_);
      answer = self->clock_.answer(self->identity_, buffer->data, buffer->data_size, now_us());
    }
    if (!answer.empty()) self->send(kPongChannel, answer);
  }

  void trigger(const lcm::ReceiveBuffer* buffer) {
    weft::header_t header;
    const int size = static_cast<int>(buffer->data_size);
    const bool decoded = header.decode(buffer->data, 0, size) == size;
    const std::lock_guard lock(mutex_);
    if (!decoded) {
      ++trigger_failures_;
      return;
    }
    if (!header.camera.empty() && header.camera != options_.source.camera) return;
    constexpr std::size_t kRemembered = 1024;
    if (triggers_seen_.size() >= kRemembered) triggers_seen_.erase(triggers_seen_.begin());
    if (!triggers_seen_.insert({header.session, header.seq}).second) {
      ++trigger_repeats_;
      return;
    }
    ++triggers_;
    wake_.notify_one();
  }

  /// False when stop was requested instead.
  bool wait_for_turn(const std::stop_token& stop, std::int64_t due_us) {
    std::unique_lock lock(mutex_);
    if (options_.on_trigger) {
      if (!wake_.wait(lock, stop, [this] { return triggers_ > 0; })) return false;
      --triggers_;
    }
    const auto wait = std::chrono::microseconds(due_us - now_us());
    if (wait.count() > 0) wake_.wait_for(lock, stop, wait, [] { return false; });
    return !stop.stop_requested();
  }

  void produce(const std::stop_token& stop) {
    const auto period_us =
        options_.rate_hz > 0 ? static_cast<std::int64_t>(1e6 / options_.rate_hz) : 0;
    std::int64_t due_us = now_us();
    for (std::int64_t i = 0; options_.count == 0 || i < options_.count; ++i) {
      if (!wait_for_turn(stop, due_us)) return;
      // Late frames do not pile up: the schedule starts again from now.
      due_us = std::max(due_us + period_us, now_us());
      const std::int64_t started_us = now_us();
      const std::int64_t cpu_before = process_cpu_us();
      auto answer = runner_.next(started_us, stop);
      if (!answer) break;
      answer->received_us = answer->started_us = started_us;
      answer->finished_us = now_us();
      answer->cpu_us = process_cpu_us() - cpu_before;
      answer->queue_length = 1;
      for (std::size_t part = 0; part < answer->messages.size(); ++part) {
        if (part > 0)
          std::this_thread::sleep_for(std::chrono::microseconds(options_.part_pause_us));
        send(answer->messages[part].channel, answer->messages[part].bytes);
      }
      send(kTimingChannel, timing_message(identity_, *answer, now_us()));
      if (answer->status_code == weft::status_t::FAILED) {
        spdlog::warn("{}", runner_.counters().last_error);
        due_us = std::max(due_us, now_us() + kPauseAfterFailure_us);
      }
      const std::lock_guard lock(mutex_);
      counters_ = runner_.counters();
    }
    stop_.request_stop();
  }

  void send(const std::string& channel, const std::vector<std::uint8_t>& bytes) {
    if (lcm_->publish(options_.url.wire(channel), bytes.data(),
                      static_cast<unsigned>(bytes.size())) == 0)
      return;
    const std::lock_guard lock(mutex_);
    transport_error_ = "LCM cannot send on " + channel;
  }

  void publish_status(std::int8_t state) {
    Counters counters;
    {
      const std::lock_guard lock(mutex_);
      counters = counters_;
      counters.repeats = trigger_repeats_;
      counters.decode_failures = trigger_failures_ + clock_.decode_failures();
      if (!transport_error_.empty()) counters.last_error = transport_error_;
    }
    send(kStatusChannel, status_message(identity_, counters, state, status_seq_++));
  }

  const SourceHostOptions options_;
  SourceRunner runner_;
  const Identity identity_;
  std::mutex mutex_;  // guards what follows, up to the stop source
  std::condition_variable_any wake_;
  Counters counters_;
  ClockAnswers clock_;
  std::string transport_error_;
  std::int64_t triggers_ = 0;
  std::int64_t trigger_repeats_ = 0;
  std::int64_t trigger_failures_ = 0;
  std::set<std::pair<std::int64_t, std::int64_t>> triggers_seen_;
  std::stop_source stop_;
  std::int64_t status_seq_ = 0;
  std::unique_ptr<lcm::LCM> lcm_;
};

SourceHost::SourceHost(Source& source, SourceHostOptions options)
    : impl_(std::make_unique<Impl>(source, std::move(options))) {}
SourceHost::~SourceHost() = default;
void SourceHost::run() { impl_->run(); }
void SourceHost::request_stop() { impl_->request_stop(); }
Counters SourceHost::counters() const { return impl_->counters(); }

}  // namespace weft::stage
