// The targets under libFuzzer; the `fuzz` preset builds it with clang:
//   weft-fuzz --list
//   weft-fuzz --target=NAME --corpus=FOLDER       writes inputs to begin with, good and damaged
//   ones weft-fuzz --target=NAME FOLDER [libFuzzer's options] weft-fuzz --target=NAME FILE repeats
//   one
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <optional>

#include "base/error.hpp"
#include "fuzz/fuzz.hpp"

extern "C" {
int LLVMFuzzerInitialize(int* argc, char*** argv);
int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);
std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                    unsigned seed);
std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);
}

namespace {

using weft::fuzz::Bytes;

std::optional<weft::fuzz::Target> target;

void write_corpus(const std::filesystem::path& folder) {
  constexpr long kDamaged = 32;
  std::filesystem::create_directories(folder);
  const auto write = [&](const std::string& name, const Bytes& bytes) {
    std::ofstream(folder / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()),
               static_cast<std::streamsize>(bytes.size()));
  };
  for (std::size_t i = 0; i < target->inputs.size(); ++i)
    write("good-" + std::to_string(i), target->inputs[i]);
  for (long round = 0; round < kDamaged; ++round)
    write("damaged-" + std::to_string(round), weft::fuzz::damaged(*target, round));
}

[[noreturn]] void fail(const char* what) {
  std::fprintf(stderr, "weft-fuzz: %s\n", what);
  std::abort();
}

}  // namespace

int LLVMFuzzerInitialize(int* argc, char*** argv) {
  std::string name, corpus;
  for (int i = 1; i < *argc; ++i) {
    const char* const arg = (*argv)[i];
    if (std::strncmp(arg, "--target=", 9) == 0) name = arg + 9;
    if (std::strncmp(arg, "--corpus=", 9) == 0) corpus = arg + 9;
    if (std::strcmp(arg, "--list") == 0) {
      for (const auto& each : weft::fuzz::target_names()) std::printf("%s\n", each.c_str());
      std::exit(0);
    }
  }
  try {
    target = weft::fuzz::make_target(name);
    if (!corpus.empty()) {
      write_corpus(corpus);
      std::exit(0);
    }
  } catch (const std::exception& e) {
    std::fprintf(stderr, "weft-fuzz: %s; --target=NAME, and --list names them\n", e.what());
    std::exit(2);
  }
  return 0;
}

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Bytes bytes(data, data + size);
  try {
    target->decode(bytes);
  } catch (const weft::Error& error) {
    if (error.what()[0] == '\0') fail("an error without a text");
  } catch (const std::exception& error) {
    fail(error.what());
  }
  return 0;
}

std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                    unsigned seed) {
  size = LLVMFuzzerMutate(data, size, max_size);
  if (!target->repair || seed % 2 == 0) return size;
  Bytes bytes(data, data + size);
  target->repair(bytes);
  std::memcpy(data, bytes.data(), size);
  return size;
}
