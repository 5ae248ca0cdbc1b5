#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

/// Feeds decoders of what comes from outside with damaged inputs: targets, which rounds_test.cpp
/// runs a fixed number of rounds in every test run, and libfuzzer.cpp for as long as wanted.
namespace weft::fuzz {

using Bytes = std::vector<std::uint8_t>;

struct Target {
  std::vector<Bytes> inputs;  // good ones
  /// Throws Error, or an error derived from it, for what it refuses. Anything else that leaves it
  /// is a fault.
  std::function<void(const Bytes&)> decode;
  /// Makes checksums fit again, in every other round; empty: there are none.
  std::function<void(Bytes&)> repair = {};
};

/// name: letters, digits and '_'.
bool add_target(const std::string& name, std::function<Target()> make);
std::vector<std::string> target_names();
/// Throws Error when there is none of this name.
Target make_target(const std::string& name);

/// WEFT_FUZZ_TARGET(Name) { return Target{...}; }
#define WEFT_FUZZ_TARGET(Name)                              \
  static ::weft::fuzz::Target Name();                       \
  static const bool Name##_known = add_target(#Name, Name); \
  static ::weft::fuzz::Target Name()

/// One of the inputs, damaged: bits, numbers and words changed, pieces removed, repeated or taken
/// from another input. Round n always damages alike.
Bytes damaged(const Target& target, long round);

/// Throws what is not Error: the target found a fault, not a bad input.
void require(bool holds, const char* what);

/// A decode function from one that reads a file, which is in memory here.
std::function<void(const Bytes&)> through_file(std::function<void(const std::string& path)> read);

inline Bytes bytes_of(const std::string& text) { return {text.begin(), text.end()}; }
inline std::string text_of(const Bytes& bytes) { return {bytes.begin(), bytes.end()}; }

}  // namespace weft::fuzz
