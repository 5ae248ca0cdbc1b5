#include "stage/host.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <condition_variable>
#include <lcm/lcm-cpp.hpp>
#include <mutex>
#include <thread>

#include "stage/clock.hpp"
#include "stage/telemetry.hpp"
#include "weft/stage_status_t.hpp"

namespace weft::stage {
namespace {
// How long the receive thread waits for a message before it looks whether it should stop.
constexpr std::int64_t kReceiveWait_ms = 100;
constexpr std::chrono::milliseconds kPartPause{4};
}  // namespace

class Host::Impl {
 public:
  Impl(Stage& stage, const HostOptions& options)
      : url_(options.url),
        runner_(stage, options.runner),
        identity_(make_identity(stage.interface(), options.name, options.runner.channels)),
        lcm_(connect(options.url)) {
    check_channels(options.runner.channels, stage.interface(), url_.prefix);
    publish_status(weft::stage_status_t::STARTING);
    for (const std::string& channel : runner_.channels()) {
      auto* subscription =
          lcm_->subscribeFunction(channel_regex(url_.wire(channel)), &Impl::on_message, this);
      if (!subscription) throw Error("cannot subscribe to channel " + channel);
      // LCM would drop the newest message when 30 wait; the runner's own bounds answer for a frame.
      subscription->setQueueCapacity(0);
    }
    lcm_->subscribeFunction(channel_regex(url_.wire(kPingChannel)), &Impl::on_ping, this)
        ->setQueueCapacity(0);
  }

  void run() {
    std::jthread receiver([this](const std::stop_token& stop) { receive(stop); });
    std::jthread worker([this](const std::stop_token& stop) { work(stop); });
    run_until_stopped(stop_.get_token(), [this] { publish_status(weft::stage_status_t::RUNNING); });
    worker.request_stop();
    worker.join();
    receiver.request_stop();
    receiver.join();
    publish_status(weft::stage_status_t::STOPPING);
  }

  void request_stop() { stop_.request_stop(); }

 private:
  // No member function: the undefined behaviour sanitizer of g++ 12 mistakes LCM's call of one.
  static void on_message(const lcm::ReceiveBuffer* buffer, const std::string& channel, Impl* self) {
    {
      const std::lock_guard lock(self->mutex_);
      self->runner_.receive(self->url_.local(channel),
                            static_cast<const std::uint8_t*>(buffer->data), buffer->data_size,
                            now_us());
    }
    self->wake_.notify_one();
    self->publish();
  }

  static void on_ping(const lcm::ReceiveBuffer* buffer, const std::string&, Impl* self) {
    std::vector<std::uint8_t> answer;
    {
      const std::lock_guard lock(self->mutex_);
      answer = self->clock_.answer(self->identity_, buffer->data, buffer->data_size, now_us());
    }
    if (!answer.empty()) self->send(kPongChannel, answer);
  }

  void receive(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      std::int64_t wait_ms = kReceiveWait_ms;
      {
        const std::lock_guard lock(mutex_);
        runner_.advance(now_us());
        if (const auto next_us = runner_.next_wakeup())
          wait_ms = std::clamp<std::int64_t>((*next_us - now_us()) / 1000 + 1, 1, wait_ms);
      }
      wake_.notify_one();  // a deadline may have made a frame ready
      publish();
      int handled = lcm_->handleTimeout(static_cast<int>(wait_ms));
      // What has arrived already goes before the deadlines, lest a busy machine misses inputs that
      // are there. Bounded, so that a flood does not hold up the rest.
      for (int i = 0; i < 1000 && handled > 0; ++i) handled = lcm_->handleTimeout(0);
      if (handled >= 0) continue;
      {
        const std::lock_guard lock(mutex_);
        transport_error_ = "LCM cannot receive";
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(kReceiveWait_ms));
    }
  }

  void work(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (!stop.stop_requested()) {
      auto job = runner_.start(now_us());
      if (!job) {
        wake_.wait_for(lock, std::chrono::milliseconds(100));
        continue;
      }
      lock.unlock();
      const std::int64_t cpu_before = process_cpu_us();
      job->run();
      const std::int64_t cpu_us = process_cpu_us() - cpu_before;
      lock.lock();
      runner_.finish(std::move(job), now_us(), cpu_us);
      lock.unlock();
      publish();
      lock.lock();
    }
  }

  void publish() {
    std::vector<Outgoing> outgoing;
    {
      const std::lock_guard lock(mutex_);
      outgoing = runner_.take_outgoing();
    }
    for (const auto& [answer, repeat] : outgoing) {
      const std::string* previous = nullptr;
      for (const Publication& message : answer->messages) {
        // Parts of one answer: their receivers get time to empty their socket buffers.
        if (previous && *previous == message.channel) std::this_thread::sleep_for(kPartPause);
        previous = &message.channel;
        send(message.channel, message.bytes);
      }
      if (!repeat) send(kTimingChannel, timing_message(identity_, *answer, now_us()));
    }
  }

  void send(const std::string& channel, const std::vector<std::uint8_t>& bytes) {
    if (lcm_->publish(url_.wire(channel), bytes.data(), static_cast<unsigned>(bytes.size())) == 0)
      return;
    const std::lock_guard lock(mutex_);
    transport_error_ = "LCM cannot send on " + channel;
  }

  void publish_status(std::int8_t state) {
    Counters counters;
    {
      const std::lock_guard lock(mutex_);
      counters = runner_.counters();
      counters.decode_failures += clock_.decode_failures();
      if (!transport_error_.empty()) counters.last_error = transport_error_;
    }
    if (counters.last_error != logged_error_) spdlog::warn("{}", counters.last_error);
    logged_error_ = counters.last_error;
    send(kStatusChannel, status_message(identity_, counters, state, status_seq_++));
  }

  const LcmUrl url_;
  std::mutex mutex_;  // guards runner_, clock_ and transport_error_
  std::condition_variable wake_;
  Runner runner_;
  ClockAnswers clock_;
  std::string transport_error_;
  const Identity identity_;
  std::int64_t status_seq_ = 0;
  std::string logged_error_;  // at most one line a second, however much goes wrong
  std::stop_source stop_;
  std::unique_ptr<lcm::LCM> lcm_;
};

Host::Host(Stage& stage, const HostOptions& options)
    : impl_(std::make_unique<Impl>(stage, options)) {}
Host::~Host() = default;
void Host::run() { impl_->run(); }
void Host::request_stop() { impl_->request_stop(); }

}  // namespace weft::stage
