#include "procs/score/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-score", "Scores windows for each garment part and picks the peaks.",
      weft::score_process::make_stage, weft::score_process::settings_reference());
}
