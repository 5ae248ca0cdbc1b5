#include "procs/grasp/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-grasp", "finds where to take hold of the detected parts",
      weft::grasp_process::make_stage, weft::grasp_process::settings_reference());
}
