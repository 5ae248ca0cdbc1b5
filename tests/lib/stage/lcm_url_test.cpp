#include "stage/lcm_url.hpp"

#include <gtest/gtest.h>
#include <regex.h>

#include <cstdlib>
#include <fstream>

#include "base/error.hpp"

namespace weft::stage {
namespace {

TEST(LcmUrl, KeepsToThisHostByDefault) {
  unsetenv("LCM_DEFAULT_URL");
  EXPECT_EQ(LcmUrl::parse("").to_string(), "udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304");
  EXPECT_EQ(LcmUrl::parse("udpm://").to_string(), LcmUrl().to_string());
}

TEST(LcmUrl, ReadsEveryPiece) {
  const auto url = LcmUrl::parse("udpm://224.1.2.3:99?ttl=1&recv_buf_size=212992");
  EXPECT_EQ(url.group, "224.1.2.3");
  EXPECT_EQ(url.port, 99);
  EXPECT_EQ(url.ttl, 1);
  EXPECT_EQ(url.recv_buf_size, 212992);
  EXPECT_EQ(LcmUrl::parse(url.to_string()).to_string(), url.to_string());
  EXPECT_EQ(LcmUrl::parse("udpm://:5?ttl=2").ttl, 2);
  EXPECT_EQ(LcmUrl::parse("memq://").to_string(), "memq://");
  EXPECT_EQ(LcmUrl::parse("file:///a.lcm?speed=0").to_string(), "file:///a.lcm?speed=0");
}

TEST(LcmUrl, APrefixNamesEveryChannelAnewAndIsKeptFromLcm) {
  const auto url = LcmUrl::parse("udpm://?ttl=1&prefix=robot-2");
  EXPECT_EQ(url.prefix, "robot-2");
  EXPECT_EQ(LcmUrl::parse(url.to_string()).prefix, "robot-2");
  EXPECT_EQ(url.to_lcm_string(), "udpm://239.255.76.67:7667?ttl=1&recv_buf_size=4194304");
  EXPECT_EQ(url.wire("STAGE_STATUS"), "robot-2/STAGE_STATUS");
  EXPECT_EQ(url.local("robot-2/STAGE_STATUS"), "STAGE_STATUS");
  EXPECT_EQ(LcmUrl().wire("WORDS"), "WORDS");
  EXPECT_EQ(LcmUrl().local("WORDS"), "WORDS");
  for (const char* wrong : {"", "a/b", "a b", "a.b", "1234567890123456789012345"})
    EXPECT_NE(prefix_fault(wrong), "") << wrong;
}

TEST(LcmUrl, TakesTheEnvironmentsUrl) {
  setenv("LCM_DEFAULT_URL", "udpm://239.255.76.67:7700?ttl=1", 1);
  EXPECT_EQ(LcmUrl::parse("").port, 7700);
  EXPECT_EQ(LcmUrl::parse("udpm://").port, 7667);
  unsetenv("LCM_DEFAULT_URL");
}

TEST(LcmUrl, NamesTheWrongPiece) {
  const auto error = [](const std::string& text) -> std::string {
    try {
      LcmUrl::parse(text);
    } catch (const Error& e) {
      return e.what();
    }
    return "accepted";
  };
  EXPECT_NE(error("7667").find("provider"), std::string::npos);
  EXPECT_NE(error("udpm://10.0.0.1:7667").find("10.0.0.1"), std::string::npos);
  EXPECT_NE(error("udpm://nonsense").find("nonsense"), std::string::npos);
  EXPECT_NE(error("udpm://239.255.76.67:70000").find("port"), std::string::npos);
  EXPECT_NE(error("udpm://239.255.76.67:").find("port"), std::string::npos);
  EXPECT_NE(error("udpm://?ttl=x").find("ttl"), std::string::npos);
  EXPECT_NE(error("udpm://?ttl=256").find("ttl"), std::string::npos);
  EXPECT_NE(error("udpm://?tll=1").find("tll"), std::string::npos);
  EXPECT_NE(error("udpm://?prefix=a/b").find("a/b"), std::string::npos);
  EXPECT_NE(error("udpm://?recv_buf_size=1").find("recv_buf_size"), std::string::npos);
}

TEST(LcmUrl, WarnsOfSmallReceiveBuffersWithTheRemedy) {
  const LcmUrl url;
  EXPECT_EQ(receive_buffer_warning(url, url.recv_buf_size), "");
  EXPECT_EQ(receive_buffer_warning(LcmUrl::parse("memq://"), 1), "");
  const auto warning = receive_buffer_warning(url, 212992);
  EXPECT_NE(warning.find("212992"), std::string::npos);
  EXPECT_NE(warning.find("sysctl -w net.core.rmem_max=4194304"), std::string::npos);
}

TEST(LcmUrl, WarnsOfLittleMemoryForFragmentsOnALan) {
  const auto lan = LcmUrl::parse("udpm://?ttl=1");
  const FragmentMemory stock{4'194'304, 30};
  EXPECT_EQ(fragment_warning(LcmUrl(), stock), "") << "nothing comes from other hosts";
  EXPECT_EQ(fragment_warning(lan, {67'108'864, 30}), "");
  EXPECT_EQ(fragment_warning(lan, {4'194'304, 2}), "");
  const auto warning = fragment_warning(lan, stock);
  EXPECT_NE(warning.find("sysctl -w net.ipv4.ipfrag_time=2"), std::string::npos) << warning;
  EXPECT_EQ(fragment_warning(lan, {67'108'864, 2}), "") << "the remedy";
}

TEST(LcmUrl, ReadsTheKernelsLimit) {
  std::ifstream file("/proc/sys/net/core/rmem_max");
  int expected = 0;
  if (!(file >> expected)) GTEST_SKIP() << "no /proc/sys/net/core/rmem_max here";
  EXPECT_EQ(receive_buffer_limit(), expected);
}

TEST(LcmUrl, SubscribesLiterally) {
  for (const std::string name : {"PART_DETECTIONS@chi2fast", "A.B", "A+(B)*[C]{1}|^$?\\"}) {
    // As LCM compiles it.
    regex_t regex;
    ASSERT_EQ(regcomp(&regex, ("^" + channel_regex(name) + "$").c_str(), REG_NOSUB | REG_EXTENDED),
              0);
    EXPECT_EQ(regexec(&regex, name.c_str(), 0, nullptr, 0), 0) << name;
    EXPECT_NE(regexec(&regex, "AxB", 0, nullptr, 0), 0) << name;
    regfree(&regex);
  }
}

}  // namespace
}  // namespace weft::stage
