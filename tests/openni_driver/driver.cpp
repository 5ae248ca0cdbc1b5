#include <Driver/OniDriverAPI.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <thread>

#include "openni_driver/scene.hpp"

/// An OpenNI2 driver plug-in with one camera that serves the frames of scene.hpp.
namespace {

using weft::test::DriverScene;
using weft::test::kDriverFrames;
using weft::test::kDriverRateHz;

constexpr std::pair<int, int> kSizes[] = {{640, 480}, {320, 240}, {1280, 720}};

OniVideoMode mode_of(OniSensorType type, int width, int height) {
  return {type == ONI_SENSOR_DEPTH ? ONI_PIXEL_FORMAT_DEPTH_1_MM : ONI_PIXEL_FORMAT_RGB888, width,
          height, kDriverRateHz};
}

template <class T>
OniStatus put(const T& value, void* data, int* size) {
  if (*size < static_cast<int>(sizeof value)) return ONI_STATUS_BAD_PARAMETER;
  std::memcpy(data, &value, sizeof value);
  *size = sizeof value;
  return ONI_STATUS_OK;
}

class Stream : public oni::driver::StreamBase {
 public:
  Stream(OniSensorType type, const OniImageRegistrationMode& registration)
      : type_(type), registration_(registration), mode_(mode_of(type, 640, 480)) {}
  ~Stream() override { stop(); }

  OniStatus start() override {
    running_ = true;
    thread_ = std::thread([this] { serve(); });
    return ONI_STATUS_OK;
  }
  void stop() override {
    running_ = false;
    if (thread_.joinable()) thread_.join();
  }

  OniBool isPropertySupported(int id) override {
    return id == ONI_STREAM_PROPERTY_VIDEO_MODE || id == ONI_STREAM_PROPERTY_MIRRORING ||
           id == ONI_STREAM_PROPERTY_CROPPING || id == ONI_STREAM_PROPERTY_STRIDE ||
           id == ONI_STREAM_PROPERTY_HORIZONTAL_FOV || id == ONI_STREAM_PROPERTY_VERTICAL_FOV ||
           id == ONI_STREAM_PROPERTY_MAX_VALUE || id == ONI_STREAM_PROPERTY_MIN_VALUE;
  }
  OniStatus getProperty(int id, void* data, int* size) override {
    switch (id) {
      case ONI_STREAM_PROPERTY_VIDEO_MODE:
        return put(mode_, data, size);
      case ONI_STREAM_PROPERTY_MIRRORING:
        return put(OniBool{FALSE}, data, size);
      // Without cropping, a recording of the stream cannot be played back.
      case ONI_STREAM_PROPERTY_CROPPING:
        return put(OniCropping{FALSE, 0, 0, mode_.resolutionX, mode_.resolutionY}, data, size);
      case ONI_STREAM_PROPERTY_STRIDE:
        return put(mode_.resolutionX * (type_ == ONI_SENSOR_DEPTH ? 2 : 3), data, size);
      case ONI_STREAM_PROPERTY_HORIZONTAL_FOV:
      case ONI_STREAM_PROPERTY_VERTICAL_FOV:
        return put(weft::test::kDriverFieldOfViewRad, data, size);
      case ONI_STREAM_PROPERTY_MAX_VALUE:
        return put(int{10000}, data, size);
      case ONI_STREAM_PROPERTY_MIN_VALUE:
        return put(int{0}, data, size);
      default:
        return ONI_STATUS_NOT_IMPLEMENTED;
    }
  }
  OniStatus setProperty(int id, const void* data, int size) override {
    if (id == ONI_STREAM_PROPERTY_MIRRORING) return ONI_STATUS_OK;
    if (id != ONI_STREAM_PROPERTY_VIDEO_MODE || size != sizeof mode_)
      return ONI_STATUS_NOT_IMPLEMENTED;
    std::memcpy(&mode_, data, sizeof mode_);
    return ONI_STATUS_OK;
  }
  /// The recorder asks for everything it writes down.
  void notifyAllProperties() override {
    raisePropertyChanged(ONI_STREAM_PROPERTY_VIDEO_MODE, &mode_, sizeof mode_);
    const float fov = weft::test::kDriverFieldOfViewRad;
    raisePropertyChanged(ONI_STREAM_PROPERTY_HORIZONTAL_FOV, &fov, sizeof fov);
    raisePropertyChanged(ONI_STREAM_PROPERTY_VERTICAL_FOV, &fov, sizeof fov);
    const OniBool mirrored = FALSE;
    raisePropertyChanged(ONI_STREAM_PROPERTY_MIRRORING, &mirrored, sizeof mirrored);
    const int largest = 10000;
    raisePropertyChanged(ONI_STREAM_PROPERTY_MAX_VALUE, &largest, sizeof largest);
  }

