#include <string_view>

#include "train/train.hpp"
#include "train/vocabulary.hpp"

int main(int argc, char** argv) {
  if (argc > 1 && argv[1] == std::string_view("vocabulary")) {
    return weft::train::run_train_vocabulary(argc - 1, argv + 1);
  }
  return weft::train::run_train(argc, argv);
}
