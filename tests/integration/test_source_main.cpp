#include "integration/test_stage.hpp"
#include "stage/source.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_source(
      argc, argv, "weft-test-source", "A camera that gives random bytes, for tests.",
      weft::test_stage::make_source, weft::options_to_yaml(weft::test_stage::TestSourceOptions{}));
}
