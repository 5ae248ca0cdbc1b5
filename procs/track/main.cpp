#include "procs/track/stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-track", "Tells where the camera is in the map of weft-map.",
      weft::track_process::make_stage, weft::track_process::settings_reference());
}
