#pragma once

namespace weft::train {

/// `weft train`: --dataset FOLDER --out FOLDER [--work FOLDER] [--settings FILE] [--set key=value]
/// [--threads N]. Exit status: 0 when models were written, 1 on an error, 2 for wrong use.
int run_train(int argc, char** argv);

}  // namespace weft::train
