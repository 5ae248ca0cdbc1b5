#pragma once

#include <memory>

#include "base/settings.hpp"
#include "stage/source.hpp"
#include "stage/stage.hpp"

/// Small stages with the message types of the parts pipeline, for tests of the machinery around
/// stages: quick, without models, every answer a function of the inputs alone.
namespace weft::test_stage {

struct TestStageOptions {
  enum class Kind { kMask, kWords, kParts, kTrack };
  Kind kind = Kind::kMask;  // mask: RGBD_FRAME -> FOREGROUND; words: both -> WORDS_SIFT;
                            // parts: WORDS_SIFT -> PROBABILITY_MAP, PART_DETECTIONS;
                            // track: RGBD_FRAME, WORDS_SIFT(n - frames_back) -> FOREGROUND
  int work_ms = 0;
  bool impure = false;
  int fail_every = 0;
  int frames_back = 1;
  bool stateful = false;

  void visit(OptionVisitor& v) {
    v.choice("kind", kind,
             {{"mask", Kind::kMask},
              {"words", Kind::kWords},
              {"parts", Kind::kParts},
              {"track", Kind::kTrack}},
             "which stage to be");
    v.field("work_ms", work_ms, {0, 10000}, "ms", "time to take for each frame");
    v.field("impure", impure, "answer with a counter, which no stage may do");
    v.field("fail_every", fail_every, {0, 1000}, "frames",
            "throw for every frame whose seq divides by this; 0: never");
    v.field("frames_back", frames_back, {1, 100}, "frames", "which frame's words a track gets");
    v.field("stateful", stateful, "answer a function of all frames so far");
  }
  void validate() const { validate_fields(*this, "TestStageOptions"); }
};

std::unique_ptr<stage::Stage> make_stage(const Settings& settings);

/// A camera that gives random bytes, or the frames of a log again and again.
struct TestSourceOptions {
  std::string log;
  int bytes = 20'000;
  int frames = 0;

  void visit(OptionVisitor& v) {
    v.field("log", log, "whose RGBD_FRAME messages to give; none: random bytes");
    v.field("bytes", bytes, {0, 10'000'000}, "", "payload of a frame");
    v.field("frames", frames, {0, 1'000'000}, "", "how many before the end; 0: no end");
  }
  void validate() const { validate_fields(*this, "TestSourceOptions"); }
};

std::unique_ptr<stage::Source> make_source(const Settings& settings);

}  // namespace weft::test_stage
