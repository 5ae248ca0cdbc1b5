#pragma once

#include <functional>
#include <memory>
#include <string>

#include "base/settings.hpp"
#include "stage/stage.hpp"

namespace weft::stage {

/// Makes a stage from its settings; throws Error when the settings or the models they name are not
/// usable. Paths in settings are relative to the settings file's folder when one was given.
using StageFactory = std::function<std::unique_ptr<Stage>(const Settings& settings)>;

/// main() of a process that holds one stage: parses the command line (--settings FILE, --set
/// key=value,
/// --name INSTANCE, --map CHANNEL=OTHER, --url, --lock-step, --queue, --deadline-ms,
/// --print-settings ...), runs until SIGINT or SIGTERM, and returns the exit status: 0 after a
/// clean stop, 1 on an error, 2 for wrong use.
int run_process(int argc, char** argv, const std::string& program, const std::string& summary,
                const StageFactory& factory, const std::string& settings_reference);

}  // namespace weft::stage
