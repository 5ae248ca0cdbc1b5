#pragma once

#include <functional>

namespace CLI {
class App;
}

/// The subcommands of weft-synth. Each adds its options to app and puts what it does, which returns
/// the exit status, into `chosen` when it is the one that was named.
namespace weft::synth {

using Chosen = std::function<int()>;

void add_parts_command(CLI::App& app, Chosen& chosen);
void add_render_command(CLI::App& app, Chosen& chosen);
void add_states_command(CLI::App& app, Chosen& chosen);
void add_sequences_command(CLI::App& app, Chosen& chosen);
void add_statistics_command(CLI::App& app, Chosen& chosen);
void add_invariance_command(CLI::App& app, Chosen& chosen);

}  // namespace weft::synth
