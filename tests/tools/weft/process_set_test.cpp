#include "tools/weft/process_set.hpp"

#include <gtest/gtest.h>

#include <fstream>

#include "base/error.hpp"

namespace weft {
namespace {

class ProcessSetTest : public testing::Test {
 protected:
  ProcessSetTest() {
    folder_ = std::filesystem::path(testing::TempDir()) / "process_set_test";
    std::filesystem::create_directories(folder_ / "sets");
    std::filesystem::create_directories(folder_ / "stages");
    std::ofstream(folder_ / "stages" / "words.yaml") << "work_ms: 1\n";
  }
  ProcessSet read(const std::string& text) const {
    return ProcessSet::from_text(text, folder_ / "sets" / "x.yaml");
  }
  std::string error(const std::string& text) const {
    try {
      read(text);
    } catch (const Error& e) {
      return std::string(e.what()).substr((folder_ / "sets/").string().size());
    }
    return "no error";
  }
  std::filesystem::path folder_;
};

TEST_F(ProcessSetTest, ReadsEveryKey) {
  const auto set = read(R"(name: two-of-them
mode: lock-step
lan: true
lcm: {ttl: 2, group: 239.1.2.3, port: 7700, prefix: robot-1, receive_buffer: 1000000}
sources: [RGBD_FRAME]
log_bytes: 50000
processes:
  - {name: mask, exec: weft-mask}
  - name: words@fast
    exec: ../bin/words
    settings: ../stages/words.yaml
    with: {grid: {step_px: 6, list: [1, 2]}, name: "a b", text: "it: # is"}
    map: {WORDS_SIFT: "WORDS_SIFT@fast"}
    host: robot
    queue: 3
    deadline_ms: 500
    stop_wait_s: 9
  - {name: eye, exec: weft-capture, source: true, camera: left, trigger: message, rate_hz: 2.5}
)");
  EXPECT_EQ(set.name, "two-of-them");
  EXPECT_TRUE(set.lock_step);
  EXPECT_TRUE(set.lan);
  EXPECT_EQ(set.ttl, 2);
  EXPECT_EQ(set.prefix, "robot-1");
  EXPECT_EQ(set.group, "239.1.2.3");
  EXPECT_EQ(set.port, 7700);
  EXPECT_EQ(set.receive_buffer, 1000000);
  EXPECT_EQ(set.log_bytes, 50000);
  ASSERT_EQ(set.processes.size(), 3u);
  const auto& words = set.processes[1];
  EXPECT_EQ(words.settings, folder_ / "stages" / "words.yaml");
  EXPECT_EQ(words.with, (std::vector<std::string>{"grid.step_px=6", "grid.list=[1, 2]", "name=a b",
                                                  "text=\"it: # is\""}));
  EXPECT_EQ(with_places(words, "error: --set name=a b: unknown key 'name'; --set name=b: other"),
            "error: " + set.file.string() + ":12: unknown key 'name'; --set name=b: other");
  EXPECT_EQ(words.map.at("WORDS_SIFT"), "WORDS_SIFT@fast");
  EXPECT_EQ(words.host, "robot");
  EXPECT_EQ(words.queue, 3);
  EXPECT_EQ(words.deadline_ms, 500);
  EXPECT_EQ(words.stop_wait_s, 9);
  EXPECT_EQ(set.processes[2].camera, "left");
  EXPECT_EQ(set.processes[2].trigger, "message");
  EXPECT_EQ(set.processes[2].rate_hz, 2.5);
}

TEST_F(ProcessSetTest, DefaultsAreLiveAndStayOnThisHost) {
  const auto set = read("sources: [RGBD_FRAME]\nprocesses: [{name: a, exec: b}]\n");
  EXPECT_EQ(set.name, "x");
  EXPECT_FALSE(set.lock_step);
  EXPECT_EQ(set.ttl, 0);
  EXPECT_EQ(read("lan: true\nsources: [A]\nprocesses: [{name: a, exec: b}]\n").ttl, 1);
}

TEST_F(ProcessSetTest, ErrorsNameFileLineAndWhatWasExpected) {
  const std::string tail = "\nsources: [RGBD_FRAME]\nprocesses:\n  - {name: a, exec: b}\n";
  EXPECT_EQ(error("name: x\nmod: live" + tail).substr(0, 65),
            "x.yaml:2: unknown key 'mod' in the process set; expected one of: ");
  EXPECT_EQ(error("mode: fast" + tail), "x.yaml:1: mode is 'fast'; expected live or lock-step");
  EXPECT_EQ(error("lcm: {ttl: 300}" + tail),
            "x.yaml:1: ttl is 300; expected a whole number from 0 to 255");
  EXPECT_EQ(error("lcm: {ttl: 1}" + tail),
            "x.yaml:1: ttl is 1, but messages leave this host only when the set says lan: true "
            "(which makes the ttl 1)");
  EXPECT_EQ(error("lan: true\nlcm: {ttl: 0}" + tail),
            "x.yaml:2: ttl is 0, but the set says lan: true; leave ttl out");
  EXPECT_EQ(error("lcm: {prefix: a/b}" + tail),
            "x.yaml:1: the prefix 'a/b' must be 1 to 24 letters, digits, _ or -");
  EXPECT_EQ(error("sources: [A]\nprocesses:\n  - {name: a, exec: b, trigger: single}"),
            "x.yaml:3: trigger is for a process with source: true");
  EXPECT_EQ(error("sources: [A]\nprocesses:\n  - {name: a, exec: b, source: true, trigger: never}"),
            "x.yaml:3: trigger is 'never'; expected continuous, single or message");
  EXPECT_EQ(error("lcm: {ttl: near}" + tail),
            "x.yaml:1: ttl of lcm must be a whole number from 0 to 255");
  EXPECT_EQ(error("lcm: {group: 10.0.0.1}" + tail),
            "x.yaml:1: group is '10.0.0.1'; expected 224.0.0.0 to 239.255.255.255");
  EXPECT_EQ(error("name: x\nname: y" + tail),
            "x.yaml:2: key 'name' stands twice in the process set");
  EXPECT_EQ(
      error("sources: [RGBD_FRAME]\nprocesses:\n  - {name: a, exec: b}\n  - {name: a, exec: c}"),
      "x.yaml:4: two processes are named 'a'");
  EXPECT_EQ(error("sources: [RGBD_FRAME]\nprocesses:\n  - {name: a}"),
            "x.yaml:3: a process has no key 'exec'; expected a program beside weft, or a path");
  EXPECT_EQ(
      error("sources: [RGBD_FRAME]\nprocesses:\n  - name: a\n    exec: b\n    sett: c"),
      "x.yaml:5: unknown key 'sett' in a process; expected one of: camera, deadline_ms, exec, "
      "host, map, name, queue, rate_hz, settings, source, stop_wait_s, trigger, with");
  EXPECT_NE(error("sources: [RGBD_FRAME]\nprocesses:\n  - {name: a, exec: b, settings: no.yaml}")
                .find("x.yaml:3: settings file "),
            std::string::npos);
  EXPECT_EQ(error("sources: ['A B']\nprocesses: [{name: a, exec: b}]"),
            "x.yaml:1: 'A B' is not a channel: 1 to 63 letters, digits, _ @ - or .");
  EXPECT_NE(error("processes: [{name: a, exec: b}]").find("no source channels"), std::string::npos);
  EXPECT_NE(error("sources: [A]\nprocesses: []").find("at least one process"), std::string::npos);
  EXPECT_EQ(error("{[a]: b}"), "x.yaml:1: a key of the process set must be a word");
  EXPECT_EQ(error("sources: [A]\nprocesses:\n  - {name: a, exec: b, with: {[c]: 1}}"),
            "x.yaml:3: a key of a process must be a word");
  EXPECT_NE(error("a: [").find("x.yaml:"), std::string::npos);
  EXPECT_NE(error("just text").find("must be a map"), std::string::npos);
}

TEST_F(ProcessSetTest, NamesWhatIsMissing) {
  auto set = read("sources: [RGBD_FRAME]\nprocesses: [{name: a, exec: weft-no-such-program}]\n");
  EXPECT_THROW(find_program(set, set.processes[0]), Error);
  EXPECT_THROW(set.find("b"), Error);
  EXPECT_EQ(set.find("a").exec, "weft-no-such-program");
  EXPECT_THROW(ProcessSet::from_file(folder_ / "none.yaml"), Error);
}

TEST_F(ProcessSetTest, CommandLinesCarryWhatTheSetSays) {
  auto set = read(
      "sources: [RGBD_FRAME]\nprocesses: [{name: a, exec: /bin/sh, with: {k: 1}, map: {X: Y}, "
      "queue: 2, settings: ../stages/words.yaml}]\n");
  EXPECT_EQ(command_line(set, set.processes[0], "url", false),
            (std::vector<std::string>{"/bin/sh", "--name", "a", "--url", "url", "--settings",
                                      (folder_ / "stages/words.yaml").string(), "--set", "k=1",
                                      "--map", "X=Y", "--queue", "2"}));
  EXPECT_EQ(command_line(set, set.processes[0], "url", true).back(), "--lock-step");
  set = read(
      "sources: [RGBD_FRAME]\nprocesses: [{name: a, exec: /bin/sh, source: true, camera: left, "
      "trigger: single, rate_hz: 10}]\n");
  EXPECT_EQ(command_line(set, set.processes[0], "url", true),
            (std::vector<std::string>{"/bin/sh", "--name", "a", "--url", "url", "--camera", "left",
                                      "--trigger", "single", "--rate", "10"}));
}

}  // namespace
}  // namespace weft
