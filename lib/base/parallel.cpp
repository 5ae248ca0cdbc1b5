#include "base/parallel.hpp"

#include <algorithm>
#include <exception>
#include <thread>
#include <vector>

namespace weft {

void parallel_for(int count, int threads, const std::function<void(int, int)>& body) {
  if (count <= 0) return;
  if (threads < 1) threads = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  const int pieces = std::min(threads, count);
  if (pieces == 1) return body(0, count);
  std::vector<std::exception_ptr> errors(static_cast<std::size_t>(pieces));
  const auto run = [&](int piece) {
    const auto bound = [&](int i) {
      return static_cast<int>(static_cast<long long>(count) * i / pieces);
    };
    try {
      body(bound(piece), bound(piece + 1));
    } catch (...) {
      errors[static_cast<std::size_t>(piece)] = std::current_exception();
    }
  };
  std::vector<std::jthread> workers;
  for (int piece = 1; piece < pieces; ++piece) workers.emplace_back(run, piece);
  run(0);
  workers.clear();
  for (const auto& error : errors) {
    if (error) std::rethrow_exception(error);
  }
}

}  // namespace weft
