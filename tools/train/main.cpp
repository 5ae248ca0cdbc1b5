#include "train/train.hpp"

int main(int argc, char** argv) { return weft::train::run_train(argc, argv); }