 private:
  void serve() {
    // Slower than its time stamps say, so that a busy machine drops few frames.
    constexpr auto kPeriod = std::chrono::milliseconds(60);
    // A recorder misses what comes too early, and then shifts that stream's times against the
    // other's.
    constexpr auto kWarmUp = std::chrono::milliseconds(300);
    std::this_thread::sleep_for(kWarmUp);
    auto due = std::chrono::steady_clock::now();
    for (int frame = 0; running_ && frame < kDriverFrames; ++frame) {
      OniFrame* out = getServices().acquireFrame();
      if (!out) return;
      const DriverScene scene{mode_.resolutionX, mode_.resolutionY};
      const bool depth = type_ == ONI_SENSOR_DEPTH;
      out->frameIndex = frame + 1;
      out->timestamp = static_cast<std::uint64_t>(frame) * 1'000'000 / kDriverRateHz;
      out->sensorType = type_;
      out->videoMode = mode_;
      out->width = scene.width;
      out->height = scene.height;
      out->croppingEnabled = FALSE;
      out->cropOriginX = out->cropOriginY = 0;
      out->stride = scene.width * (depth ? 2 : 3);
      out->dataSize = out->stride * scene.height;
      auto* bytes = static_cast<std::uint8_t*>(out->data);
      for (int v = 0; v < scene.height; ++v) {
        for (int u = 0; u < scene.width; ++u) {
          if (depth) {
            // Not registered, it shows something else.
            const bool registered = registration_ == ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR;
            const std::uint16_t value = registered ? scene.depth(frame, u, v) : 1;
            std::memcpy(bytes, &value, sizeof value);
            bytes += sizeof value;
          } else {
            for (int channel = 0; channel < 3; ++channel)
              *bytes++ = scene.colour(frame, u, v, channel);
          }
        }
      }
      raiseNewFrame(out);
      getServices().releaseFrame(out);
      due += kPeriod;
      std::this_thread::sleep_until(due);
    }
  }

  OniSensorType type_;
  const OniImageRegistrationMode& registration_;  // of the device
  OniVideoMode mode_;
  std::atomic<bool> running_ = false;
  std::thread thread_;
};

class Device : public oni::driver::DeviceBase {
 public:
  Device() {
    const OniSensorType types[] = {ONI_SENSOR_DEPTH, ONI_SENSOR_COLOR};
    for (int t = 0; t < 2; ++t) {
      for (int i = 0; i < 3; ++i)
        modes_[t][i] = mode_of(types[t], kSizes[i].first, kSizes[i].second);
      sensors_[t] = {types[t], 3, modes_[t]};
    }
  }
  OniStatus getSensorInfoList(OniSensorInfo** sensors, int* count) override {
    *sensors = sensors_;
    *count = 2;
    return ONI_STATUS_OK;
  }
  oni::driver::StreamBase* createStream(OniSensorType type) override {
    return new Stream(type, registration_);
  }
  void destroyStream(oni::driver::StreamBase* stream) override { delete stream; }

  OniBool isPropertySupported(int id) override {
    return id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION;
  }
  OniStatus getProperty(int id, void* data, int* size) override {
    if (id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION) return put(registration_, data, size);
    return ONI_STATUS_NOT_IMPLEMENTED;
  }
  OniStatus setProperty(int id, const void* data, int size) override {
    if (id != ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION || size != sizeof registration_)
      return ONI_STATUS_NOT_IMPLEMENTED;
    std::memcpy(&registration_, data, sizeof registration_);
    return ONI_STATUS_OK;
  }
  void notifyAllProperties() override {
    raisePropertyChanged(ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION, &registration_,
                         sizeof registration_);
  }
  OniBool isImageRegistrationModeSupported(OniImageRegistrationMode) override { return TRUE; }

 private:
  OniVideoMode modes_[2][3];
  OniSensorInfo sensors_[2];
  OniImageRegistrationMode registration_ = ONI_IMAGE_REGISTRATION_OFF;
};

class Driver : public oni::driver::DriverBase {
 public:
  explicit Driver(OniDriverServices* services) : DriverBase(services) {
    std::strcpy(info_.uri, weft::test::kDriverUri);
    std::strcpy(info_.vendor, "Weft");
    std::strcpy(info_.name, "test camera");
    info_.usbVendorId = info_.usbProductId = 0;
  }
  OniStatus initialize(oni::driver::DeviceConnectedCallback connected,
                       oni::driver::DeviceDisconnectedCallback disconnected,
                       oni::driver::DeviceStateChangedCallback changed, void* cookie) override {
    const OniStatus status = DriverBase::initialize(connected, disconnected, changed, cookie);
    deviceConnected(&info_);
    return status;
  }
  oni::driver::DeviceBase* deviceOpen(const char*, const char*) override { return new Device; }
  void deviceClose(oni::driver::DeviceBase* device) override { delete device; }
  OniStatus tryDevice(const char* uri) override {
    return std::strcmp(uri, weft::test::kDriverUri) == 0 ? ONI_STATUS_OK : ONI_STATUS_ERROR;
  }
  void shutdown() override {}

 private:
  OniDeviceInfo info_{};
};

}  // namespace

// What the macro of the API needs and its headers do not bring.
#define XN_NEW(type, ...) new type(__VA_ARGS__)
#define XN_DELETE(p) delete (p)
ONI_EXPORT_DRIVER(Driver)
