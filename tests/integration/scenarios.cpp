#include "integration/scenarios.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <functional>
#include <set>
#include <thread>

#include "base/random.hpp"
#include "base/text_file.hpp"
#include "integration/hosts.hpp"
#include "integration/test_log.hpp"
#include "stage/clock.hpp"
#include "tools/weft/frame_name.hpp"
#include "tools/weft/message.hpp"
#include "tools/weft/session.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft::test_hosts {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

#ifdef __SANITIZE_ADDRESS__
/// What the sanitizer holds back of what was freed.
constexpr std::int64_t kQuarantine_bytes = 256 << 20;
#else
constexpr std::int64_t kQuarantine_bytes = 0;
#endif

/// A folder that is gone afterwards, but for that of a test that failed. Short: a socket's name
/// holds it.
class Folder {
 public:
  Folder() : path_(fs::temp_directory_path() / fmt::format("weft-hosts-{}", getpid())) {
    fs::remove_all(path_);
    fs::create_directories(path_);
  }
  ~Folder() {
    if (!testing::Test::HasFailure()) fs::remove_all(path_);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  fs::path operator/(const std::string& name) const { return path_ / name; }
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

double median(const std::vector<double>& values) { return quantile(values, 0.5); }

/// weft record, from when it listens.
pid_t start_recorder(const Lan& lan, const Folder& folder, const std::string& set) {
  const auto out = folder / "recorded.lcm";
  const pid_t pid = lan.start(
      "", {WEFT_BINARY_DIR "/bin/weft", "record", out.string(), "--set", (folder / set).string()},
      folder / "record.out");
  for (int i = 0; i < 200 && !fs::exists(out); ++i) std::this_thread::sleep_for(milliseconds(50));
  EXPECT_TRUE(fs::exists(out)) << read_text_file(folder / "record.out");
  return pid;
}

/// What the stages of a set say about themselves and their frames, as heard on the switch.
class Listener {
 public:
  explicit Listener(const fs::path& set) : bus_(make_lcm_bus(url_of(ProcessSet::from_file(set)))) {}

  /// Called for every message.
  std::function<void(const BusMessage&)> on_message;

  /// The next message; STAGE_STATUS is remembered on the way.
  std::optional<BusMessage> next(milliseconds wait) {
    auto message = bus_->receive(wait);
    if (message && on_message) on_message(*message);
    if (message && message->channel == "STAGE_STATUS") {
      if (const auto status = decode_message<weft::stage_status_t>(message->data))
        statuses_[status->stage] = *status;
    }
    return message;
  }
  void listen(milliseconds time) {
    for (const auto end = Clock::now() + time; Clock::now() < end;) next(milliseconds(20));
  }
  template <class Condition>
  bool wait_for(const Condition& condition, milliseconds limit) {
    for (const auto end = Clock::now() + limit; !condition();) {
      if (Clock::now() > end) return false;
      next(milliseconds(20));
    }
    return true;
  }
  void publish(const std::string& channel, const std::vector<std::uint8_t>& data) {
    bus_->publish(channel, data);
  }
  const weft::stage_status_t& status(const std::string& stage) { return statuses_[stage]; }

 private:
  std::unique_ptr<Bus> bus_;
  std::map<std::string, weft::stage_status_t> statuses_;
};

std::int64_t answered(const nlohmann::json& stage) {
  return stage.at("frames_out").get<std::int64_t>() +
         stage.at("frames_dropped").get<std::int64_t>() +
         stage.at("frames_failed").get<std::int64_t>() +
         stage.at("frames_missing_input").get<std::int64_t>();
}

nlohmann::json status_of(const Lan& lan, const Folder& folder, const std::string& set) {
  const auto result = lan.weft(
      "", {"status", (folder / set).string(), "--json", (folder / "status.json").string()});
  std::printf("%s", result.output.c_str());
  return all_processes(nlohmann::json::parse(read_text_file(folder / "status.json")));
}

void expect_right(const Verdict& verdict) {
  for (const auto& [channel, counts] : verdict.channels) {
    EXPECT_EQ(counts.wrong, 0) << channel;
    EXPECT_EQ(counts.changed, 0) << channel;
    std::string codes;
    for (const auto& [code, count] : counts.codes)
      codes += fmt::format(" code {}: {}", code, count);
    std::printf("%-16s %d of %d frames answered, %d good;%s\n", channel.c_str(), counts.answered,
                verdict.frames, counts.good, codes.c_str());
  }
  for (const auto& fault : verdict.faults) ADD_FAILURE() << fault;
}

}  // namespace

std::string small_set(const std::string& source) {
  std::string text = "name: small\nsources: [RGBD_FRAME]\nprocesses:\n";
  if (!source.empty())
    text += "  - {name: eye, exec: weft-test-source, source: true, " + source + "}\n";
  for (const char* kind : {"mask", "words", "parts"})
    text += fmt::format("  - {{name: {0}, exec: weft-test-stage, with: {{kind: {0}}}}}\n", kind);
  return text;
}

std::string small_set_on_three_hosts(int frames, int bytes, double rate_hz) {
  return fmt::format(R"(name: three
lan: true
sources: [RGBD_FRAME]
processes:
  - {{name: eye, exec: weft-test-source, source: true, host: alpha, camera: left, rate_hz: {0},
     with: {{bytes: {1}, frames: {2}}}}}
  - {{name: mask, exec: weft-test-stage, with: {{kind: mask}}, host: gamma, queue: 1000}}
  - {{name: words, exec: weft-test-stage, with: {{kind: words}}, host: beta, queue: 1000}}
  - {{name: parts, exec: weft-test-stage, with: {{kind: parts}}, host: gamma, queue: 1000}}
)",
                     rate_hz, bytes, frames);
}

