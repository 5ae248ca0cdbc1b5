#include "procs/describe/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-describe", "Describes the garment by visual words on a dense grid.",
      weft::describe_process::make_stage, weft::describe_process::settings_reference());
}
