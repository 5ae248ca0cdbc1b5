#include "stage/in_process.hpp"

#include <deque>
#include <lcm/lcm-cpp.hpp>

#include "stage/clock.hpp"
#include "stage/lcm_url.hpp"
#include "stage/telemetry.hpp"

namespace weft::stage {
namespace {
RunnerOptions lock_step(const ChannelMap& channels) {
  RunnerOptions options;
  options.lock_step = true;
  options.channels = channels;
  return options;
}
}  // namespace

class InProcess::Impl {
 public:
  Impl() : lcm_("memq://") {
    if (!lcm_.good()) throw Error("LCM has no memq provider; install liblcm 1.3 or newer");
  }

  void add(std::shared_ptr<Stage> stage, const std::string& name, const ChannelMap& channels) {
    auto member = std::make_unique<Member>(*this, std::move(stage), name, channels);
    for (const auto& other : members_) {
      if (other->identity.stage == member->identity.stage)
        throw Error("two stages are named " + other->identity.stage + "; name the instances");
    }
    for (const std::string& channel : member->runner.channels())
      lcm_.subscribeFunction(channel_regex(channel), &Member::on_message, member.get())
          ->setQueueCapacity(0);
    members_.push_back(std::move(member));
  }

  void run() {
    for (;;) {
      while (lcm_.handleTimeout(0) > 0) {
      }
      if (events_.empty()) {
        if (!forgo_feedback()) return;
        continue;
      }
      const Publication event = std::move(events_.front());
      events_.pop_front();
      publish(event.channel, event.bytes);
    }
  }

  bool forgo_feedback() {
    for (const auto& member : members_) {
      if (!member->runner.forgo_feedback(now_us())) continue;
      member->work();
      return true;
    }
    return false;
  }

  void publish(const std::string& channel, const std::vector<std::uint8_t>& bytes) {
    if (observer_) observer_(channel, bytes);
    if (lcm_.publish(channel, bytes.data(), static_cast<unsigned>(bytes.size())) != 0)
      throw Error("LCM cannot publish on " + channel);
  }

  struct Member {
    Member(Impl& owner, std::shared_ptr<Stage> the_stage, const std::string& name,
           const ChannelMap& channels)
        : set(owner),
          stage(std::move(the_stage)),
          runner(*stage, lock_step(channels)),
          identity(make_identity(stage->interface(), name, channels)) {}

    static void on_message(const lcm::ReceiveBuffer* buffer, const std::string& channel,
                           Member* self) {
      self->receive(channel, static_cast<const std::uint8_t*>(buffer->data), buffer->data_size);
    }

    void receive(const std::string& channel, const std::uint8_t* data, std::size_t size) {
      runner.receive(channel, data, size, now_us());
      work();
    }

    void work() {
      while (auto job = runner.start(now_us())) {
        const std::int64_t cpu_before = process_cpu_us();
        job->run();
        const std::int64_t cpu_us = process_cpu_us() - cpu_before;
        runner.finish(std::move(job), now_us(), cpu_us);
      }
      for (const auto& [answer, repeat] : runner.take_outgoing()) {
        for (const Publication& message : answer->messages)
          set.publish(message.channel, message.bytes);
        if (!repeat) set.publish(kTimingChannel, timing_message(identity, *answer, now_us()));
      }
    }

    Impl& set;
    std::shared_ptr<Stage> stage;
    Runner runner;
    Identity identity;
    std::int64_t status_seq = 0;
  };

  std::vector<std::unique_ptr<Member>> members_;
  std::deque<Publication> events_;
  Observer observer_;
  lcm::LCM lcm_;
};

InProcess::InProcess() : impl_(std::make_unique<Impl>()) {}
InProcess::~InProcess() = default;

void InProcess::add(std::shared_ptr<Stage> stage, const std::string& name,
                    const ChannelMap& channels) {
  impl_->add(std::move(stage), name, channels);
}

void InProcess::observe(Observer observer) { impl_->observer_ = std::move(observer); }

void InProcess::inject(const std::string& channel, std::vector<std::uint8_t> bytes) {
  impl_->events_.push_back({channel, std::move(bytes)});
}

void InProcess::run() { impl_->run(); }

void InProcess::publish_status(std::int8_t state) {
  for (const auto& member : impl_->members_) {
    impl_->publish(kStatusChannel, status_message(member->identity, member->runner.counters(),
                                                  state, member->status_seq++));
  }
}

std::vector<InProcess::Report> InProcess::reports() const {
  std::vector<Report> reports;
  for (const auto& member : impl_->members_) {
    reports.push_back(
        {member->identity.stage, member->runner.counters(), member->runner.held().pending});
  }
  return reports;
}

}  // namespace weft::stage