void three_hosts(const std::string& set_text, const std::string& local_text, int frames,
                 int per_thousand) {
  const Folder folder;
  write_text_file(folder / "set.yaml", set_text);
  write_text_file(folder / "local.yaml", local_text);
  in_a_world_of_its_own([&] {
    const Lan lan({"alpha", "beta", "gamma"}, folder.path());
    // As weft doctor advises; a stock kernel is deaf for half a minute after some hundred losses.
    if (per_thousand > 0) {
      for (const char* host : {"alpha", "beta", "gamma"}) {
        const auto tuned =
            lan.run(host, {"sh", "-c",
                           "echo 2 > /proc/sys/net/ipv4/ipfrag_time && echo 67108864 > "
                           "/proc/sys/net/ipv4/ipfrag_high_thresh"});
        EXPECT_EQ(tuned.status, 0) << tuned.output;
      }
    }
    const auto set = (folder / "set.yaml").string();
    const pid_t recorder = start_recorder(lan, folder, "set.yaml");
    Listener listener(set);
    // The camera's host first: it waits for the others.
    std::map<std::string, pid_t> ups;
    for (const std::string host : {"alpha", "gamma", "beta"})
      ups[host] =
          lan.start(host, {WEFT_BINARY_DIR "/bin/weft", "up", set}, folder / (host + ".out"));
    // A stage cannot know of frames before the first or after the last that it saw, so these few
    // are not lost.
    constexpr std::int64_t kSpared = 10;
    std::int64_t seq = -1, lost_packets = 0;
    listener.on_message = [&](const BusMessage& message) {
      if (message.channel != "RGBD_FRAME") return;
      if (const auto header = read_frame_header(message.data))
        seq = std::max(seq, header->frame.seq);
    };
    const auto sent = [&](std::int64_t count) {
      while (seq + 1 < count) {
        const auto before = seq;
        if (!listener.wait_for([&] { return seq > before; }, std::chrono::seconds(60)))
          return false;
      }
      return true;
    };
    ASSERT_TRUE(sent(kSpared)) << read_text_file(folder / "alpha.out");
    if (per_thousand > 0)
      for (const char* host : {"beta", "gamma"}) lan.lose(host, per_thousand);
    ASSERT_TRUE(sent(frames - kSpared));
    if (per_thousand > 0) {
      for (const char* host : {"beta", "gamma"}) {
        lost_packets += lan.lost_packets(host);
        lan.lose(host, 0);
      }
    }
    ASSERT_TRUE(sent(frames));
    // Until every deadline (2 s) has passed and every stage has said so.
    listener.listen(milliseconds(4500));
    const auto stages = status_of(lan, folder, "set.yaml");
    for (const auto& [host, pid] : ups)
      EXPECT_EQ(stop_process(pid), 0) << read_text_file(folder / (host + ".out"));
    EXPECT_EQ(stop_process(recorder), 0) << read_text_file(folder / "record.out");
    const auto verdict = judge(folder / "recorded.lcm", folder / "local.yaml", folder.path());
    expect_right(verdict);
    ASSERT_EQ(verdict.frames, frames) << "the switch loses nothing";
    int through = frames;
    for (const auto& process : ProcessSet::from_file(set).processes) {
      if (process.source) continue;
      const auto& status = stages.at(process.name);
      const auto in = status.at("frames_in").get<std::int64_t>();
      EXPECT_EQ(in + status.at("gaps").get<std::int64_t>(), frames) << process.name;
      EXPECT_EQ(in, answered(status)) << process.name;
      for (const auto& port : listener.status(process.name).fingerprints) {
        if (port.direction != weft::type_fingerprint_t::OUTPUT) continue;
        const auto& counts = verdict.channels.at(port.channel);
        EXPECT_EQ(in, counts.answered) << port.channel;
        if (per_thousand == 0) {
          EXPECT_EQ(counts.good, frames) << port.channel;
        }
        through = counts.good;
      }
    }
    EXPECT_TRUE(per_thousand == 0 || lost_packets > 0);
    std::printf(
        "measured: %d frames, %d packets of a thousand lost (%lld): %.1f %% of the frames come "
        "through all stages\n",
        frames, per_thousand, static_cast<long long>(lost_packets), 100.0 * through / frames);
  });
}

