#include "base/options.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"
#include "base/settings.hpp"

namespace weft {
namespace {

enum class Mode { kOff, kHard };

struct Inner {
  double scale = 2.0;
  void visit(OptionVisitor& v) { v.field("scale", scale, {0.5, 4.0}, "m", "inner scale"); }
};

struct Options {
  int step_px = 6;
  bool live = true;
  std::string file = "a";
  std::vector<double> pose;
  Mode mode = Mode::kOff;
  Inner inner;
  void visit(OptionVisitor& v) {
    v.field("step_px", step_px, {1, 64}, "px", "grid step");
    v.field("live", live, "live or not");
    v.field("file", file, "a file");
    v.field("pose", pose, {0, 3}, "m", "a pose");
    v.choice("mode", mode, {{"off", Mode::kOff}, {"hard", Mode::kHard}}, "a mode");
    v.group("inner", inner);
  }
  void validate() const { validate_fields(*this, "Options"); }
};

std::string error_of(const std::string& yaml) {
  Options options;
  try {
    Settings::from_text(yaml, "x.yaml").read(options);
  } catch (const Error& e) {
    return e.what();
  }
  return "";
}

TEST(Settings, ReadsEveryKindOfField) {
  Options options;
  Settings::from_text(
      "step_px: 3\nlive: false\nfile: b\npose: [1, 2]\nmode: hard\ninner: {scale: 4}", "x")
      .read(options);
  EXPECT_EQ(options.step_px, 3);
  EXPECT_FALSE(options.live);
  EXPECT_EQ(options.file, "b");
  EXPECT_EQ(options.pose, (std::vector<double>{1, 2}));
  EXPECT_EQ(options.mode, Mode::kHard);
  EXPECT_EQ(options.inner.scale, 4.0);
}

TEST(Settings, ErrorsNameFileLineKeyAndWhatWasExpected) {
  EXPECT_EQ(
      error_of("live: true\nstep: 3"),
      "x.yaml:2: unknown key 'step'; expected one of: file, inner, live, mode, pose, step_px");
  EXPECT_EQ(error_of("inner:\n  scales: 3"),
            "x.yaml:2: unknown key 'inner.scales'; expected one of: scale");
  EXPECT_EQ(error_of("\nstep_px: few"), "x.yaml:2: step_px is 'few'; expected a whole number");
  EXPECT_EQ(error_of("step_px: 0"), "x.yaml:1: option step_px is 0; it must be 1 to 64 px");
  EXPECT_EQ(error_of("inner:\n  scale: .nan"),
            "x.yaml:2: option inner.scale is nan; it must be a finite number");
  EXPECT_EQ(error_of("mode: soft"), "x.yaml:1: mode is 'soft'; expected one of: off, hard");
  EXPECT_EQ(error_of("pose: [1,2,3,4]"),
            "x.yaml:1: option pose is a list of 4; it must be a list of 0 to 3 numbers");
  EXPECT_NE(error_of("a: [").find("x.yaml:1: not valid YAML"), std::string::npos);
  EXPECT_EQ(error_of("- 1"), "x.yaml:1: expected a map of settings (key: value lines)");
}

TEST(Settings, LaterSettingsWin) {
  auto settings = Settings::from_text("step_px: 3\ninner: {scale: 1}", "x");
  settings.set("inner.scale=3");
  Options options;
  settings.read(options);
  EXPECT_EQ(options.step_px, 3);
  EXPECT_EQ(options.inner.scale, 3.0);
  EXPECT_THROW(settings.set("nothing"), Error);
}

TEST(Settings, AnErrorNamesWhereTheSettingWasWritten) {
  const auto error_after = [](const std::string& assignment, const std::string& from = "") {
    auto settings = Settings::from_text("step_px: 3\ninner: {scale: 1}", "x.yaml");
    try {
      settings.set(assignment, from);
      Options options;
      Settings(settings).read(options);
    } catch (const Error& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  EXPECT_EQ(error_after("scale=3"),
            "--set scale=3: unknown key 'scale'; expected one of: file, inner, live, mode, pose, "
            "step_px");
  EXPECT_EQ(error_after("inner.scales=3", "set.yaml:7"),
            "set.yaml:7: unknown key 'inner.scales'; expected one of: scale");
  EXPECT_EQ(error_after("new.group.key=3", "set.yaml:7").substr(0, 27),
            "set.yaml:7: unknown key 'ne");
  EXPECT_EQ(error_after("step_px=few", "set.yaml:7"),
            "set.yaml:7: step_px is 'few'; expected a whole number");
  EXPECT_EQ(error_after("inner.scale=.nan", "set.yaml:7"),
            "set.yaml:7: option inner.scale is nan; it must be a finite number");
  EXPECT_EQ(error_after("inner.scale=2"), "");
}

TEST(Options, HashFollowsValuesAndPrintingReadsBack) {
  Options a, b;
  EXPECT_EQ(options_hash(a), options_hash(b));
  b.inner.scale = 2.5;
  EXPECT_NE(options_hash(a), options_hash(b));
  Options c;
  Settings::from_text(options_to_yaml(b), "printed").read(c);
  EXPECT_EQ(options_hash(b), options_hash(c));
}

TEST(SettingsPath, IsRelativeToTheSettingsFile) {
  EXPECT_EQ(Settings::from_text("", "/set/stages/score.yaml").path("../models/x.blob"),
            "/set/models/x.blob");
  EXPECT_EQ(Settings::from_text("", "/set/stages/score.yaml").path("/models/x.blob"),
            "/models/x.blob");
  EXPECT_EQ(Settings::empty("weft-score").path("models/x.blob"), "models/x.blob");
}

}  // namespace
}  // namespace weft
