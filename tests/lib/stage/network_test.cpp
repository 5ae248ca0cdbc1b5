#include <fcntl.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/wait.h>

#include <chrono>
#include <csignal>
#include <lcm/lcm-cpp.hpp>
#include <random>
#include <thread>

#include "fake_stage.hpp"
#include "stage/in_process.hpp"
#include "stage/lcm_url.hpp"
#include "stage/log.hpp"
#include "stage/net_namespace.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

/// Real processes over real LCM, in a network namespace of this test's own.
namespace weft::stage {
namespace {

using namespace fake;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

std::string g_why_not;  // empty: in a network of our own
constexpr auto kPatience = std::chrono::seconds(20);
// What a stock kernel grants; the tests must pass with it.
constexpr const char* kStockUrl = "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=212992";

/// A process of the test program stage_process.
class Child {
 public:
  explicit Child(std::vector<std::string> args, bool without_network = false) {
    args.insert(args.begin(), WEFT_BINARY_DIR "/bin/stage_process");
    std::vector<char*> argv;
    for (auto& arg : args) argv.push_back(arg.data());
    argv.push_back(nullptr);
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) throw Error("pipe");
    pid_ = fork();
    if (pid_ == 0) {
      dup2(ends[1], STDOUT_FILENO);
      dup2(ends[1], STDERR_FILENO);
      if (without_network && unshare(CLONE_NEWNET) != 0) _exit(99);
      execv(argv[0], argv.data());
      _exit(127);
    }
    close(ends[1]);
    reader_ = std::thread([this, fd = ends[0]] {
      char buffer[4096];
      for (ssize_t n; (n = read(fd, buffer, sizeof buffer)) > 0;)
        output_.append(buffer, static_cast<std::size_t>(n));
      close(fd);
    });
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child() {
    if (pid_ > 0) end(SIGKILL);
  }
  void signal(int number) const { kill(pid_, number); }
  /// The exit status, or minus the signal. output() is complete afterwards.
  int wait() {
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    reader_.join();
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }
  int end(int number) {
    signal(number);
    return wait();
  }
  const std::string& output() const { return output_; }
  pid_t pid() const { return pid_; }

 private:
  pid_t pid_ = -1;
  std::thread reader_;
  std::string output_;
};

/// What a player and a logger see.
class Network : public testing::Test {
 protected:
  void SetUp() override {
    if (!g_why_not.empty()) GTEST_SKIP() << "no network namespace of our own: " << g_why_not;
    lcm_ = connect(LcmUrl::parse(kStockUrl));
    lcm_->subscribeFunction(".*", &Network::on_message, this)->setQueueCapacity(0);
  }

  void send(const std::string& channel, const Bytes& bytes) {
    ASSERT_EQ(lcm_->publish(channel, bytes.data(), static_cast<unsigned>(bytes.size())), 0);
  }
  template <class Message>
  void send(const std::string& channel, const Message& m) {
    send(channel, encode(m));
  }
  void listen(milliseconds time) {
    const auto end = steady_clock::now() + time;
    while (steady_clock::now() < end) lcm_->handleTimeout(1);
  }
  template <class Condition>
  bool wait_for(Condition condition, milliseconds limit = kPatience) {
    const auto end = steady_clock::now() + limit;
    while (!condition()) {
      if (steady_clock::now() > end) return false;
      lcm_->handleTimeout(5);
    }
    return true;
  }
  /// Until process pid says that it runs.
  bool ready(const Child& child) {
    return wait_for([&] {
      const auto* status = last_status(child.pid());
      return status && status->state == stage_status_t::RUNNING;
    });
  }
  const stage_status_t* last_status(pid_t pid) const {
    for (auto it = statuses_.rbegin(); it != statuses_.rend(); ++it)
      if (it->pid == pid) return &*it;
    return nullptr;
  }
  /// The next STAGE_STATUS of a process that fulfils a condition.
  template <class Condition>
  bool status_comes(const Child& child, Condition condition) {
    return wait_for([&] {
      const auto* status = last_status(child.pid());
      return status && condition(*status);
    });
  }
  std::size_t answers(const std::string& channel, std::int64_t seq) const {
    const auto it = answers_.find({channel, seq});
    return it == answers_.end() ? 0 : it->second.size();
  }
  words_t words(std::int64_t seq) const {
    return decode<words_t>(answers_.at({"WORDS", seq}).front());
  }