void kill_in_turn(const std::string& set_text, int rounds, double back_within_s) {
  const Folder folder;
  write_text_file(folder / "set.yaml", set_text);
  in_a_world_of_its_own([&] {
    const Lan lan({}, folder.path());
    const auto set = ProcessSet::from_file(folder / "set.yaml");
    const pid_t recorder = start_recorder(lan, folder, "set.yaml");
    Listener listener(set.file);
    const auto up = lan.weft("", {"up", set.file.string()});
    ASSERT_EQ(up.status, 0) << up.output;
    const RunFolder running(folder / "switch" / set.name);
    /// Until a frame that came later than a time was answered well by a process.
    const auto answers_after = [&](const std::string& process, std::int64_t after_us) {
      for (const auto end = Clock::now() + std::chrono::seconds(30); Clock::now() < end;) {
        const auto message = listener.next(milliseconds(20));
        if (!message || message->channel != "STAGE_TIMING") continue;
        const auto timing = decode_message<weft::stage_timing_t>(message->data);
        if (timing && timing->stage == process && timing->status_code <= 1 &&
            timing->received_utime > after_us)
          return true;
      }
      return false;
    };
    std::vector<double> back_s;
    for (int round = 0; round < rounds; ++round) {
      for (const auto& process : set.processes) {
        pid_t victim = 0;
        for (const auto& each : running.processes())
          if (each.name == process.name) victim = each.pid;
        ASSERT_GT(victim, 0) << process.name;
        ASSERT_EQ(kill(victim, SIGKILL), 0);
        const auto killed = Clock::now();
        ASSERT_TRUE(answers_after(process.name, stage::now_us()))
            << process.name << " does not come back:\n"
            << lan.weft("", {"logs", process.name}).output;
        back_s.push_back(std::chrono::duration<double>(Clock::now() - killed).count());
        EXPECT_LT(back_s.back(), back_within_s) << process.name << ", round " << round;
      }
    }
    // The whole chain once more, and time for what waits.
    EXPECT_TRUE(answers_after(set.processes.back().name, stage::now_us()));
    listener.listen(milliseconds(2500));
    const auto stages = status_of(lan, folder, "set.yaml");
    for (const auto& process : set.processes) {
      EXPECT_EQ(stages.at(process.name).at("starts"), 1 + rounds) << process.name;
      EXPECT_EQ(stages.at(process.name).at("state"), "running") << process.name;
    }
    EXPECT_EQ(lan.weft("", {"down"}).status, 0);
    EXPECT_EQ(stop_process(recorder), 0) << read_text_file(folder / "record.out");
    expect_right(judge(folder / "recorded.lcm", set.file, folder.path()));
    std::printf("measured: %zu kills, back after %.2f s (median), %.2f s (worst)\n", back_s.size(),
                median(back_s), *std::max_element(back_s.begin(), back_s.end()));
  });
}

