#include "procs/prior/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-prior", "Says which garment parts are worth looking for.",
      weft::prior_process::make_stage, weft::prior_process::settings_reference());
}
