#include <fmt/format.h>

#include <cstdio>

#include "base/text_file.hpp"
#include "tools/weft/commands.hpp"
#include "tools/weft/compare.hpp"

namespace weft {

int compare_command(const CompareCommand& command) {
  MessageTypes types = MessageTypes::built_in();
  if (!command.types.empty()) types.add_folder(command.types);
  CompareOptions options;
  options.threshold = command.threshold;
  options.overlap = command.overlap;
  options.variant = command.variant;
  options.truth = command.truth;
  options.channel = command.channel;
  const auto comparison = compare_logs(command.log_a, command.log_b, options, types);
  for (const auto& damage : comparison.damage) fmt::print(stderr, "{}\n", damage);
  fmt::print("{}", to_text(comparison));
  if (!command.json.empty()) write_text_file(command.json, to_json(comparison) + "\n");
  if (!command.html.empty()) {
    write_text_file(command.html, to_page(comparison, static_cast<std::size_t>(command.pictures)));
    fmt::print("page: {}\n", command.html);
  }
  return comparison.damage.empty() ? 0 : 1;
}

}  // namespace weft