void stop_and_go(double stop_s) {
  const Folder folder;
  constexpr double kRate_hz = 20, kBefore_s = 4, kAfter_s = 8;
  const int frames = static_cast<int>(kRate_hz * (kBefore_s + stop_s + kAfter_s));
  // Large frames: those of the pause do not fit a socket's buffer.
  write_text_file(
      folder / "set.yaml",
      small_set(fmt::format("rate_hz: {}, with: {{bytes: 60000, frames: {}}}", kRate_hz, frames)));
  in_a_world_of_its_own([&] {
    const Lan lan({}, folder.path());
    const auto set = (folder / "set.yaml").string();
    Listener listener(set);
    const auto up = lan.weft("", {"up", set});
    ASSERT_EQ(up.status, 0) << up.output;
    // From the measurement of a frame to its detections, ms, by seq.
    std::map<std::int64_t, double> latency_ms;
    std::int64_t most_bytes = 0;
    listener.on_message = [&](const BusMessage& message) {
      most_bytes = std::max(most_bytes, listener.status("words").resident_bytes);
      if (message.channel != "PART_DETECTIONS") return;
      const auto header = read_frame_header(message.data);
      if (header && header->status_code <= 1)
        latency_ms.emplace(header->frame.seq,
                           static_cast<double>(stage::now_us() - header->utime) * 1e-3);
    };
    const auto listen = [&](const auto& until) {
      return listener.wait_for(until, std::chrono::seconds(60));
    };
    const auto newest = [&] { return latency_ms.empty() ? -1 : latency_ms.rbegin()->first; };
    ASSERT_TRUE(listen([&] { return newest() >= kRate_hz * kBefore_s; }));
    const auto before_bytes = listener.status("words").resident_bytes;
    std::vector<double> before;
    for (const auto& [seq, ms] : latency_ms) before.push_back(ms);
    pid_t pid = 0;
    for (const auto& process : RunFolder(folder / "switch" / "small").processes())
      if (process.name == "words") pid = process.pid;
    ASSERT_GT(pid, 0);
    ASSERT_EQ(kill(pid, SIGSTOP), 0);
    const auto stopped = Clock::now();
    listen([&] { return Clock::now() - stopped > std::chrono::duration<double>(stop_s); });
    ASSERT_EQ(kill(pid, SIGCONT), 0);
    ASSERT_TRUE(listen([&] { return newest() >= frames - 3; }));
    listener.listen(milliseconds(3500));
    const auto stages = status_of(lan, folder, "set.yaml");
    const auto& words = stages.at("words");
    const auto in = words.at("frames_in").get<std::int64_t>();
    EXPECT_EQ(in + words.at("gaps").get<std::int64_t>(), frames);
    EXPECT_EQ(in, answered(words));
    const auto dropped = words.at("frames_dropped").get<std::int64_t>();
    EXPECT_GT(dropped, 0);
    std::vector<double> after;
    for (const auto& [seq, ms] : latency_ms)
      if (seq > frames - kRate_hz * 3) after.push_back(ms);
    EXPECT_GT(after.size(), kRate_hz * 3 / 2);
    // As before the pause, but for what else the machine does.
    EXPECT_LT(median(after), 2 * median(before) + 50);
    const auto growth =
        std::max(most_bytes, listener.status("words").resident_bytes) - before_bytes;
    EXPECT_LT(growth, (48 << 20) + kQuarantine_bytes);
    std::printf(
        "measured: stopped for %.0f s of %d frames: %lld dropped, %s missing input, %s gaps; "
        "latency before %.1f ms, afterwards %.1f ms (medians); %.1f MB more memory at most\n",
        stop_s, frames, static_cast<long long>(dropped),
        words.at("frames_missing_input").dump().c_str(), words.at("gaps").dump().c_str(),
        median(before), median(after), static_cast<double>(growth) * 1e-6);
    EXPECT_EQ(lan.weft("", {"down"}).status, 0);
  });
}

