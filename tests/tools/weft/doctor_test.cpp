#include "tools/weft/doctor.hpp"

#include <gtest/gtest.h>

#include <limits>

#include "integration/test_stage.hpp"
#include "support/files.hpp"
#include "weft/words_t.hpp"

namespace weft {
namespace {

using Kind = Finding::Kind;

weft::stage_status_t status(const std::string& stage, const std::string& host, int pid,
                            std::int64_t fingerprint) {
  weft::stage_status_t s{};
  s.stage = stage;
  s.host = host;
  s.pid = pid;
  s.build = "0.1.0 Release";
  s.fingerprints = {{weft::type_fingerprint_t::OUTPUT, "WORDS", "words_t", fingerprint}};
  return s;
}

TEST(Doctor, PointsOutWhatDoesNotFitTogether) {
  EXPECT_TRUE(mixed_versions({}).empty());
  EXPECT_TRUE(mixed_versions({status("a", "h", 1, 5), status("b", "i", 2, 5)}).empty());
  const auto twice = mixed_versions({status("a", "h", 1, 5), status("a", "i", 2, 5)});
  ASSERT_EQ(twice.size(), 1u);
  EXPECT_EQ(twice[0].what, "several processes are a: h (process 1), i (process 2)");
  auto past = status("a", "h", 1, 5), now = status("a", "h", 2, 5);
  past.header.utime = 100;
  now.started_utime = 101;
  EXPECT_TRUE(mixed_versions({past, now}).empty()) << "it was killed and started again";
  const auto types = mixed_versions({status("a", "h", 1, 5), status("b", "h", 2, 6)});
  ASSERT_EQ(types.size(), 1u);
  EXPECT_EQ(types[0].kind, Kind::kBad);
  EXPECT_NE(types[0].what.find("WORDS: a takes it for words_t 0000000000000005"), std::string::npos)
      << types[0].what;
  auto other = status("b", "i", 2, 5);
  other.build = "0.2.0 Release";
  const auto builds = mixed_versions({status("a", "h", 1, 5), other});
  ASSERT_EQ(builds.size(), 1u);
  EXPECT_EQ(builds[0].kind, Kind::kWarning);
  other = status("a", "i", 2, 5);
  other.model_hash = 9;
  EXPECT_EQ(mixed_versions({status("a", "h", 1, 5), other}).size(), 2u);
}

TEST(Doctor, ChecksTheProcessesOfThisHost) {
  const test::TemporaryFolder folder;
  test::write_bytes(folder / "good.yaml", "kind: mask\n");
  test::write_bytes(folder / "bad.yaml", "kind: colour\n");
  const auto findings = [&](const std::string& text) {
    const auto set = ProcessSet::from_text("sources: [RGBD_FRAME]\n" + text, folder / "set.yaml");
    return check_set(set, {{"weft-test-stage", test_stage::make_stage}}, "robot-1");
  };
  const auto good =
      findings("processes: [{name: a, exec: weft-test-stage, settings: good.yaml}]\n");
  ASSERT_EQ(good.size(), 1u);
  EXPECT_EQ(good[0].kind, Kind::kGood) << good[0].what;
  const auto bad = findings("processes: [{name: a, exec: weft-test-stage, settings: bad.yaml}]\n");
  EXPECT_EQ(bad.at(0).kind, Kind::kBad);
  EXPECT_NE(bad.at(0).what.find("kind"), std::string::npos) << bad.at(0).what;
  const auto none = findings("processes: [{name: a, exec: ./no-such}]\n");
  EXPECT_EQ(none.at(0).kind, Kind::kBad);
  const auto hosts = findings(
      "processes:\n  - {name: a, exec: weft-test-stage, host: robot-1, settings: good.yaml}\n"
      "  - {name: b, exec: ./elsewhere, host: robot-2}\n");
  ASSERT_EQ(hosts.size(), 2u) << "what runs on another host is not looked for here";
  EXPECT_NE(hosts[1].remedy.find("lan: true"), std::string::npos);
}

/// A stage by its ports alone.
class Ported : public stage::Stage {
 public:
  explicit Ported(stage::Interface interface) : interface_(std::move(interface)) {}
  const stage::Interface& interface() const override { return interface_; }
  void process(const stage::Inputs&, stage::Outputs&) override {}

