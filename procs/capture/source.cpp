#include "procs/capture/source.hpp"

#include "base/hash.hpp"
#include "dataset/sequence.hpp"

namespace weft::capture_process {
namespace {

constexpr const char* kChannel = "RGBD_FRAME";

stage::Interface make_interface(const CaptureOptions& options) {
  stage::Interface interface;
  interface.name = "capture";
  interface.outputs = {stage::port<rgbd_frame_t>(kChannel)};
  interface.settings_hash = options_hash(options);
  return interface;
}

/// Scans from files, in the order of their names. Their time of measurement is not known: it is the
/// time of the call.
class ScanSource : public CaptureSource {
 public:
  ScanSource(const CaptureOptions& options, std::unique_ptr<dataset::Dataset> set)
      : options_(options), interface_(make_interface(options)), set_(std::move(set)) {}

  const stage::Interface& interface() const override { return interface_; }
  long frame_count() const override {
    return static_cast<long>(set_->names().size()) * options_.loop;
  }
  std::int64_t default_session() const override {
    // Where the files lie is left out, so that the same files give the same log everywhere.
    CaptureOptions content = options_;
    content.dataset = content.colour = content.depth = content.pcd = "";
    Hash64 hash;
    hash.add(options_hash(content));
    for (const std::string& name : set_->names()) hash.add(name);
    return static_cast<std::int64_t>(hash.value() >> 1);
  }

  bool next(stage::Outputs& outputs, const std::stop_token& stop) override {
    const std::size_t count = set_->names().size();
    if (stop.stop_requested() || count == 0) return false;
    if (at_ == count && (options_.loop == 0 || ++rounds_ < options_.loop)) at_ = 0;
    if (at_ == count) return false;
    // Counted before anything can fail: a broken scan must not be tried for ever.
    const dataset::Scene scene = set_->read(at_++);
    messages::to_message(scene.frame, options_.encoding, outputs.at<rgbd_frame_t>(kChannel));
    return true;
  }

 private:
  CaptureOptions options_;
  stage::Interface interface_;
  std::unique_ptr<dataset::Dataset> set_;
  std::size_t at_ = 0;
  int rounds_ = 0;
};

/// A recording of a moving camera, with its own times.
class RecordingSource : public CaptureSource {
 public:
  RecordingSource(const CaptureOptions& options, dataset::Sequence sequence)
      : options_(options), interface_(make_interface(options)), sequence_(std::move(sequence)) {
    const auto& frames = sequence_.frames;
    const std::int64_t length_us = frames.back().utime - frames.front().utime;
    const auto steps = static_cast<std::int64_t>(frames.size()) - 1;
    round_us_ = length_us + (steps > 0 ? length_us / steps : 100'000);
  }

  const stage::Interface& interface() const override { return interface_; }
  long frame_count() const override {
    return static_cast<long>(sequence_.frames.size()) * options_.loop;
  }
  std::int64_t default_session() const override {
    CaptureOptions content = options_;
    content.dataset.clear();
    Hash64 hash;
    hash.add(options_hash(content));
    for (const auto& frame : sequence_.frames) hash.add(std::to_string(frame.utime));
    return static_cast<std::int64_t>(hash.value() >> 1);
  }

  bool next(stage::Outputs& outputs, const std::stop_token& stop) override {
    if (stop.stop_requested()) return false;
    if (at_ == sequence_.frames.size()) {
      at_ = 0;
      ++rounds_;
    }
    if (options_.loop > 0 && rounds_ >= options_.loop) return false;
    rgbd_frame_t& message = outputs.at<rgbd_frame_t>(kChannel);
    message.header.utime = sequence_.frames[at_].utime + rounds_ * round_us_;
    rgbd::RgbdFrame frame = sequence_.read(at_++);
    // Without the folder's name, so that the same files give the same log everywhere.
    frame.source = frame.source.substr(frame.source.rfind('/') + 1);
    messages::to_message(frame, options_.encoding, message);
    return true;
  }

 private:
  CaptureOptions options_;
  stage::Interface interface_;
  dataset::Sequence sequence_;
  std::int64_t round_us_ = 0;
  std::size_t at_ = 0;
  int rounds_ = 0;
};

class CameraSource : public CaptureSource {
 public:
  CameraSource(const CaptureOptions& options, const std::string& device)
      : options_(options), interface_(make_interface(options)), camera_(device, options.openni) {}

