#include "procs/capture/openni_camera.hpp"

#include <OpenNI.h>
#include <dlfcn.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <deque>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <opencv2/core.hpp>
#include <thread>

#include "base/error.hpp"

namespace weft::capture_process {
namespace {

namespace fs = std::filesystem;

std::string openni_error() {
  constexpr const char* kBlank = " \t\n";
  const std::string text = openni::OpenNI::getExtendedError();
  const std::size_t begin = text.find_first_not_of(kBlank);
  if (begin == std::string::npos) return "OpenNI2 gives no reason";
  return text.substr(begin, text.find_last_not_of(kBlank) + 1 - begin);
}

/// OpenNI2 counts initialisations; drivers are loaded by the first.
class Library {
 public:
  Library() {
    if (openni::OpenNI::initialize() != openni::STATUS_OK)
      throw Error("OpenNI2 cannot start: " + openni_error() + "; drivers are looked for in " +
                  drivers_folder());
  }
  ~Library() { openni::OpenNI::shutdown(); }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  /// Beside the library, unless /etc/openni2/OpenNI.ini names another.
  static std::string drivers_folder() {
    Dl_info info{};
    if (dladdr(reinterpret_cast<void*>(&oniInitialize), &info) == 0 || !info.dli_fname)
      return "OpenNI2/Drivers beside libOpenNI2.so.0";
    std::error_code ignored;
    return (fs::canonical(info.dli_fname, ignored).parent_path() / "OpenNI2/Drivers").string();
  }
};

std::string first_line(const fs::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  return line;
}

/// What a person needs to find out why there is no camera.
std::string what_was_looked_for() {
  std::string text = "\n  drivers: ";
  const std::string folder = Library::drivers_folder();
  std::error_code ignored;
  std::string names;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    names += " " + entry.path().filename().string();
  text += folder + (names.empty() ? " holds none; install libopenni2-0" : ":" + names);
  text +=
      "\n  USB devices of depth cameras (PrimeSense and ASUS 1d27, Orbbec 2bc5, Microsoft 045e): ";
  std::string devices;
  for (const auto& entry : fs::directory_iterator("/sys/bus/usb/devices", ignored)) {
    const std::string vendor = first_line(entry.path() / "idVendor");
    if (vendor != "1d27" && vendor != "2bc5" && vendor != "045e") continue;
    const auto number = [&](const char* name) {
      return std::string(3, '0') + first_line(entry.path() / name);
    };
    const std::string bus = number("busnum"), device = number("devnum");
    const std::string node =
        "/dev/bus/usb/" + bus.substr(bus.size() - 3) + "/" + device.substr(device.size() - 3);
    devices += "\n    " + vendor + ":" + first_line(entry.path() / "idProduct") + " " +
               first_line(entry.path() / "product") + " at " + node +
               (access(node.c_str(), W_OK) == 0
                    ? ""
                    : ", which this user may not write: a udev rule is missing, or unplug and "
                      "plug in again");
  }
  text += devices.empty() ? "none is connected" : devices;
  const char* rules = "/lib/udev/rules.d/60-libopenni2-0.rules";
  text += std::string("\n  udev rules: ") + rules +
          (fs::exists(rules) ? " is there" : " is missing; install libopenni2-0");
  return text + "\n  For a recording give the path of an .oni file.";
}

}  // namespace

class OpenNiCamera::Impl {
 public:
  Impl(const std::string& device, const OpenNiOptions& options) : options_(options) {
    options_.validate();
    const bool any = device == "any";
    const bool file = device.size() > 4 && device.substr(device.size() - 4) == ".oni";
    if (file && !fs::is_regular_file(device)) throw Error(device + ": no such recording");
    if (device_.open(any ? openni::ANY_DEVICE : device.c_str()) != openni::STATUS_OK) {
      if (file) throw Error(device + ": cannot be opened as a recording: " + openni_error());
      throw Error("no camera " + (any ? std::string() : "\"" + device + "\" ") +
                  "found: " + openni_error() + what_was_looked_for());
    }
    where_ = file ? device : device_.getDeviceInfo().getUri();
    if (!device_.hasSensor(openni::SENSOR_DEPTH) || !device_.hasSensor(openni::SENSOR_COLOR))
      throw Error(where_ + ": has no depth or no colour sensor");
    check(depth_.create(device_, openni::SENSOR_DEPTH), "its depth stream cannot be made");
    check(colour_.create(device_, openni::SENSOR_COLOR), "its colour stream cannot be made");
    if (device_.isFile()) {
      openni::PlaybackControl* playback = device_.getPlaybackControl();
      if (!playback) throw Error(where_ + ": cannot be played");
      // Its player spins at the end of a file that does not repeat, walking its list of streams
      // without a lock, and crashes when they go. A repeated one waits for somebody to read on; the
      // images' numbers tell where it starts over.
      playback->setRepeatEnabled(true);
      check(playback->setSpeed(-1.0f), "cannot be read frame by frame");
      const int depths = playback->getNumberOfFrames(depth_);
      const int colours = playback->getNumberOfFrames(colour_);
      frames_ = std::min(depths, colours);
      images_in_file_ = depths + colours;
    } else {
      set_mode(depth_, {openni::PIXEL_FORMAT_DEPTH_1_MM, openni::PIXEL_FORMAT_DEPTH_100_UM});
      set_mode(colour_, {openni::PIXEL_FORMAT_RGB888});
    }
    register_depth();
    // The images would otherwise be mirrored as in a looking glass.
    for (openni::VideoStream* stream : {&depth_, &colour_})
      if (!device_.isFile()) stream->setMirroringEnabled(false);
    mirrored_ = depth_.getMirroringEnabled();
    if (mirrored_ != colour_.getMirroringEnabled())
      throw Error(where_ + ": only one of depth and colour is mirrored");
    make_camera();
    check(depth_.start(), "its depth stream does not start");
    check(colour_.start(), "its colour stream does not start");
  }

