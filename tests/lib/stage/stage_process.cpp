#include <atomic>
#include <chrono>
#include <thread>

#include "base/settings.hpp"
#include "fake_stage.hpp"
#include "stage/process.hpp"
#include "stage/source.hpp"

/// The processes of the network tests: stage_process counter|joiner|source [options].
namespace weft::stage {
namespace {

using namespace fake;

struct TestOptions {
  int delay_ms = 0;
  int data_bytes = 100;
  int fail_at = -1;
  void visit(OptionVisitor& v) {
    v.field("delay_ms", delay_ms, {0, 60'000}, "ms", "how long a frame takes");
    v.field("data_bytes", data_bytes, {0, 20'000'000}, "", "size of a source's frames");
    v.field("fail_at", fail_at, {-1, 1'000'000}, "", "seq of the frame that cannot be read");
  }
  void validate() const { validate_fields(*this, "TestOptions"); }
};

TestOptions options_of(const Settings& settings) {
  TestOptions options;
  settings.read(options);
  return options;
}

std::unique_ptr<Stage> slow(FakeStage fast, const Settings& settings) {
  const TestOptions options = options_of(settings);
  Interface interface = fast.interface();
  interface.settings_hash = options_hash(options);
  return std::make_unique<FakeStage>(
      interface, [fast, options](const Inputs& in, Outputs& out) mutable {
        std::this_thread::sleep_for(std::chrono::milliseconds(options.delay_ms));
        fast.process(in, out);
      });
}

class TestSource : public Source {
 public:
  explicit TestSource(const TestOptions& options) : options_(options) {
    interface_.name = "source";
    interface_.outputs = {port<rgbd_frame_t>("RGBD_FRAME")};
  }
  const Interface& interface() const override { return interface_; }
  bool next(Outputs& outputs, const std::stop_token&) override {
    auto& m = outputs.at<rgbd_frame_t>("RGBD_FRAME");
    if (m.header.seq == options_.fail_at) throw Error("this frame cannot be read");
    m = frame(m.header, static_cast<std::size_t>(options_.data_bytes));
    return true;
  }

 private:
  TestOptions options_;
  Interface interface_;
};

}  // namespace
}  // namespace weft::stage

int main(int argc, char** argv) {
  using namespace weft::stage;
  const std::string mode = argc > 1 ? argv[1] : "";
  const std::string reference = weft::options_to_yaml(TestOptions());
  if (mode == "source") {
    return run_source(
        argc - 1, argv + 1, "test-source", "A source for tests",
        [](const weft::Settings& settings) {
          return std::make_unique<TestSource>(options_of(settings));
        },
        reference);
  }
  return run_process(
      argc - 1, argv + 1, "test-" + mode, "A stage for tests",
      [mode](const weft::Settings& settings) {
        return slow(mode == "joiner" ? fake::joiner() : fake::counter(), settings);
      },
      reference);
}
