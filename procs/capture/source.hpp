#pragma once

#include <memory>
#include <string>

#include "base/settings.hpp"
#include "dataset/augment.hpp"
#include "dataset/scene.hpp"
#include "messages/rgbd.hpp"
#include "procs/capture/openni_camera.hpp"
#include "stage/source.hpp"

/// weft-capture: colour and registered depth from a camera, a recording or files to RGBD_FRAME.
namespace weft::capture_process {

struct CaptureOptions {
  enum class Format { kAuto, kTum, kCubeSlam, kSevenScenes, kIcl, kScans };
  std::string dataset;
  Format format = Format::kAuto;
  std::string colour;
  std::string depth;
  std::string pcd;
  std::string device;
  int loop = 1;
  dataset::AugmentOptions views;
  dataset::DatasetOptions scans;
  OpenNiOptions openni;
  messages::FrameEncoding encoding;

  void visit(OptionVisitor& v) {
    v.field("dataset", dataset, "folder of scans, or of a recording of a moving camera");
    v.choice("format", format,
             {{"auto", Format::kAuto},
              {"tum", Format::kTum},
              {"cube_slam", Format::kCubeSlam},
              {"7scenes", Format::kSevenScenes},
              {"icl", Format::kIcl},
              {"pairs", Format::kScans}},
             "what the folder holds; auto: told from its files, a recording before scans. pairs: "
             "single scans (image pairs, IRI layout, CTU, clouds), whatever else it looks like");
    v.field("colour", colour, "colour image of one pair, PNG or JPEG");
    v.field("depth", depth, "depth image of the pair, 16-bit PNG");
    v.field("pcd", pcd, "one organised cloud");
    v.field("device", device, "OpenNI2 camera: any, its URI, or an .oni recording");
    v.field("loop", loop, {0, 1000000}, "",
            "how often the scans or frames of a folder are shown; 0: without end");
    v.group("views", views);
    v.group("scans", scans);
    v.group("openni", openni);
    v.group("encoding", encoding);
  }
  /// Exactly one of dataset, colour with depth, pcd and device must be given.
  void validate() const;
};

/// What a source will give, as far as it knows.
class CaptureSource : public stage::Source {
 public:
  /// Frames in all; 0 when there is no end or it is not known.
  virtual long frame_count() const = 0;
  /// Tells sources apart whose frames differ; the same for the same files and settings everywhere.
  virtual std::int64_t default_session() const = 0;
};

/// Opens what the settings name. Throws Error when it cannot be opened.
std::unique_ptr<CaptureSource> make_source(const Settings& settings);
std::string settings_reference();

}  // namespace weft::capture_process
