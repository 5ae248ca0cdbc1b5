#pragma once

#include "base/hash.hpp"
#include "fuzz/fuzz.hpp"

namespace weft::fuzz {

/// Makes the checksum at the end of a blob (base/blob.hpp) fit what is before it.
inline void repair_blob(Bytes& bytes) {
  if (bytes.size() < 8) return;
  Hash64 hash;
  hash.add(bytes.data(), bytes.size() - 8);
  for (std::size_t i = 0; i < 8; ++i)
    bytes[bytes.size() - 8 + i] = static_cast<std::uint8_t>(hash.value() >> (8 * i));
}

}  // namespace weft::fuzz
