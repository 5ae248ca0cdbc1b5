#include "tools/weft/doctor.hpp"

#include <gtest/gtest.h>

#include "integration/test_stage.hpp"
#include "support/files.hpp"

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
  EXPECT_NE(hosts[1].remedy.find("ttl: 1"), std::string::npos);
}

TEST(Doctor, ChecksTheMachineAndItsClock) {
  stage::LcmUrl url;
  url.recv_buf_size = 1 << 30;
  bool buffer = false;
  for (const auto& finding : check_machine(url, "/")) {
    EXPECT_EQ(finding.kind == Kind::kGood, finding.remedy.empty()) << finding.what;
    buffer = buffer || finding.remedy.find("net.core.rmem_max=1073741824") != std::string::npos;
  }
  EXPECT_TRUE(buffer) << "no kernel grants a gigabyte by default";
  EXPECT_EQ(judge_clock({"robot-2", 900}).kind, Kind::kGood);
  EXPECT_NE(judge_clock({"robot-2", 80'000}).what.find("80.0 ms behind"), std::string::npos);
  EXPECT_NE(judge_clock({"robot-2", -80'000}).what.find("80.0 ms ahead of"), std::string::npos);
}

}  // namespace
}  // namespace weft
