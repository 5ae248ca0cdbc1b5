// Every target for a fixed number of rounds: 10000, or WEFT_FUZZ_ROUNDS, from WEFT_FUZZ_FIRST on
// (docs/building.md).
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>

#include "base/error.hpp"
#include "fuzz/fuzz.hpp"

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/common_interface_defs.h>
extern "C" const char* __asan_default_options() { return "max_allocation_size_mb=1024"; }
#endif

namespace weft::fuzz {
namespace {

constexpr double kMostCpu_s = 5.0;
constexpr unsigned kMostWall_s = 120;
constexpr rlim_t kMostBytes = rlim_t{1} << 30;

// What a crash leaves behind.
char current[200];

void tell_round() {
  const ssize_t ignored = write(STDERR_FILENO, current, std::strlen(current));
  static_cast<void>(ignored);
}

void on_signal(int signal) {
  tell_round();
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

long setting(const char* name, long otherwise) {
  const char* text = std::getenv(name);
  return text ? std::atol(text) : otherwise;
}

/// Address space beyond what is in use; the sanitizer has a limit of its own.
class MemoryLimit {
 public:
  MemoryLimit() {
#ifndef __SANITIZE_ADDRESS__
    long pages = 0;
    std::ifstream("/proc/self/statm") >> pages;
    getrlimit(RLIMIT_AS, &before_);
    rlimit limit = before_;
    limit.rlim_cur = static_cast<rlim_t>(pages) * static_cast<rlim_t>(getpagesize()) + kMostBytes;
    setrlimit(RLIMIT_AS, &limit);
#endif
  }
  ~MemoryLimit() {
#ifndef __SANITIZE_ADDRESS__
    setrlimit(RLIMIT_AS, &before_);
#endif
  }
  MemoryLimit(const MemoryLimit&) = delete;
  MemoryLimit& operator=(const MemoryLimit&) = delete;

 private:
  rlimit before_{};
};

double cpu_s() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

class Rounds : public testing::TestWithParam<std::string> {};

/// Good inputs decode; a damaged one is decoded or refused, in 5 s of the processor and a gigabyte,
/// and some are refused. A crash names the round.
TEST_P(Rounds, OfDamage) {
  const Target target = make_target(GetParam());
  for (const Bytes& input : target.inputs) ASSERT_NO_THROW(target.decode(input)) << "a good input";
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGALRM}) {
    std::signal(signal, on_signal);
  }
#ifdef __SANITIZE_ADDRESS__
  __sanitizer_set_death_callback(tell_round);
#endif
  const long first = setting("WEFT_FUZZ_FIRST", 0), rounds = setting("WEFT_FUZZ_ROUNDS", 10000);
  const MemoryLimit limit;
  long refused = 0;
  for (long round = first; round < first + rounds; ++round) {
    std::snprintf(current, sizeof current,
                  "\nfuzz: %s failed; repeat with WEFT_FUZZ_FIRST=%ld WEFT_FUZZ_ROUNDS=1\n",
                  GetParam().c_str(), round);
    const Bytes bytes = damaged(target, round);
    alarm(kMostWall_s);
    const double started_s = cpu_s();
    try {
      target.decode(bytes);
    } catch (const Error& error) {
      ++refused;
      EXPECT_NE(std::string(error.what()), "") << current;
    } catch (const std::exception& error) {
      ADD_FAILURE() << current << "threw " << error.what();
    }
    alarm(0);
    EXPECT_LT(cpu_s() - started_s, kMostCpu_s) << current;
  }
  if (rounds >= 100) {
    EXPECT_GT(refused, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Fuzz, Rounds, testing::ValuesIn(target_names()),
                         [](const auto& name) { return name.param; });

}  // namespace
}  // namespace weft::fuzz
