#include "fuzz/fuzz.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <fstream>

#include "base/error.hpp"
#include "base/random.hpp"

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

/// A place in the bytes; the end is one, too.
std::size_t place(const Bytes& bytes, Random& random) { return random.below(bytes.size() + 1); }

void overwrite(Bytes& bytes, Random& random) {
  constexpr std::uint64_t kNumbers[] = {0,
                                        1,
                                        2,
                                        0x7f,
                                        0x80,
                                        0xff,
                                        0x7fff,
                                        0x8000,
                                        0xffff,
                                        0x7fffffff,
                                        0x80000000,
                                        0xffffffff,
                                        0x40000000,
                                        0x100000000,
                                        ~0ull >> 1,
                                        ~0ull,
                                        ~0ull << 1,
                                        8193,
                                        0x7ff0ull << 48,
                                        0x7ff8ull << 48};  // infinity and NaN among them
  const std::uint64_t number = kNumbers[random.below(std::size(kNumbers))];
  const std::size_t size = std::size_t{1} << random.below(4);
  const bool big_endian = random.below(2) == 1;
  const std::size_t at = place(bytes, random);
  for (std::size_t i = 0; i < size && at + i < bytes.size(); ++i) {
    const std::size_t byte = big_endian ? size - 1 - i : i;
    bytes[at + i] = static_cast<std::uint8_t>(number >> (8 * byte));
  }
}

/// In place of a word or number, or between two characters.
void write_word(Bytes& bytes, Random& random) {
  constexpr const char* kWords[] = {
      "nan",        "inf",        "-1",   "0",  "1e308", "-1e400", "99999999999999999999",
      "4294967296", "2147483648", "8193", "\n", " ",     ":",      "[",
      "]",          "{",          "}",    ", ", "&a ",   "*a",     "'",
      "\"",         "#",          "- ",   "%",  "<<: ",  "0x10",   "1.5",
      "true"};
  const std::string word = kWords[random.below(std::size(kWords))];
  const std::size_t at = place(bytes, random);
  std::size_t end = at;
  if (random.below(2) == 0) {
    while (end < bytes.size() && std::isgraph(bytes[end])) ++end;
  }
  const auto to = bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(at),
                              bytes.begin() + static_cast<std::ptrdiff_t>(end));
  bytes.insert(to, word.begin(), word.end());
}

void damage(Bytes& bytes, const std::vector<Bytes>& others, Random& random) {
  const std::size_t at = place(bytes, random), end = at + random.below(bytes.size() - at + 1);
  const auto from = bytes.begin() + static_cast<std::ptrdiff_t>(at);
  const auto to = bytes.begin() + static_cast<std::ptrdiff_t>(end);
  switch (random.below(8)) {
    case 0:
      if (at < bytes.size()) bytes[at] ^= static_cast<std::uint8_t>(1u << random.below(8));
      break;
    case 1:
      overwrite(bytes, random);
      break;
    case 2:
      bytes.erase(from, to);
      break;
    case 3: {
      const Bytes piece(from, to);
      bytes.insert(to, piece.begin(), piece.end());
      break;
    }
    case 4: {
      Bytes noise(1 + random.below(16));
      for (auto& byte : noise) byte = static_cast<std::uint8_t>(random.below(256));
      bytes.insert(from, noise.begin(), noise.end());
      break;
    }
    case 5:
      bytes.resize(at);
      break;
    case 6: {
      const Bytes& other = others[random.below(others.size())];
      bytes.resize(at);
      bytes.insert(bytes.end(),
                   other.begin() + static_cast<std::ptrdiff_t>(std::min(at, other.size())),
                   other.end());
      break;
    }
    default:
      write_word(bytes, random);
  }
}

}  // namespace

void run(const Target& target) {
  for (const Bytes& input : target.inputs) {
    ASSERT_NO_THROW(target.decode(input)) << target.name << ": a good input";
  }
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
                  target.name.c_str(), round);
    Random random(static_cast<std::uint64_t>(round));
    Bytes bytes = target.inputs[random.below(target.inputs.size())];
    for (std::uint64_t left = 1 + random.below(4); left > 0; --left) {
      damage(bytes, target.inputs, random);
    }
    if (target.repair && random.below(2) == 0) target.repair(bytes);
    bytes.shrink_to_fit();  // the sanitizer sees what is read beyond
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
    EXPECT_GT(refused, 0) << target.name;
  }
}

}  // namespace weft::fuzz
