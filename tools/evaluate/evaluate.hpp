#pragma once

namespace weft::evaluate {

/// `weft evaluate parts`: how well parts are found, on a dataset with models or in a log of
/// detections. `weft evaluate trajectory`: how well a camera path agrees with the truth. Exit
/// status: 0 when everything was judged, 1 on an error or when frames were left unanswered, 2 for
/// wrong use.
int run_evaluate(int argc, char** argv);

}  // namespace weft::evaluate
