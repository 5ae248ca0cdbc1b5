#pragma once

#include <functional>

namespace weft {

/// Runs body(begin, end) over consecutive pieces of [0, count) on up to `threads` threads and waits
/// for all. The result must not depend on how the range is cut: pieces write to places of their
/// own. An exception of a piece is thrown here, that of the first piece if several throw. threads <
/// 1 means one for each core.
void parallel_for(int count, int threads, const std::function<void(int begin, int end)>& body);

}  // namespace weft