  ~Impl() {
    for (auto& queue : waiting_) queue.clear();
    for (openni::VideoStream* stream : {&depth_, &colour_}) stream->stop();
    // The player may still be on its way from the last image to its wait for the next reader, past
    // that list of streams.
    if (device_.isFile()) std::this_thread::sleep_for(std::chrono::milliseconds(20));
    for (openni::VideoStream* stream : {&depth_, &colour_}) stream->destroy();
    device_.close();
  }

  bool next(rgbd::RgbdFrame& frame, std::int64_t& device_time_us, const std::stop_token& stop) {
    // Both streams run at one rate; images further apart than half a frame are no pair.
    const double rate = std::max(1, depth_.getVideoMode().getFps());
    const auto half_frame_us = static_cast<std::int64_t>(0.5e6 / rate);
    openni::VideoStream* streams[] = {&depth_, &colour_};
    double waited_s = 0.0;
    while (true) {
      while (!waiting_[0].empty() && !waiting_[1].empty()) {
        const auto apart = static_cast<std::int64_t>(waiting_[0].front().getTimestamp()) -
                           static_cast<std::int64_t>(waiting_[1].front().getTimestamp());
        if (std::abs(apart) <= half_frame_us) break;
        waiting_[apart < 0 ? 0 : 1].pop_front();  // the earlier one has no partner
      }
      if (!waiting_[0].empty() && !waiting_[1].empty()) break;
      if (stop.stop_requested() || (device_.isFile() && images_read_ == images_in_file_))
        return false;
      int ready = -1;
      // A recording plays one image for each wait that finds none. An event left over from the
      // image before, or a wait that ends too soon, would play two, of which one may push the other
      // out: so the event is taken first, and one wait is as long as all of them may take.
      if (device_.isFile()) {
        openni::VideoStream* nothing = nullptr;
        openni::OpenNI::waitForAnyStream(&nothing, 1, &ready, 0);
      }
      const int wait_ms = device_.isFile() ? static_cast<int>(options_.timeout_s * 1000.0) : 100;
      const openni::Status status = openni::OpenNI::waitForAnyStream(streams, 2, &ready, wait_ms);
      if (status == openni::STATUS_TIME_OUT) {
        waited_s += wait_ms / 1000.0;
        if (waited_s < options_.timeout_s) continue;
        throw Error(where_ + ": no pair of images for " + std::to_string(waited_s) +
                    (device_.isFile() ? " s; truncated?" : " s; is it still connected?"));
      }
      check(status, "waiting for images failed");
      openni::VideoFrameRef image;
      check(streams[ready]->readFrame(&image), "an image cannot be read");
      if (device_.isFile()) {
        const int number = image.getFrameIndex();
        if (number <= last_numbers_[ready]) {  // one was lost, and the file has started over
          images_read_ = images_in_file_;
          continue;
        }
        last_numbers_[ready] = number;
        ++images_read_;
      }
      // In a file that a busy machine recorded, one stream may run ahead of the other.
      const std::size_t most_waiting = device_.isFile() ? 64 : 8;
      if (waiting_[ready].size() == most_waiting) waiting_[ready].pop_front();
      waiting_[ready].push_back(image);
    }
    const openni::VideoFrameRef depth = waiting_[0].front(), colour = waiting_[1].front();
    for (auto& queue : waiting_) queue.pop_front();
    frame.camera = camera_;
    frame.source = where_;
    frame.depth_unit_m = depth_unit_m_;
    frame.depth = copy(depth, CV_16UC1);
    const cv::Mat rgb = copy(colour, CV_8UC3);
    frame.colour.create(rgb.size(), CV_8UC3);
    constexpr int kSwap[] = {0, 2, 1, 1, 2, 0};
    cv::mixChannels(&rgb, 1, &frame.colour, 1, kSwap, 3);
    if (mirrored_) {
      cv::flip(frame.depth, frame.depth, 1);
      cv::flip(frame.colour, frame.colour, 1);
    }
    device_time_us = static_cast<std::int64_t>(depth.getTimestamp());
    return true;
  }

