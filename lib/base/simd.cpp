#include "base/simd.hpp"

#include <cstdlib>
#include <string>

#include "base/error.hpp"

namespace weft {
namespace {

SimdPath read_process_simd_path() {
  const char* const named = std::getenv("WEFT_SIMD");
  const std::string name = named ? named : "";
  if (name.empty())
    return simd_path_available(SimdPath::kAvx2) ? SimdPath::kAvx2 : SimdPath::kBaseline;
  for (const auto path : {SimdPath::kBaseline, SimdPath::kAvx2}) {
    if (name != to_string(path)) continue;
    if (!simd_path_available(path))
      throw Error("WEFT_SIMD=" + name + ": this processor does not have it; use baseline");
    return path;
  }
  throw Error("WEFT_SIMD=" + name + ": expected baseline or avx2");
}

}  // namespace

SimdPath process_simd_path() {
  static const SimdPath path = read_process_simd_path();
  return path;
}

const char* to_string(SimdPath path) {
  switch (path) {
    case SimdPath::kBaseline:
      return "baseline";
    case SimdPath::kAvx2:
      return "avx2";
    case SimdPath::kAuto:
      break;
  }
  return "auto";
}

}  // namespace weft
