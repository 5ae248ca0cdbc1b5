#include "evaluate/evaluate.hpp"

int main(int argc, char** argv) { return weft::evaluate::run_evaluate(argc, argv); }