  bool is_recording() const { return device_.isFile(); }
  int frame_count() const { return frames_; }

 private:
  void check(openni::Status status, const char* what) const {
    if (status != openni::STATUS_OK) throw Error(where_ + ": " + what + ": " + openni_error());
  }

  void set_mode(openni::VideoStream& stream, std::initializer_list<openni::PixelFormat> formats) {
    const auto& modes = stream.getSensorInfo().getSupportedVideoModes();
    std::string offered;
    for (const openni::PixelFormat format : formats) {
      for (int i = 0; i < modes.getSize(); ++i) {
        const openni::VideoMode& mode = modes[i];
        if (mode.getPixelFormat() != format) continue;
        if (mode.getResolutionX() == options_.width_px &&
            mode.getResolutionY() == options_.height_px && mode.getFps() == options_.rate_hz)
          return check(stream.setVideoMode(mode), "a video mode that it offers cannot be set");
        offered += " " + std::to_string(mode.getResolutionX()) + "x" +
                   std::to_string(mode.getResolutionY()) + "@" + std::to_string(mode.getFps());
      }
    }
    throw Error(where_ + ": offers no " +
                (&stream == &depth_ ? std::string("depth") : std::string("colour")) + " of " +
                std::to_string(options_.width_px) + "x" + std::to_string(options_.height_px) + "@" +
                std::to_string(options_.rate_hz) + "; it offers" + offered);
  }

  void register_depth() {
    constexpr auto kMode = openni::IMAGE_REGISTRATION_DEPTH_TO_COLOR;
    if (device_.isFile()) return;  // the format does not even say whether it was registered
    if (device_.isImageRegistrationModeSupported(kMode))
      check(device_.setImageRegistrationMode(kMode), "depth cannot be registered to colour");
    else if (options_.require_registration)
      throw Error(where_ + ": cannot register its depth to its colour; set " +
                  "openni.require_registration=false to take it as it is");
    // Not every camera can; pairs are found by their times all the same.
    device_.setDepthColorSyncEnabled(true);
  }