namespace {

/// Datagrams that are not LCM's, or only begin like LCM's.
void raw_datagrams(const stage::LcmUrl& url, int count, Random& random) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(url.port));
  inet_pton(AF_INET, url.group.c_str(), &to.sin_addr);
  const unsigned char ttl = 0;
  setsockopt(fd, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
  for (int i = 0; i < count; ++i) {
    std::vector<std::uint8_t> bytes(random.bits() % 1400);
    for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random.bits());
    // LC02: a small message; LC03: a fragment.
    if (i % 3 != 0 && bytes.size() > 24) {
      const char* magic = i % 3 == 1 ? "LC02" : "LC03";
      std::copy(magic, magic + 4, bytes.begin());
      // The first fragment of a message of up to 256 MB, where LCM takes room for it.
      if (i % 3 == 2) {
        bytes[8] = static_cast<std::uint8_t>(bytes[8] % 16);
        bytes[16] = bytes[17] = 0;
      }
    }
    sendto(fd, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&to), sizeof to);
    if (i % 50 == 49) std::this_thread::sleep_for(milliseconds(2));
  }
  close(fd);
}

}  // namespace

void garbage(const std::string& set_text, const std::vector<std::uint8_t>& good_frame,
             int messages) {
  const Folder folder;
  write_text_file(folder / "set.yaml", set_text);
  in_a_world_of_its_own([&] {
    const Lan lan({}, folder.path());
    const auto set = (folder / "set.yaml").string();
    Listener listener(set);
    const auto up = lan.weft("", {"up", set});
    ASSERT_EQ(up.status, 0) << up.output;
    const pid_t recorder = start_recorder(lan, folder, "set.yaml");
    const pid_t spy = lan.start("", {WEFT_BINARY_DIR "/bin/weft", "spy", set, "--duration", "5"},
                                folder / "spy.out");
    listener.listen(milliseconds(1200));
    std::set<std::string> stages, outputs;
    std::map<std::string, std::set<std::string>> readers = {
        {"RGBD_FRAME", {}}, {"STAGE_STATUS", {}}, {"STAGE_TIMING", {}}};
    for (const auto& process : ProcessSet::from_file(set).processes) {
      stages.insert(process.name);
      readers["CLOCK_PING"].insert(process.name);
      if (process.source) {
        readers["CAPTURE_TRIGGER"].insert(process.name);
        continue;
      }
      for (const auto& port : listener.status(process.name).fingerprints) {
        auto& of_channel = readers[port.channel];
        if (port.direction == weft::type_fingerprint_t::OUTPUT)
          outputs.insert(port.channel);
        else
          of_channel.insert(process.name);
      }
    }
    ASSERT_GE(outputs.size(), stages.size() - 1);
    // One good message of every channel.
    std::map<std::string, std::vector<std::uint8_t>> good;
    listener.on_message = [&](const BusMessage& message) {
      if (message.channel.starts_with("STAGE_")) good[message.channel] = message.data;
    };
    const auto answer_to = [&](std::int64_t seq, std::chrono::seconds limit) {
      std::set<std::string> heard;
      for (const auto end = Clock::now() + limit; Clock::now() < end;) {
        listener.publish("RGBD_FRAME", rename_frame(good_frame, seq, seq * 100'000));
        for (const auto again = Clock::now() + milliseconds(500); Clock::now() < again;) {
          const auto message = listener.next(milliseconds(20));
          if (!message) continue;
          const auto header = read_frame_header(message->data);
          if (header && header->frame.seq == seq && header->status_code <= 1) {
            good[message->channel] = message->data;
            if (outputs.contains(message->channel)) heard.insert(message->channel);
            if (heard == outputs) return true;
          }
        }
      }
      return false;
    };
    ASSERT_TRUE(answer_to(0, std::chrono::seconds(20)));
    listener.listen(milliseconds(1200));
    listener.on_message = {};
    weft::header_t trigger{};
    trigger.camera = "camera";
    good["CAPTURE_TRIGGER"] = good["CLOCK_PING"] = encode_message(trigger);
    const auto counted = [&](const std::string& stage) {
      const auto& status = listener.status(stage);
      return status.decode_failures + status.invalid_inputs;
    };
    std::map<std::string, std::int64_t> expected, resident;
    for (const auto& stage : stages) {
      expected[stage] = counted(stage);
      resident[stage] = listener.status(stage).resident_bytes;
    }
    Random random(5);
    const auto random_bytes = [&](std::size_t size) {
      std::vector<std::uint8_t> bytes(size);
      for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random.bits());
      return bytes;
    };
    // No more on the way than a socket's buffer holds, so that every one of them arrives.
    const int batch = std::min(1000, stage::receive_buffer_limit() / 4096);
    const auto all_counted = [&] {
      return listener.wait_for(
          [&] {
            return std::all_of(expected.begin(), expected.end(), [&](const auto& each) {
              return counted(each.first) >= each.second;
            });
          },
          std::chrono::seconds(20));
    };
    std::int64_t frame = 2;
    for (const auto& [channel, of_channel] : readers) {
      const auto& sample = good.at(channel);
      for (int i = 0; i < messages; ++i) {
        std::vector<std::uint8_t> bytes;
        const bool oversized = i % 50 == 7;
        if (oversized && channel == "RGBD_FRAME") {
          // It decodes, and says what it says; only no message may be so long.
          auto large = *decode_message<weft::rgbd_frame_t>(good_frame);
          large.header.seq = frame++;
          large.data.resize(200'000);
          large.data_size = 200'000;
          bytes = encode_message(large);
        } else if (oversized) {
          bytes = sample;
          bytes.resize(200'000);
        } else if (i % 3 == 0) {
          bytes = random_bytes(random.bits() % 600);
        } else if (i % 3 == 1) {
          const auto size = random.bits() % std::min<std::size_t>(sample.size(), 5000);
          bytes.assign(sample.begin(), sample.begin() + static_cast<std::ptrdiff_t>(size));
        } else {
          bytes = random_bytes(8 + random.bits() % 600);
          std::copy(sample.begin(), sample.begin() + 8, bytes.begin());
        }
        listener.publish(channel, bytes);
        for (const auto& stage : of_channel) ++expected[stage];
        // An oversized message is a socket's buffer full by itself.
        if (oversized) std::this_thread::sleep_for(milliseconds(5));
        if (i % batch == batch - 1) {
          ASSERT_TRUE(all_counted()) << channel;
        }
      }
      ASSERT_TRUE(all_counted()) << channel;
    }
    raw_datagrams(url_of(ProcessSet::from_file(set)), 3000, random);
    listener.listen(milliseconds(3500));
    for (const auto& [stage, count] : expected) {
      EXPECT_EQ(counted(stage), count) << stage;
      const auto growth = listener.status(stage).resident_bytes - resident[stage];
      EXPECT_LT(growth, (16 << 20) + kQuarantine_bytes) << stage;
      std::printf("measured: %s counted %lld of %lld, %.1f MB more memory\n", stage.c_str(),
                  static_cast<long long>(counted(stage)), static_cast<long long>(count),
                  static_cast<double>(growth) * 1e-6);
    }
    // The first one may come too late for a stage behind one that waits for what never came.
    const auto begun = frame;
    while (frame < begun + 4 && !answer_to(frame, std::chrono::seconds(5))) ++frame;
    EXPECT_LT(frame, begun + 4) << "no good frame is answered after all the garbage";
    const auto processes = status_of(lan, folder, "set.yaml");
    for (const auto& stage : stages) EXPECT_EQ(processes.at(stage).at("starts"), 1) << stage;
    int status = 0;
    waitpid(spy, &status, 0);
    EXPECT_EQ(status, 0) << read_text_file(folder / "spy.out");
    EXPECT_EQ(stop_process(recorder), 0) << read_text_file(folder / "record.out");
    stage::LogReader log((folder / "recorded.lcm").string());
    int events = 0;
    for (stage::LogEvent event; log.next(event);) ++events;
    EXPECT_GE(events, messages * static_cast<int>(readers.size())) << "recorded as it came";
    EXPECT_EQ(log.damage_count(), 0);
    EXPECT_EQ(lan.weft("", {"down"}).status, 0);
  });
}

void soak(const std::string& set_text, const std::vector<std::vector<std::uint8_t>>& messages,
          int frames) {
  const Folder folder;
  write_text_file(folder / "set.yaml", set_text);
  in_a_world_of_its_own([&] {
    const Lan lan({}, folder.path());
    const auto set = ProcessSet::from_file(folder / "set.yaml");
    const auto last = set.processes.back().name;
    Listener listener(set.file);
    const auto up = lan.weft("", {"up", set.file.string()});
    ASSERT_EQ(up.status, 0) << up.output;
    constexpr int kQuarters = 4;
    std::vector<double> latency_ms[kQuarters], cpu_us[kQuarters];
    std::map<std::string, std::int64_t> resident[kQuarters];  // at the end of each
    int failed = 0;
    for (std::int64_t seq = 0; seq < frames; ++seq) {
      const auto quarter = static_cast<std::size_t>(seq * kQuarters / frames);
      const auto message = rename_frame(messages[static_cast<std::size_t>(seq) % messages.size()],
                                        seq, seq * 100'000);
      const auto sent = Clock::now();
      listener.publish("RGBD_FRAME", message);
      bool done = false;
      double cpu = 0;  // of all stages; the last one's timing comes last
      while (!done && Clock::now() - sent < std::chrono::seconds(10)) {
        const auto heard = listener.next(milliseconds(20));
        if (!heard || heard->channel != "STAGE_TIMING") continue;
        const auto timing = decode_message<weft::stage_timing_t>(heard->data);
        if (!timing || timing->header.seq != seq) continue;
        cpu += static_cast<double>(timing->cpu_us);
        done = timing->stage == last;
        if (done && timing->status_code > 1) ++failed;
      }
      if (!done) ++failed;
      cpu_us[quarter].push_back(cpu);
      latency_ms[quarter].push_back(
          std::chrono::duration<double, std::milli>(Clock::now() - sent).count());
      for (const auto& process : set.processes)
        resident[quarter][process.name] = listener.status(process.name).resident_bytes;
    }
    EXPECT_EQ(failed, 0);
    for (int quarter = 0; quarter < kQuarters; ++quarter) {
      std::printf(
          "measured: quarter %d: latency %.2f ms (quickest tenth %.2f), CPU of all stages %.0f us",
          quarter, median(latency_ms[quarter]), quantile(latency_ms[quarter], 0.1),
          median(cpu_us[quarter]));
      for (const auto& [stage, bytes] : resident[quarter])
        std::printf(", %s %.2f MB", stage.c_str(), static_cast<double>(bytes) * 1e-6);
      std::printf("\n");
    }
    // The caches are full after the first quarter, if that is 256 frames or more.
    for (const auto& [stage, bytes] : resident[kQuarters - 1])
      EXPECT_LT(bytes - resident[0][stage], (2 << 20) + kQuarantine_bytes) << stage;
    // A drift slows every frame down; what else the machine does, not the quickest ones.
    EXPECT_LT(quantile(latency_ms[3], 0.1), 2 * quantile(latency_ms[0], 0.1) + 5);
    EXPECT_LT(median(cpu_us[3]), 1.5 * median(cpu_us[0]) + 500);
    EXPECT_EQ(lan.weft("", {"down"}).status, 0);
  });
}

}  // namespace weft::test_hosts
