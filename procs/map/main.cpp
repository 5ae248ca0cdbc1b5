#include "procs/map/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-map", "Owns the map: key frames in, what they change out.",
      weft::map_process::make_stage, weft::map_process::settings_reference());
}