  void make_camera() {
    const openni::VideoMode depth = depth_.getVideoMode(), colour = colour_.getVideoMode();
    if (depth.getResolutionX() != colour.getResolutionX() ||
        depth.getResolutionY() != colour.getResolutionY()) {
      throw Error(where_ + ": depth of " + std::to_string(depth.getResolutionX()) + "x" +
                  std::to_string(depth.getResolutionY()) + " and colour of " +
                  std::to_string(colour.getResolutionX()) + "x" +
                  std::to_string(colour.getResolutionY()) + " px differ");
    }
    if (colour.getPixelFormat() != openni::PIXEL_FORMAT_RGB888)
      throw Error(where_ + ": its colour is not RGB888");
    switch (depth.getPixelFormat()) {
      case openni::PIXEL_FORMAT_DEPTH_1_MM:
        depth_unit_m_ = 0.001;
        break;
      case openni::PIXEL_FORMAT_DEPTH_100_UM:
        depth_unit_m_ = 0.0001;
        break;
      default:
        throw Error(where_ + ": its depth is in neither 1 mm nor 100 um");
    }
    camera_.width = depth.getResolutionX();
    camera_.height = depth.getResolutionY();
    // Registered depth is seen by the colour camera.
    const double fov = colour_.getHorizontalFieldOfView();
    if (options_.fx_px <= 0.0 && !(fov > 0.1 && fov < 3.0))
      throw Error(where_ + ": gives no usable field of view (" + std::to_string(fov) +
                  " rad); set openni.fx_px");
    camera_.fx = options_.fx_px > 0.0 ? options_.fx_px : camera_.width / (2.0 * std::tan(fov / 2));
    camera_.fy = options_.fy_px > 0.0 ? options_.fy_px : camera_.fx;
    camera_.cx = options_.cx_px >= 0.0 ? options_.cx_px : (camera_.width - 1) / 2.0;
    camera_.cy = options_.cy_px >= 0.0 ? options_.cy_px : (camera_.height - 1) / 2.0;
    camera_.validate(where_);
  }

  cv::Mat copy(const openni::VideoFrameRef& image, int type) const {
    const cv::Size size(camera_.width, camera_.height);
    const int row_bytes = size.width * static_cast<int>(CV_ELEM_SIZE(type));
    if (image.getWidth() != size.width || image.getHeight() != size.height ||
        image.getStrideInBytes() < row_bytes ||
        image.getDataSize() < (size.height - 1) * image.getStrideInBytes() + row_bytes) {
      throw Error(where_ + ": an image of " + std::to_string(image.getWidth()) + "x" +
                  std::to_string(image.getHeight()) + " px and " +
                  std::to_string(image.getDataSize()) + " bytes is not of the stream's size");
    }
    return cv::Mat(size, type, const_cast<void*>(image.getData()),
                   static_cast<std::size_t>(image.getStrideInBytes()))
        .clone();
  }

  Library library_;
  OpenNiOptions options_;
  std::string where_;
  openni::Device device_;
  openni::VideoStream depth_, colour_;
  rgbd::CameraModel camera_;
  double depth_unit_m_ = 0.001;
  bool mirrored_ = false;
  int frames_ = 0;
  int images_read_ = 0, images_in_file_ = 0;
  int last_numbers_[2] = {0, 0};                  // of the depth and colour image read from a file
  std::deque<openni::VideoFrameRef> waiting_[2];  // depth and colour without their partner yet
};

OpenNiCamera::OpenNiCamera(const std::string& device, const OpenNiOptions& options)
    : impl_(std::make_unique<Impl>(device, options)) {}
OpenNiCamera::~OpenNiCamera() = default;
bool OpenNiCamera::next(rgbd::RgbdFrame& frame, std::int64_t& device_time_us,
                        const std::stop_token& stop) {
  return impl_->next(frame, device_time_us, stop);
}
bool OpenNiCamera::is_recording() const { return impl_->is_recording(); }
int OpenNiCamera::frame_count() const { return impl_->frame_count(); }

}  // namespace weft::capture_process
