#pragma once

#include <stdexcept>
#include <string>

namespace weft {

/// The one exception of the project. The text says what went wrong, where (file, line, key,
/// channel) and what to do next.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace weft
