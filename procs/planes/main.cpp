#include "procs/planes/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-planes", "Finds planes and cylinders in depth images.",
      weft::planes_process::make_stage, weft::planes_process::settings_reference());
}
