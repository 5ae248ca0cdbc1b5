#include "fuzz/fuzz.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <memory>
#include <stdexcept>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft::fuzz {
namespace {

std::map<std::string, std::function<Target()>>& registry() {
  static std::map<std::string, std::function<Target()>> targets;
  return targets;
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

class MemoryFile {
 public:
  MemoryFile() : descriptor_(memfd_create("fuzz", MFD_CLOEXEC)) {
    if (descriptor_ < 0) throw Error("no file in memory");
  }
  ~MemoryFile() { close(descriptor_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }
  void set(const Bytes& bytes) const {
    if (ftruncate(descriptor_, 0) != 0 ||
        pwrite(descriptor_, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
      throw std::runtime_error("cannot write a file in memory");
  }

 private:
  int descriptor_;
};

}  // namespace

bool add_target(const std::string& name, std::function<Target()> make) {
  return registry().emplace(name, std::move(make)).second;
}

std::vector<std::string> target_names() {
  std::vector<std::string> names;
  for (const auto& [name, make] : registry()) names.push_back(name);
  return names;
}

Target make_target(const std::string& name) {
  const auto at = registry().find(name);
  if (at == registry().end()) throw Error("there is no fuzz target '" + name + "'");
  return at->second();
}

Bytes damaged(const Target& target, long round) {
  Random random(static_cast<std::uint64_t>(round));
  Bytes bytes = target.inputs[random.below(target.inputs.size())];
  for (std::uint64_t left = 1 + random.below(4); left > 0; --left) {
    damage(bytes, target.inputs, random);
  }
  if (target.repair && random.below(2) == 0) target.repair(bytes);
  bytes.shrink_to_fit();  // the sanitizer sees what is read beyond
  return bytes;
}

void require(bool holds, const char* what) {
  if (!holds) throw std::logic_error(what);
}

std::function<void(const Bytes&)> through_file(std::function<void(const std::string&)> read) {
  const auto file = std::make_shared<MemoryFile>();
  return [file, read = std::move(read)](const Bytes& bytes) {
    file->set(bytes);
    read(file->path());
  };
}

}  // namespace weft::fuzz
