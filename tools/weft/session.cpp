#include "tools/weft/session.hpp"

#include <atomic>
#include <csignal>
#include <deque>
#include <lcm/lcm-cpp.hpp>

#include "base/error.hpp"
#include "stage/in_process.hpp"
#include "stage/net_namespace.hpp"
#include "weft/stage_status_t.hpp"

namespace weft {
namespace {

std::atomic<bool> stop_signal{false};

class LcmBus : public Bus {
 public:
  LcmBus(const stage::LcmUrl& url, const std::string& channels)
      : url_(url), lcm_(stage::connect(url)) {
    const auto of_robot = url.prefix.empty() ? channels : url.prefix + "/(" + channels + ")";
    auto* subscription = lcm_->subscribeFunction(of_robot, &LcmBus::on_message, this);
    if (!subscription) throw Error("LCM cannot subscribe");
    subscription->setQueueCapacity(0);
  }
  void publish(const std::string& channel, const std::vector<std::uint8_t>& data) override {
    if (lcm_->publish(url_.wire(channel), data.data(), static_cast<unsigned>(data.size())) != 0)
      throw Error("LCM cannot send " + std::to_string(data.size()) + " bytes on " + channel);
  }
  std::optional<BusMessage> receive(std::chrono::milliseconds timeout) override {
    if (arrived_.empty()) {
      // A signal interrupts the wait, which is no error.
      if (lcm_->handleTimeout(static_cast<int>(timeout.count())) < 0 && !stop_requested())
        throw Error("LCM cannot receive");
    }
    if (arrived_.empty()) return std::nullopt;
    auto message = std::move(arrived_.front());
    arrived_.pop_front();
    return message;
  }

 private:
  // No member function: the undefined behaviour sanitizer of g++ 12 mistakes LCM's call of one.
  static void on_message(const lcm::ReceiveBuffer* buffer, const std::string& channel,
                         LcmBus* self) {
    const auto* data = static_cast<const std::uint8_t*>(buffer->data);
    self->arrived_.push_back({self->url_.local(channel), {data, data + buffer->data_size}});
  }
  const stage::LcmUrl url_;
  std::unique_ptr<lcm::LCM> lcm_;
  std::deque<BusMessage> arrived_;
};

class InProcessBus : public Bus {
 public:
  InProcessBus(const ProcessSet& set, const StageRegistry& registry) {
    for (const auto& process : set.processes) {
      const auto factory = registry.find(process.exec);
      if (factory == registry.end())
        throw Error("process " + process.name + " of " + set.file.string() + " is " + process.exec +
                    ", which only runs as a process of its own; this needs LCM's multicast");
      stages_.add(factory->second(settings_of(process)), process.name,
                  stage::ChannelMap(process.map.begin(), process.map.end()));
    }
    stages_.observe([this](const std::string& channel, const std::vector<std::uint8_t>& bytes) {
      arrived_.push_back({channel, bytes});
    });
    stages_.publish_status(weft::stage_status_t::RUNNING);
    status_sent_ = std::chrono::steady_clock::now();
  }
  void publish(const std::string& channel, const std::vector<std::uint8_t>& data) override {
    stages_.inject(channel, data);
    waiting_ = true;
  }
  std::optional<BusMessage> receive(std::chrono::milliseconds) override {
    if (waiting_) {
      waiting_ = false;
      stages_.run();
      if (const auto now = std::chrono::steady_clock::now();
          now - status_sent_ > std::chrono::seconds(1)) {
        status_sent_ = now;
        stages_.publish_status(weft::stage_status_t::RUNNING);
      }
    }
    if (arrived_.empty()) return std::nullopt;
    auto message = std::move(arrived_.front());
    arrived_.pop_front();
    return message;
  }

 private:
  stage::InProcess stages_;
  std::deque<BusMessage> arrived_;
  std::chrono::steady_clock::time_point status_sent_;
  bool waiting_ = false;
};

}  // namespace

void catch_stop_signals() {
  struct sigaction action {};
  action.sa_handler = [](int) { stop_signal = true; };
  action.sa_flags = static_cast<int>(SA_RESETHAND);  // a second Ctrl-C ends the program at once
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

bool stop_requested() { return stop_signal; }

Transport choose_transport(std::string& why) {
  std::string no_network, no_multicast;
  if (stage::enter_private_network(no_network)) {
    why = "processes over LCM in a network of their own";
    return Transport::kPrivateNetwork;
  }
  if (stage::multicast_works(no_multicast)) {
    why =
        "processes over LCM on this host's loopback (no network of their own: " + no_network + ")";
    return Transport::kLoopback;
  }
  why = "all stages in one process, since this machine permits neither a network of their own (" +
        no_network + ") nor multicast (" + no_multicast + ")";
  return Transport::kInProcess;
}

std::unique_ptr<Bus> make_lcm_bus(const stage::LcmUrl& url, const std::string& channels) {
  return std::make_unique<LcmBus>(url, channels);
}

std::unique_ptr<Bus> make_in_process_bus(const ProcessSet& set, const StageRegistry& registry) {
  return std::make_unique<InProcessBus>(set, registry);
}

Settings settings_of(const ProcessSpec& process) {
  auto settings = process.settings.empty() ? Settings::empty(process.name)
                                           : Settings::from_file(process.settings.string());
  for (const auto& assignment : process.with) {
    const auto place = process.with_places.find(assignment);
    settings.set(assignment, place == process.with_places.end() ? "" : place->second);
  }
  return settings;
}

stage::LcmUrl url_of(const ProcessSet& set) {
  stage::LcmUrl url;
  url.group = set.group;
  url.port = set.port;
  url.ttl = set.ttl;
  url.recv_buf_size = set.receive_buffer;
  url.prefix = set.prefix;
  return url;
}

Session::Session(const ProcessSet& set, Transport transport, const StageRegistry& registry,
                 const std::string& log_folder, const PlayerOptions& options) {
  std::vector<std::string> names;
  for (const auto& process : set.processes) names.push_back(process.name);
  auto url = url_of(set);
  if (transport == Transport::kPrivateNetwork || transport == Transport::kLoopback) {
    url.ttl = 0;
    // Beside a running set on the same host, not in it.
    if (transport == Transport::kLoopback) url.port = url.port == 65535 ? 65534 : url.port + 1;
    bus_ = make_lcm_bus(url);
    children_ = std::make_unique<Children>(log_folder);
    for (const auto& process : set.processes)
      children_->start(process, command_line(set, process, url.to_string(), true));
  } else if (transport == Transport::kAttach) {
    bus_ = make_lcm_bus(url);
  } else {
    bus_ = make_in_process_bus(set, registry);
  }
  player_ = std::make_unique<Player>(*bus_, names, options, [this] {
    if (stop_requested()) throw Interrupted{};
    if (children_) children_->check();
  });
}

Session::~Session() {
  children_.reset();  // while their last words can still be sent
}

}  // namespace weft