  std::unique_ptr<lcm::LCM> lcm_;
  std::map<std::pair<std::string, std::int64_t>, std::vector<Bytes>> answers_;
  std::map<std::int64_t, int> frame_messages_;
  std::vector<stage_status_t> statuses_;
  std::vector<stage_timing_t> timings_;

 private:
  static void on_message(const lcm::ReceiveBuffer* buffer, const std::string& channel,
                         Network* self) {
    self->keep(buffer, channel);
  }
  void keep(const lcm::ReceiveBuffer* buffer, const std::string& channel) {
    const auto* data = static_cast<const std::uint8_t*>(buffer->data);
    const Bytes bytes(data, data + buffer->data_size);
    if (channel.starts_with("WORDS"))
      answers_[{channel, decode<words_t>(bytes).header.seq}].push_back(bytes);
    if (channel == "GRASPS")
      answers_[{channel, decode<grasps_t>(bytes).header.seq}].push_back(bytes);
    if (channel == "RGBD_FRAME") ++frame_messages_[decode<rgbd_frame_t>(bytes).header.seq];
    if (channel == "STAGE_STATUS") {
      const auto status = decode<stage_status_t>(bytes);
      if (status.pid > 0) statuses_.push_back(status);
    }
    if (channel == "STAGE_TIMING") {
      const auto timing = decode<stage_timing_t>(bytes);
      if (!timing.stage.empty()) timings_.push_back(timing);
    }
  }
};

TEST_F(Network, AnswersThenStopsCleanly) {
  Child child({"counter", "--url", kStockUrl, "--name", "c1", "--map", "WORDS=WORDS@b"});
  ASSERT_TRUE(ready(child)) << "no STAGE_STATUS";
  send("RGBD_FRAME", frame(header(0), 150'000));
  ASSERT_TRUE(wait_for([&] { return answers("WORDS@b", 0) == 1; }));
  EXPECT_EQ(decode<words_t>(answers_.at({"WORDS@b", 0})[0]).vocabulary_size, 150'000);
  ASSERT_TRUE(wait_for([&] { return timings_.size() == 1; }));
  EXPECT_EQ(timings_[0].stage, "c1");
  EXPECT_EQ(encode(timings_[0].header), encode(header(0)));
  EXPECT_LE(timings_[0].received_utime, timings_[0].started_utime);
  EXPECT_LE(timings_[0].finished_utime, timings_[0].published_utime);
  ASSERT_TRUE(status_comes(child, [](const auto& s) { return s.frames_out == 1; }));
  const pid_t pid = child.pid();
  EXPECT_EQ(child.end(SIGTERM), 0);
  EXPECT_TRUE(wait_for([&] { return last_status(pid)->state == stage_status_t::STOPPING; }));
}

TEST_F(Network, FinishesTheCurrentFrameBeforeItStops) {
  Child child({"counter", "--url", kStockUrl, "--set", "delay_ms=400"});
  ASSERT_TRUE(ready(child));
  send("RGBD_FRAME", frame(header(0)));
  listen(milliseconds(100));
  EXPECT_EQ(child.end(SIGINT), 0);
  EXPECT_TRUE(wait_for([&] { return answers("WORDS", 0) == 1; }, milliseconds(1000)));
}

TEST_F(Network, LockStepSurvivesKilledStages) {
  constexpr int kFrames = 40;
  const std::vector<std::string> args{"joiner",      "--url", kStockUrl,
                                      "--lock-step", "--set", "delay_ms=5"};
  const auto foreground = [](std::int64_t seq) {
    auto m = message<foreground_t>(header(seq));
    m.garment_px = static_cast<std::int32_t>(seq * 7);
    return m;
  };
  auto child = std::make_unique<Child>(args);
  ASSERT_TRUE(ready(*child));
  std::mt19937 random(2);
  for (int seq = 0; seq < kFrames; ++seq) {
    if (seq % 10 == 5) {  // in the middle of a frame
      send("RGBD_FRAME", frame(header(seq)));
      child->end(SIGKILL);
      child = std::make_unique<Child>(args);
      ASSERT_TRUE(ready(*child));
    }
    int attempts = 0;
    while (answers("WORDS", seq) == 0 || answers("GRASPS", seq) == 0) {
      ASSERT_LT(++attempts, 20);
      // A lossy, doubling network.
      for (unsigned copies = random() % 3; copies > 0; --copies)
        send("RGBD_FRAME", frame(header(seq)));
      for (unsigned copies = random() % 3; copies > 0; --copies)
        send("FOREGROUND", foreground(seq));
      wait_for([&] { return answers("WORDS", seq) > 0 && answers("GRASPS", seq) > 0; },
               milliseconds(200));
    }
  }
  listen(milliseconds(100));
  // The same bytes as in one process, however often it was asked and killed.
  InProcess set;
  set.add(std::make_shared<FakeStage>(joiner()));
  std::map<std::int64_t, Bytes> expected;
  set.observe([&](const std::string& channel, const Bytes& bytes) {
    if (channel == "WORDS") expected[decode<words_t>(bytes).header.seq] = bytes;
  });
  for (int seq = 0; seq < kFrames; ++seq) {
    set.inject("RGBD_FRAME", encode(frame(header(seq))));
    set.inject("FOREGROUND", encode(foreground(seq)));
  }
  set.run();
  for (int seq = 0; seq < kFrames; ++seq)
    for (const Bytes& bytes : answers_.at({"WORDS", seq})) EXPECT_EQ(bytes, expected.at(seq));
}

TEST_F(Network, LiveAnswersEveryFrameThatReachedIt) {
  Child child({"joiner", "--url", kStockUrl, "--deadline-ms", "1000", "--queue", "1000"});
  ASSERT_TRUE(ready(child));
  std::mt19937 random(4);
  std::map<std::int64_t, bool> complete;
  for (int seq = 0; seq < 100; ++seq) {
    const unsigned frames = random() % 3;
    const unsigned masks = random() % 3;
    for (unsigned i = 0; i < frames; ++i) send("RGBD_FRAME", frame(header(seq)));
    for (unsigned i = 0; i < masks; ++i) send("FOREGROUND", message<foreground_t>(header(seq)));
    if (frames + masks > 0) complete[seq] = frames > 0 && masks > 0;
    listen(milliseconds(5));
  }
  for (const auto& [seq, whole] : complete) {
    ASSERT_TRUE(wait_for([&, s = seq] { return answers("WORDS", s) > 0; })) << "frame " << seq;
    const auto m = words(seq);
    EXPECT_EQ(m.status.code, whole ? status_t::OK : status_t::MISSING_INPUT) << "frame " << seq;
    for (const Bytes& bytes : answers_.at({"WORDS", seq})) EXPECT_EQ(bytes, encode(m));
  }
  ASSERT_TRUE(wait_for([&] { return timings_.size() >= complete.size(); }));
  std::map<std::int64_t, int> timings;
  for (const auto& timing : timings_) ++timings[timing.header.seq];
  for (const auto& [seq, whole] : complete) EXPECT_EQ(timings[seq], 1) << "frame " << seq;
  const auto reached = static_cast<std::int64_t>(complete.size());
  EXPECT_TRUE(status_comes(child, [&](const auto& s) {
    return s.frames_in == reached && s.frames_out + s.frames_missing_input == reached;
  }));
  EXPECT_EQ(last_status(child.pid())->gaps,
            complete.rbegin()->first - complete.begin()->first + 1 - reached);
}

TEST_F(Network, SlowStageDropsButAnswers) {
  Child child({"counter", "--url", kStockUrl, "--queue", "2", "--set", "delay_ms=60"});
  ASSERT_TRUE(ready(child));
  for (int seq = 0; seq < 60; ++seq) {
    send("RGBD_FRAME", frame(header(seq), 100'000));
    listen(milliseconds(10));
  }
  int dropped = 0;
  for (int seq = 0; seq < 60; ++seq) {
    ASSERT_TRUE(wait_for([&] { return answers("WORDS", seq) > 0; })) << "frame " << seq;
    EXPECT_EQ(answers("WORDS", seq), 1u);
    dropped += words(seq).status.code == status_t::DROPPED;
  }
  EXPECT_GT(dropped, 20);
  EXPECT_EQ(words(59).status.code, status_t::OK);  // the newest is never dropped
}

TEST_F(Network, LateJoinerBeginsWhereItIs) {
  for (int seq = 0; seq < 5; ++seq) send("RGBD_FRAME", frame(header(seq)));
  Child child({"counter", "--url", kStockUrl, "--queue", "10"});
  ASSERT_TRUE(ready(child));
  for (int seq = 5; seq < 10; ++seq) send("RGBD_FRAME", frame(header(seq)));
  ASSERT_TRUE(wait_for([&] { return answers("WORDS", 9) > 0; }));
  EXPECT_EQ(answers("WORDS", 4), 0u);
  EXPECT_TRUE(status_comes(child, [](const auto& s) { return s.frames_out == 5 && s.gaps == 0; }));
}

TEST_F(Network, SurvivesGarbageOnEveryChannel) {
  Child child({"joiner", "--url", kStockUrl});
  ASSERT_TRUE(ready(child));
  std::mt19937 random(9);
  const Bytes good = encode(frame(header(0), 200));
  int sent = 0;
  for (int i = 0; i < 300; ++i) {
    for (const std::string channel : {"RGBD_FRAME", "FOREGROUND", "WORDS", "GRASPS", "STAGE_TIMING",
                                      "STAGE_STATUS", "CAPTURE_TRIGGER", "OTHER"}) {
      Bytes bytes = good;
      if (i % 3 == 0) bytes.assign(random() % 70'000, static_cast<std::uint8_t>(random()));
      if (i % 3 == 1) bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
      if (i % 3 == 2) bytes.resize(random() % bytes.size());
      send(channel, bytes);
      sent += channel == "FOREGROUND";
    }
    listen(milliseconds(2));
  }
  send("RGBD_FRAME", frame(header(0, 99)));
  send("FOREGROUND", message<foreground_t>(header(0, 99)));
  EXPECT_TRUE(status_comes(child, [&](const auto& s) { return s.decode_failures >= sent + 200; }));
  EXPECT_TRUE(wait_for([&] {
    for (const Bytes& bytes : answers_[{"WORDS", 0}]) {
      const auto m = decode<words_t>(bytes);
      if (m.header.session == 99 && m.status.code == status_t::OK) return true;
    }
    return false;
  }));
  EXPECT_EQ(child.end(SIGTERM), 0);
}

TEST_F(Network, SourceFeedsAStageWithStockBuffers) {
  // Ten parts a frame, slow enough for a busy machine to keep up.
  Child stage({"counter", "--url", kStockUrl, "--queue", "100", "--deadline-ms", "20000"});
  ASSERT_TRUE(ready(stage));
  Child source({"source", "--url", kStockUrl, "--count", "4", "--session", "4", "--camera", "top",
                "--part-pause-us", "20000", "--set", "data_bytes=1500000", "--set", "fail_at=2"});
  for (int seq = 0; seq < 4; ++seq) {
    ASSERT_TRUE(wait_for([&] { return answers("WORDS", seq) > 0; })) << "frame " << seq;
    const auto m = words(seq);
    EXPECT_EQ(m.header.camera, "top");
    EXPECT_EQ(m.header.session, 4);
    EXPECT_EQ(m.vocabulary_size, seq == 2 ? 0 : 1'500'000);
    EXPECT_EQ(m.status.code, seq == 2 ? status_t::MISSING_INPUT : status_t::OK);
  }
  const pid_t pid = source.pid();
  EXPECT_EQ(source.wait(), 1);  // a frame could not be read
  EXPECT_NE(source.output().find("1 of 4 frames"), std::string::npos) << source.output();
  EXPECT_TRUE(wait_for([&] {
    const auto* status = last_status(pid);
    return status && status->state == stage_status_t::STOPPING && status->frames_in == 4 &&
           status->frames_out == 3 && status->frames_failed == 1;
  }));
}

TEST_F(Network, SourceFiresOnceForEachTrigger) {
  Child source({"source", "--url", kStockUrl, "--trigger", "message", "--camera", "top"});
  ASSERT_TRUE(ready(source));
  listen(milliseconds(100));
  EXPECT_TRUE(frame_messages_.empty());
  send("CAPTURE_TRIGGER", header(0, 1, "top"));
  ASSERT_TRUE(wait_for([&] { return frame_messages_[0] == 1; }));
  send("CAPTURE_TRIGGER", header(0, 1, "top"));    // a repeat
  send("CAPTURE_TRIGGER", header(1, 1, "other"));  // for somebody else
  send("CAPTURE_TRIGGER", Bytes{1, 2, 3});
  listen(milliseconds(200));
  send("CAPTURE_TRIGGER", header(2, 1, ""));  // for all
  ASSERT_TRUE(wait_for([&] { return frame_messages_[1] == 1; }));
  EXPECT_EQ(frame_messages_[0], 1);
  EXPECT_EQ(frame_messages_[2], 0);
  EXPECT_TRUE(status_comes(source, [](const auto& s) {
    return s.frames_out == 2 && s.repeats == 1 && s.decode_failures == 1;
  }));
  EXPECT_EQ(source.end(SIGTERM), 0);
}

TEST_F(Network, SingleShotEnds) {
  Child source({"source", "--url", kStockUrl, "--trigger", "single"});
  EXPECT_EQ(source.wait(), 0);
  EXPECT_TRUE(wait_for([&] { return frame_messages_[0] == 1; }));
  EXPECT_EQ(frame_messages_.size(), 1u);
}

TEST_F(Network, SaysWhatIsWrong) {
  const auto run = [](std::vector<std::string> args, int status, const std::string& text) {
    Child child(std::move(args));
    EXPECT_EQ(child.wait(), status) << child.output();
    EXPECT_NE(child.output().find(text), std::string::npos) << child.output();
  };
  run({"counter", "--no-such-option"}, 2, "no-such-option");
  run({"counter", "--queue", "0"}, 2, "--queue");
  run({"counter", "--help"}, 0, "--lock-step");
  run({"counter", "--version"}, 0, "0.");
  run({"counter", "--print-settings"}, 0, "delay_ms: 0");
  run({"counter", "--set", "no_such_key=1"}, 1, "no_such_key");
  run({"counter", "--set", "delay_ms=-3"}, 1, "delay_ms");
  run({"counter", "--settings", "/nonexistent.yaml"}, 1, "/nonexistent.yaml");
  run({"counter", "--map", "NO_SUCH=X"}, 1, "NO_SUCH");
  run({"counter", "--map", "RGBD_FRAME"}, 1, "CHANNEL=OTHER");
  run({"counter", "--url", "udpm://10.0.0.1:7667"}, 1, "10.0.0.1");
  run({"source", "--camera", ""}, 1, "camera");
}

TEST_F(Network, NamesTheRemedyWithoutAMulticastRoute) {
  Child child({"counter"}, true);
  EXPECT_EQ(child.wait(), 1) << child.output();
  EXPECT_NE(child.output().find("ip route add 224.0.0.0/4 dev lo"), std::string::npos)
      << child.output();
}

TEST_F(Network, PrivateNetworkCarriesMulticast) {
  std::string why_not;
  EXPECT_TRUE(multicast_works(why_not)) << why_not;
}

}  // namespace
}  // namespace weft::stage

int main(int argc, char** argv) {
  if (!weft::stage::enter_private_network(weft::stage::g_why_not) && weft::stage::g_why_not.empty())
    weft::stage::g_why_not = "unknown";
  testing::InitGoogleTest(&argc, argv);
  return RUN_ALL_TESTS();
}
