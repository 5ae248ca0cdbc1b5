#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "synth/coco.hpp"
#include "synth/dataset_maker.hpp"
#include "synth/room_scene.hpp"

/// Garments on desks in rooms: what the sets of images (states_maker.hpp) and of sequences
/// (sequences_maker.hpp) have in common.
namespace weft::synth {

struct StatesProgress {
  const char* stage = "";  // what is counted: simulations, meshes, images, frames
  int done = 0, total = 0;
  double seconds_left = -1.0;  // of the stage; negative: not known yet
  int given_up = 0;            // simulations
  bool stopped = false;
};

using StatesReport = std::function<void(const StatesProgress&)>;

constexpr int kMinInstancePixels = 64;  // of an annotated instance

/// A simulated garment of a set.
struct Source {
  std::string path, name, garment, state;
  bool shows_parts = false;  // it has some, and lies face up
  bool test = false;
};

Random random_of(int seed, const std::string& purpose, int index);

/// Runs work(0) to work(count - 1) on `jobs` threads; the first error ends it and is thrown.
/// False when stopped() did.
bool run_all(const char* stage, int count, int jobs, const std::function<void(int)>& work,
             const StatesReport& report, const std::function<bool()>& stopped);

/// Simulations in their order; test: every fourth of a state. complete: none is still to be made.
std::vector<Source> get_simulations(SimulationSource& simulations, int jobs,
                                    const StatesReport& report,
                                    const std::function<bool()>& stopped, bool& complete);

/// Throws Error for what is no T-shirt in one of the six states.
void check_tshirts(const std::vector<Source>& sources);

/// Creates the folder of a set; throws Error when it holds one made with other settings.
void check_folder(const std::filesystem::path& out, const std::string& kind,
                  const std::string& settings);

void write_png(const std::filesystem::path& path, const cv::Mat& image);

/// What lies on a desk, drawn; owns its garments.
struct Arrangement {
  std::vector<std::unique_ptr<Garment>> garments;
  std::vector<const Source*> sources;
  std::string kind;
  RoomContent content;
};

/// kind: as ArrangementPlan's; any_split: of all sources, else of those that are `test`.
Arrangement draw_arrangement(Random& random, const std::vector<Source>& sources,
                             const std::string& kind, bool any_split, bool test);

/// How T-shirts lie, for a number of [0, 1).
std::string kind_of(double pick, bool test);

rgbd::CameraModel draw_camera(Random& random);

std::vector<CocoInstance> coco_instances(const Arrangement& arrangement);

struct Picture {
  cv::Mat colour, depth, labels;
};
Picture take(const RoomScene& scene, RoomView view, const ColourSensor& colour,
             const DepthSensor& depth, std::uint64_t seed);

/// "tx ty tz qx qy qz qw" of T_world_camera.
std::string tum_pose(const CameraPose& pose);

/// Depth in millimetres to the 5000 units a metre of the TUM format.
cv::Mat tum_depth(const cv::Mat& depth_mm);

}  // namespace weft::synth
