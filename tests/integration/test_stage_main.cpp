#include "integration/test_stage.hpp"
#include "stage/process.hpp"

int main(int argc, char** argv) {
  return weft::stage::run_process(
      argc, argv, "weft-test-stage", "A stage without models, for tests.",
      weft::test_stage::make_stage, weft::options_to_yaml(weft::test_stage::TestStageOptions{}));
}
