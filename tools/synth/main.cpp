#include <CLI/CLI.hpp>
#include <cstdio>

#include "synth/commands.hpp"

int main(int argc, char** argv) {
  CLI::App app("Synthetic garment scans: simulated, rendered, annotated", "weft synth");
  app.require_subcommand(1);
  weft::synth::Chosen chosen;
  weft::synth::add_parts_command(app, chosen);
  weft::synth::add_render_command(app, chosen);
  weft::synth::add_states_command(app, chosen);
  weft::synth::add_sequences_command(app, chosen);
  weft::synth::add_statistics_command(app, chosen);
  weft::synth::add_invariance_command(app, chosen);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    return chosen();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "weft synth: %s\n", error.what());
    return 1;
  }
}
