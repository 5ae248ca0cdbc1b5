#include "procs/foreground/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-foreground", "finds the table and the garments on it",
      weft::foreground_process::make_stage, weft::foreground_process::settings_reference());
}
