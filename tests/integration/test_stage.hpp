#pragma once

#include <memory>

#include "base/settings.hpp"
#include "stage/stage.hpp"

/// Small stages with the message types of the parts pipeline, for tests of the machinery around
/// stages: quick, without models, every answer a function of the inputs alone.
namespace weft::test_stage {

struct TestStageOptions {
  enum class Kind { kMask, kWords, kParts };
  Kind kind = Kind::kMask;  // mask: RGBD_FRAME -> FOREGROUND; words: both -> WORDS_SIFT;
                            // parts: WORDS_SIFT -> PROBABILITY_MAP, PART_DETECTIONS
  int work_ms = 0;
  bool impure = false;
  int fail_every = 0;

  void visit(OptionVisitor& v) {
    v.choice("kind", kind,
             {{"mask", Kind::kMask}, {"words", Kind::kWords}, {"parts", Kind::kParts}},
             "which stage to be");
    v.field("work_ms", work_ms, {0, 10000}, "ms", "time to take for each frame");
    v.field("impure", impure, "answer with a counter, which no stage may do");
    v.field("fail_every", fail_every, {0, 1000}, "frames",
            "throw for every frame whose seq divides by this; 0: never");
  }
  void validate() const { validate_fields(*this, "TestStageOptions"); }
};

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);

}  // namespace weft::test_stage