 private:
  stage::Interface interface_;
};

TEST(Doctor, FindsAModelThatWasTrainedWithAnotherVocabulary) {
  constexpr std::uint64_t kVocabulary = 0xabc;
  const auto set = ProcessSet::from_text(
      "sources: [RGBD_FRAME]\nlan: true\nprocesses:\n"
      "  - {name: describe, exec: maker, host: robot-2, map: {WORDS: WORDS_SIFT}}\n"
      "  - {name: score, exec: weft-test-stage, host: robot-1, map: {IN: WORDS_SIFT}}\n",
      "set.yaml");
  const auto findings = [&](std::uint64_t trained_with) {
    return check_set(set,
                     {{"maker",
                       [](const Settings&) {
                         stage::Interface made;
                         made.name = "words";
                         made.outputs = {stage::port<weft::words_t>("WORDS")};
                         made.model_hash = kVocabulary;
                         return std::make_unique<Ported>(made);
                       }},
                      {"weft-test-stage",
                       [&](const Settings&) {
                         stage::Interface made;
                         made.name = "score";
                         made.inputs = {stage::port<weft::words_t>("IN", trained_with)};
                         return std::make_unique<Ported>(made);
                       }}},
                     "robot-1");
  };
  EXPECT_EQ(findings(kVocabulary).size(), 1u);
  EXPECT_EQ(findings(0).size(), 1u) << "any will do";
  const auto wrong = findings(0xdef);
  ASSERT_EQ(wrong.size(), 2u);
  EXPECT_EQ(wrong[1].what,
            "score: its model was trained with the vocabulary 0000000000000def, but describe makes "
            "WORDS_SIFT with 0000000000000abc");
  EXPECT_NE(wrong[1].remedy.find("from the same folder of config/models"), std::string::npos);
}

TEST(Doctor, AsksAProgramThatItDoesNotHoldToCheckItself) {
  const test::TemporaryFolder folder;
  const auto set = ProcessSet::from_text(
      "sources: [RGBD_FRAME]\nprocesses:\n  - {name: eye, exec: weft-capture, source: true, with: "
      "{colours: 1}}\n",
      folder / "set.yaml");
  const auto bad = check_set(set, {}, "robot-1").at(0);
  EXPECT_EQ(bad.kind, Kind::kBad);
  EXPECT_NE(bad.what.find("set.yaml:3: unknown key 'colours'"), std::string::npos) << bad.what;
  EXPECT_EQ(check_set(set, {}, "robot-1", {"eye"}).at(0).kind, Kind::kGood)
      << "one that runs has its camera, which nobody else can open";
}

TEST(Doctor, PointsOutStagesThatRunWithOtherSettingsOrModelsThanTheirFilesMake) {
  const test::TemporaryFolder folder;
  test::write_bytes(folder / "mask.yaml", "kind: mask\n");
  const auto set = ProcessSet::from_text(
      "sources: [RGBD_FRAME]\nprocesses:\n"
      "  - {name: mask, exec: weft-test-stage, settings: mask.yaml}\n"
      "  - {name: gone, exec: weft-test-stage, with: {kind: colour}}\n"
      "  - {name: own, exec: ./mine}\n",
      folder / "set.yaml");
  const StageRegistry registry{{"weft-test-stage", test_stage::make_stage}};
  const auto made = registry.at("weft-test-stage")(Settings::from_file(folder / "mask.yaml"));
  auto as_here = status("mask", "robot-2", 7, 5);
  as_here.settings_hash = static_cast<std::int64_t>(made->interface().settings_hash);
  as_here.model_hash = static_cast<std::int64_t>(made->interface().model_hash);
  auto gone = status("gone", "robot-2", 8, 5), own = status("own", "robot-2", 9, 5);
  gone.model_hash = own.model_hash = 1;
  EXPECT_TRUE(differences_from_files(set, registry, {as_here, gone, own}).empty());
  auto other = as_here;
  other.model_hash ^= 0xabc;
  const auto findings = differences_from_files(set, registry, {as_here, other});
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_NE(findings[0].what.find("mask on robot-2 (process 7) runs with models "),
            std::string::npos)
      << findings[0].what;
  EXPECT_NE(findings[0].remedy.find("weft restart mask"), std::string::npos);
  other.settings_hash ^= 1;
  EXPECT_EQ(differences_from_files(set, registry, {other}).size(), 2u);
}

TEST(Doctor, MissesTheStagesOfOtherHosts) {
  const auto set = ProcessSet::from_text(
      "sources: [RGBD_FRAME]\nlan: true\nprocesses:\n"
      "  - {name: eye, exec: weft-capture, source: true, host: robot-2}\n"
      "  - {name: mask, exec: weft-test-stage, host: robot-1}\n"
      "  - {name: words, exec: weft-test-stage, host: robot-2}\n"
      "  - {name: parts, exec: weft-test-stage}\n",
      "set.yaml");
  EXPECT_TRUE(silent_hosts(set, "robot-1", {}).empty()) << "nothing runs at all";
  const auto mask = status("mask", "robot-1", 1, 5);
  const auto silent = silent_hosts(set, "robot-1", {mask});
  ASSERT_EQ(silent.size(), 1u);
  EXPECT_EQ(silent[0].what, "nothing is heard of words on robot-2");
  EXPECT_NE(silent[0].remedy.find("on robot-2: weft status"), std::string::npos);
  EXPECT_TRUE(silent_hosts(set, "robot-1", {mask, status("words", "robot-2", 1, 5)}).empty());
}

TEST(Doctor, FindsTheInterfaceOfARoute) {
  // 224.0.0.0/4 over lo, default over eth0 and, dearer, wlan0; 239.255.76.0/24 over eth1.
  const std::string head =
      "Iface Destination Gateway Flags RefCnt Use Metric Mask MTU Window IRTT\n";
  const std::string lo = "lo 000000E0 00000000 0001 0 0 0 000000F0 0 0 0\n";
  const std::string outward =
      "wlan0 00000000 010AA8C0 0003 0 0 600 00000000 0 0 0\n"
      "eth0 00000000 010AA8C0 0003 0 0 100 00000000 0 0 0\n";
  const std::string narrow = "eth1 004CFFEF 00000000 0001 0 0 0 00FFFFFF 0 0 0\n";
  EXPECT_EQ(route_interface(head, "239.255.76.67"), "");
  EXPECT_EQ(route_interface(head + outward, "239.255.76.67"), "eth0");
  EXPECT_EQ(route_interface(head + outward + lo, "239.255.76.67"), "lo");
  EXPECT_EQ(route_interface(head + narrow + lo + outward, "239.255.76.67"), "eth1");
  EXPECT_EQ(route_interface(head + lo + outward, "1.1.1.1"), "eth0");
}

TEST(Doctor, FindsDepthCamerasAndWhetherTheyMayBeOpened) {
  const test::TemporaryFolder folder;
  const auto plug_in = [&](const std::string& port, const std::string& vendor, const char* number) {
    std::filesystem::create_directories(folder / ("sys/" + port));
    test::write_bytes(folder / ("sys/" + port + "/idVendor"), vendor + "\n");
    test::write_bytes(folder / ("sys/" + port + "/idProduct"), "0601\n");
    test::write_bytes(folder / ("sys/" + port + "/busnum"), "2\n");
    test::write_bytes(folder / ("sys/" + port + "/devnum"), number);
  };
  const auto check = [&] { return check_cameras(folder / "sys", folder / "dev"); };
  plug_in("1-1", "046d", "4\n");  // a mouse
  EXPECT_EQ(check().at(0).kind, Kind::kGood);
  plug_in("2-1", "1d27", "17\n");
  ASSERT_EQ(check().size(), 1u);
  EXPECT_EQ(check()[0].kind, Kind::kBad) << "its node is not there, which root may not open either";
  EXPECT_NE(check()[0].what.find("/dev/002/017"), std::string::npos) << check()[0].what;
  EXPECT_NE(check()[0].remedy.find("ATTR{idVendor}==\"1d27\""), std::string::npos);
  std::filesystem::create_directories(folder / "dev/002");
  test::write_bytes(folder / "dev/002/017", "");
  EXPECT_EQ(check()[0].kind, Kind::kGood) << check()[0].what;
}

TEST(Doctor, ChecksTheMachine) {
  stage::LcmUrl url;
  url.recv_buf_size = 1 << 30;
  bool buffer = false;
  for (const auto& finding : check_machine(url, "/")) {
    EXPECT_EQ(finding.kind == Kind::kGood, finding.remedy.empty()) << finding.what;
    buffer = buffer || finding.remedy.find("net.core.rmem_max=1073741824") != std::string::npos;
  }
  EXPECT_TRUE(buffer) << "no kernel grants a gigabyte by default";
  const auto disk = check_machine(url, "/", 1e15).back();
  EXPECT_EQ(disk.kind, Kind::kWarning) << disk.what;
  EXPECT_NE(disk.remedy.find("ls -lhS //*.lcm"), std::string::npos) << disk.remedy;
}

TEST(Doctor, TellsHowFarClocksAreApartFromMessagesThereAndBack) {
  ClockExchange exchange(7);
  // robot-2 is 80 ms ahead; the ways there and back take 3 and 1 ms, then 1 ms each.
  const auto answer = [&](std::int64_t session, std::int64_t seq, std::int64_t sent_us,
                          std::int64_t there_us, std::int64_t set_by_us) {
    weft::clock_pong_t pong{};
    pong.header.session = session;
    pong.header.seq = seq;
    pong.stage = "words";
    pong.host = "robot-2";
    pong.received_utime = sent_us + there_us + 80'000;
    pong.answered_utime = pong.received_utime + 500;
    pong.set_by_us = set_by_us;
    return pong;
  };
  EXPECT_EQ(exchange.question(1'000'000).seq, 0);
  EXPECT_EQ(exchange.question(2'000'000).seq, 1);
  exchange.take(answer(7, 0, 1'000'000, 3000, 0), 1'000'000 + 3000 + 500 + 1000);
  EXPECT_EQ(exchange.hosts().at("robot-2").offset_us, 81'000);
  exchange.take(answer(7, 1, 2'000'000, 1000, 0), 2'000'000 + 1000 + 500 + 1000);
  EXPECT_EQ(exchange.hosts().at("robot-2").offset_us, 80'000) << "the quicker exchange counts";
  EXPECT_EQ(exchange.hosts().at("robot-2").on_the_way_us, 2000);
  exchange.take(answer(8, 1, 5'000'000, 0, 0), 5'000'000);
  exchange.take(answer(7, 2, 5'000'000, 0, 0), 5'000'000);
  exchange.take(answer(7, -1, 5'000'000, 0, 0), 5'000'000);
  EXPECT_EQ(exchange.hosts().at("robot-2").exchanges, 2) << "answers to questions of others";
  auto hostile = answer(7, 1, 2'000'000, 1000, 0);
  hostile.received_utime = std::numeric_limits<std::int64_t>::min();
  exchange.take(hostile, 2'002'500);
  hostile.received_utime = hostile.answered_utime = std::numeric_limits<std::int64_t>::max();
  exchange.take(hostile, 2'002'500);
  EXPECT_EQ(exchange.hosts().at("robot-2").exchanges, 2) << "times that nobody's clock shows";
  auto findings = exchange.findings("robot-1", {"robot-1", "robot-2", "robot-3"});
  ASSERT_EQ(findings.size(), 2u);
  EXPECT_NE(findings[0].what.find("robot-3: no process there answers"), std::string::npos);
  EXPECT_EQ(findings[1].kind, Kind::kWarning);
  EXPECT_NE(findings[1].what.find("robot-2: 80.00 ms ahead of this one's (+- 1.00 ms"),
            std::string::npos)
      << findings[1].what;
  EXPECT_NE(findings[1].remedy.find("server robot-1 iburst"), std::string::npos);
  EXPECT_TRUE(exchange.findings("robot-2", {"robot-2"}).empty()) << "its own clock";
  exchange.take(answer(7, 1, 2'000'000, 1000, -40'000), 2'002'500);
  findings = exchange.findings("robot-2", {"robot-2"});
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].remedy, "on robot-2: weft restart words");
}

}  // namespace
}  // namespace weft
