#include "procs/refine/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-refine", "Refines candidates into detections of garment parts.",
      weft::refine_process::make_stage, weft::refine_process::settings_reference());
}
