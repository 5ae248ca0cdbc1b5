#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace weft {

/// 64-bit FNV-1a. Names data, settings and models; not for security.
class Hash64 {
 public:
  void add(const void* data, std::size_t size);
  void add(
      std::string_view text);  // the length goes in too, so that ("ab","c") and ("a","bc") differ
  void add(std::uint64_t value);
  std::uint64_t value() const { return state_; }

 private:
  std::uint64_t state_ = 0xcbf29ce484222325u;
};

/// 16 lower-case hexadecimal digits.
std::string to_hex(std::uint64_t hash);

}  // namespace weft
