#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

/// Feeds decoders of what comes from outside with damaged inputs. Round n always damages alike:
/// WEFT_FUZZ_FIRST is the first round (0), WEFT_FUZZ_ROUNDS their number (docs/building.md).
namespace weft::fuzz {

using Bytes = std::vector<std::uint8_t>;

struct Target {
  std::string name;
  std::vector<Bytes> inputs;  // good ones
  /// Throws Error, or an error derived from it, for what it refuses.
  std::function<void(const Bytes&)> decode;
  /// Makes checksums fit again, in every other round; empty: there are none.
  std::function<void(Bytes&)> repair = {};
};

/// Decodes the inputs, which must succeed, then damaged ones: bits, numbers and words changed,
/// pieces removed, repeated or taken from another input. The test fails when decode throws anything
/// but Error, when one call takes more than 5 s of the processor or asks for more than a gigabyte,
/// and when it refuses nothing. A crash names the round.
void run(const Target& target);

inline Bytes bytes_of(const std::string& text) { return {text.begin(), text.end()}; }
inline std::string text_of(const Bytes& bytes) { return {bytes.begin(), bytes.end()}; }

}  // namespace weft::fuzz