  const stage::Interface& interface() const override { return interface_; }
  long frame_count() const override { return camera_.frame_count(); }
  std::int64_t default_session() const override {
    return static_cast<std::int64_t>(options_hash(options_) >> 1);
  }

  bool next(stage::Outputs& outputs, const std::stop_token& stop) override {
    rgbd::RgbdFrame frame;
    std::int64_t device_time_us = 0;
    if (!camera_.next(frame, device_time_us, stop)) return false;
    rgbd_frame_t& message = outputs.at<rgbd_frame_t>(kChannel);
    // A recording keeps the intervals between its frames, from the first one on.
    if (camera_.is_recording()) {
      if (offset_us_ == 0) offset_us_ = message.header.utime - device_time_us;
      message.header.utime = device_time_us + offset_us_;
    }
    messages::to_message(frame, options_.encoding, message);
    return true;
  }

 private:
  CaptureOptions options_;
  stage::Interface interface_;
  OpenNiCamera camera_;
  std::int64_t offset_us_ = 0;
};

/// As dataset::sequence_kind has it; empty: any.
std::string format_name(CaptureOptions::Format format) {
  switch (format) {
    case CaptureOptions::Format::kTum:
      return "tum";
    case CaptureOptions::Format::kCubeSlam:
      return "cube_slam";
    case CaptureOptions::Format::kSevenScenes:
      return "7scenes";
    case CaptureOptions::Format::kIcl:
      return "icl";
    case CaptureOptions::Format::kAuto:
    case CaptureOptions::Format::kScans:
      break;
  }
  return "";
}

}  // namespace

void CaptureOptions::validate() const {
  validate_fields(*this, "CaptureOptions");
  views.validate();
  scans.validate();
  openni.validate();
  encoding.validate();
  const bool pair = !colour.empty() || !depth.empty();
  if (!dataset.empty() + pair + !pcd.empty() + !device.empty() != 1) {
    throw Error(
        "capture: exactly one source is needed: dataset=FOLDER, colour=IMAGE with depth=IMAGE, "
        "pcd=FILE or device=any|URI|FILE.oni");
  }
  if (pair && (colour.empty() || depth.empty()))
    throw Error("capture: a pair needs both colour=IMAGE and depth=IMAGE");
}

std::unique_ptr<CaptureSource> make_source(const Settings& settings) {
  CaptureOptions options;
  settings.read(options);
  if (!options.device.empty()) {
    const bool file =
        options.device.size() > 4 && options.device.substr(options.device.size() - 4) == ".oni";
    return std::make_unique<CameraSource>(options,
                                          file ? settings.path(options.device) : options.device);
  }
  if (!options.dataset.empty() && options.format != CaptureOptions::Format::kScans) {
    const std::string folder = settings.path(options.dataset);
    const std::string kind = dataset::sequence_kind(folder);
    const std::string wanted = format_name(options.format);
    if (!wanted.empty() && kind != wanted)
      throw Error(folder + ": no recording of format " + wanted +
                  (kind.empty() ? "" : "; it looks like " + kind));
    if (!kind.empty()) {
      if (options.views.rotations > 1 || options.views.mirror)
        throw Error(folder +
                    ": a recording is not shown rotated or mirrored; format=pairs takes "
                    "its frames as single scans");
      return std::make_unique<RecordingSource>(options, dataset::open_sequence(folder));
    }
  }
  auto set = !options.dataset.empty()
                 ? dataset::open_dataset(settings.path(options.dataset), options.scans)
             : !options.pcd.empty()
                 ? dataset::open_scan(settings.path(options.pcd), "", options.scans)
                 : dataset::open_scan(settings.path(options.colour), settings.path(options.depth),
                                      options.scans);
  if (options.views.rotations > 1 || options.views.mirror)
    set = dataset::augment(std::move(set), options.views);
  return std::make_unique<ScanSource>(options, std::move(set));
}

std::string settings_reference() { return options_to_yaml(CaptureOptions{}); }

}  // namespace weft::capture_process
