#include "slam/tracker.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "base/error.hpp"
#include "slam/plane_gate.hpp"
#include "slam/pose_search.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

double seconds(std::int64_t duration_us) { return static_cast<double>(duration_us) * 1e-6; }

void check(const FrameInput& input, const TrackerOptions& options) {
  const std::string where = "frame " + std::to_string(input.frame);
  input.camera.validate(where);
  for (const auto& f : input.features) {
    if (!std::isfinite(f.u_px) || !std::isfinite(f.v_px) || !std::isfinite(f.depth_m) ||
        f.depth_m < 0.0f || f.level < 0 || f.level >= options.levels) {
      throw Error(where +
                  ": a feature is not finite, has a negative depth or a level that is not " +
                  "below TrackerOptions::levels (" + std::to_string(options.levels) + ")");
    }
  }
  for (const auto& segment : input.planes) {
    check_observation(observe(segment), 1, where + ", a plane");
    with_floors(segment.covariance, options.plane_match.noise);
  }
}

}  // namespace

class Tracker::Impl {
 public:
  Impl(const TrackerOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary)
      : options_(options),
        vocabulary_(vocabulary),
        copy_(std::move(vocabulary), {options.levels, options.noise.level_scale}),
        search_(options_, copy_) {}
  Impl(const Impl&) = delete;  // search_ refers to its siblings
  Impl& operator=(const Impl&) = delete;

  const TrackerOptions& options() const { return options_; }
  const std::shared_ptr<const BinaryVocabulary>& vocabulary() const { return vocabulary_; }
  const MapCopy& copy() const { return copy_; }

  void update(const MapUpdate& update) {
    std::vector<PlacedFrame*> held;
    if (last_) held.push_back(&*last_);
    copy_.update(update, held);
  }

  TrackedFrame track(const FrameInput& input) {
    check(input, options_);
    if (last_frame_ && input.frame <= *last_frame_)
      throw Error("frame " + std::to_string(input.frame) + " comes after frame " +
                  std::to_string(*last_frame_) + "; frames count up");
    TrackedFrame out;
    out.frame = input.frame;
    out.utime = input.utime;
    out.map_version = copy_.map().version;
    if (copy_.empty()) {
      start(input, out);
    } else {
      PoseEstimate estimate;
      out.reason = find(input, estimate);
      if (tracked_now_)
        accept(input, estimate, out);
      else
        lose(out);
    }
    last_frame_ = input.frame;
    last_utime_ = input.utime;
    return out;
  }

 private:
  void start(const FrameInput& input, TrackedFrame& out);
  std::string find(const FrameInput& input, PoseEstimate& estimate);
  bool try_motion(const FrameInput& input, const FeatureGrid& grid, PoseEstimate& estimate);
  bool try_looks(const FrameInput& input, const FeatureGrid& grid, const PoseSource& source,
                 Id reference, int least_points, PoseEstimate& estimate);
  void accept(const FrameInput& input, PoseEstimate& estimate, TrackedFrame& out);
  void lose(TrackedFrame& out);
  bool few_are_left(const FrameInput& input, const PoseEstimate& estimate, Id reference) const;
  bool sees_new_plane(const FrameInput& input, const PoseEstimate& estimate);
  void make_key_frame(TrackedFrame& out, bool new_plane, bool by_planes);

  const TrackerOptions options_;
  const std::shared_ptr<const BinaryVocabulary> vocabulary_;
  MapCopy copy_;
  const PoseSearch search_;

  std::optional<PlacedFrame> last_;  // that was tracked
  std::optional<std::int64_t> last_frame_;
  std::int64_t last_utime_ = 0;
  bool tracked_now_ = false;
  bool lost_ = false;
  std::optional<std::int64_t> found_again_utime_;
  struct Motion {
    Rigid3d T_now_before;
    std::int64_t duration_us;
  };
  std::optional<Motion> motion_;  // between the last two frames, when both were tracked
  std::optional<std::int64_t> key_frame_utime_;
  std::vector<Id> visible_;  // of the frame at hand
  struct Count {
    int visible = 0, found = 0;
  };
  std::map<Id, Count> seen_points_, seen_planes_;  // since the last key frame
  struct FreshPlane {
    KnownPlane plane;
    std::int64_t since_utime;
  };
  std::vector<FreshPlane> fresh_planes_;
};

// Without a map: makes the frame's camera the world when there is enough to see.
void Tracker::Impl::start(const FrameInput& input, TrackedFrame& out) {
  const auto with_depth = std::count_if(input.features.begin(), input.features.end(),
                                        [](const Feature& f) { return f.depth_m > 0.0f; });
  const auto planes = options_.use_planes ? static_cast<int>(input.planes.size()) : 0;
  if (with_depth <= options_.points_to_start &&
      (planes < options_.planes_to_start || with_depth < options_.points_to_start_with_planes)) {
    out.state = TrackingState::kNotStarted;
    out.reason = std::to_string(with_depth) + " points and " + std::to_string(planes) +
                 " planes; a map starts with more than " +
                 std::to_string(options_.points_to_start) + " points, or with " +
                 std::to_string(options_.planes_to_start) + " planes and " +
                 std::to_string(options_.points_to_start_with_planes) + " points";
    return;
  }
  lost_ = false;
  motion_.reset();
  found_again_utime_.reset();
  last_ = PlacedFrame{input,
                      {},
                      {},
                      std::vector<Id>(input.features.size(), kNoId),
                      std::vector<Id>(input.planes.size(), kNoId)};
  out.state = TrackingState::kTracked;
  out.reason = "a new map begins";
  out.points = static_cast<int>(with_depth);
  out.planes = planes;
  make_key_frame(out, planes > 0, with_depth <= options_.points_to_start);
}

bool Tracker::Impl::try_motion(const FrameInput& input, const FeatureGrid& grid,
                               PoseEstimate& estimate) {
  const std::int64_t duration_us = input.utime - last_utime_;
  if (seconds(duration_us) > options_.motion_max_s) return false;
  Rigid3d predicted = last_->T_camera_world;
  if (motion_ && motion_->duration_us > 0) {
    const double share =
        static_cast<double>(duration_us) / static_cast<double>(motion_->duration_us);
    const Rigid3d step{exp_rotation(share * log_rotation(motion_->T_now_before.rotation)),
                       share * motion_->T_now_before.translation};
    predicted = step * predicted;
  }
  // 3 degrees and 5 cm over a frame at 30 Hz: a hand-held camera that starts to move.
  constexpr double kSigma_rad = 3.0 * kDegree, kSigma_m = 0.05;
  const auto found = search_.by_motion(input, grid, *last_, predicted, kSigma_rad, kSigma_m);
  if (!found) return false;
  estimate = *found;
  visible_.clear();
  search_.by_local_map(input, grid, search_.local(estimate, last_->anchor.reference), 3.0, estimate,
                       &visible_);
  return true;
}

bool Tracker::Impl::try_looks(const FrameInput& input, const FeatureGrid& grid,
                              const PoseSource& source, Id reference, int least_points,
                              PoseEstimate& estimate) {
  const auto found = search_.by_looks(input, source);
  if (!found) return false;
  const auto local = search_.local(*found, reference);
  // Where few points tell the pose, wrong ones found in a wide search may outvote the planes.
  for (const double factor : {5.0, 2.0}) {
    estimate = *found;
    search_.by_local_map(input, grid, local, factor, estimate, nullptr);
    visible_.clear();
    search_.by_local_map(input, grid, local, std::min(factor, 3.0), estimate, &visible_);
    if (found->plane_inliers == 0 || estimate.plane_inliers > 0) break;
  }
  return search_.objection(estimate, least_points).empty();
}

// Sets tracked_now_; returns why not, or how the camera was found again.
std::string Tracker::Impl::find(const FrameInput& input, PoseEstimate& estimate) {
  const FeatureGrid grid(input.features, input.camera.width, input.camera.height);
  const bool unsure = found_again_utime_ && seconds(input.utime - *found_again_utime_) < 1.0;
  const int least = lost_ || unsure
                        ? std::max(options_.points_to_relocalise, options_.points_to_track)
                        : options_.points_to_track;
  tracked_now_ = true;
  std::string objection;
  // A doubtful pose is taken when nothing better is found.
  struct Found {
    PoseEstimate estimate;
    std::vector<Id> visible;
    std::string how;
  };
  std::optional<Found> doubtful;
  const auto sound = [&](const std::string& how) {
    if (!search_.doubtful(input, estimate)) return true;
    if (!doubtful || estimate.point_inliers > doubtful->estimate.point_inliers)
      doubtful = Found{estimate, visible_, how};
    return false;
  };
  if (last_ && !lost_ && try_motion(input, grid, estimate)) {
    objection = search_.objection(estimate, least);
    if (objection.empty() && sound("")) return "";
  }
  const auto of_frame = [](const PlacedFrame& frame) {
    return PoseSource{&frame.input.camera, frame.input.features, frame.points,
                      frame.input.planes,  frame.planes,         frame.T_camera_world};
  };
  const auto try_frame = [&](const PlacedFrame& frame) {
    if (try_looks(input, grid, of_frame(frame), frame.anchor.reference, least, estimate))
      return true;
    if (objection.empty() && estimate.point_inliers > 0)
      objection = search_.objection(estimate, least);
    return false;
  };
  const auto try_key_frame = [&](Id id) {
    const auto& key_frame = copy_.map().key_frames.at(id);
    std::vector<plane::PlaneSegment> segments;
    std::vector<Id> plane_ids;
    for (const auto& sighting : key_frame.planes) {
      segments.push_back(sighting.segment);
      plane_ids.push_back(sighting.plane);
    }
    const PoseSource source{&key_frame.camera, key_frame.features, key_frame.points,
                            segments,          plane_ids,          key_frame.T_camera_world};
    return try_looks(input, grid, source, id, least, estimate);
  };
  std::string again = lost_ ? "found again" : "";
  std::string where = lost_ ? "found again where it was lost" : "";
  if (last_ && try_frame(*last_) && sound(where)) return where;
  std::vector<Id> tried;
  const Id reference = last_ ? last_->anchor.reference : kNoId;
  if (copy_.map().key_frames.contains(reference)) {
    if (try_key_frame(reference) && sound(again)) return again;
    tried.push_back(reference);
  }
  for (int i = copy_.waiting() - 1; i >= 0; --i)
    if (try_frame(copy_.waiting(i)) && sound(again)) return again;
  // Without a vocabulary, only the latest key frames.
  constexpr std::size_t kCandidates = 5;
  std::vector<Id> candidates;
  if (copy_.places() != nullptr) {
    std::vector<Descriptor> descriptors;
    for (const auto& feature : input.features) descriptors.push_back(feature.descriptor);
    for (const auto& candidate :
         copy_.places()->query(vocabulary_->describe(descriptors, 1).bag, 0.5))
      candidates.push_back(candidate.place);
  } else {
    for (auto each = copy_.map().key_frames.rbegin(); each != copy_.map().key_frames.rend(); ++each)
      candidates.push_back(each->first);
  }
  if (candidates.size() > kCandidates) candidates.resize(kCandidates);
  for (const Id id : candidates) {
    if (std::find(tried.begin(), tried.end(), id) != tried.end()) continue;
    std::string there = "found in key frame " + std::to_string(id) + " by its looks";
    if (try_key_frame(id) && sound(there)) return there;
  }
  if (doubtful) {
    estimate = std::move(doubtful->estimate);
    visible_ = std::move(doubtful->visible);
    return doubtful->how;
  }
  tracked_now_ = false;
  return objection.empty()
             ? std::to_string(input.features.size()) + " features and " +
                   std::to_string(input.planes.size()) + " planes match nothing that is known"
             : objection;
}

void Tracker::Impl::accept(const FrameInput& input, PoseEstimate& estimate, TrackedFrame& out) {
  if (lost_) found_again_utime_ = input.utime;
  const Id reference = search_.reference(estimate);
  const Id held_by = reference != kNoId ? reference : last_ ? last_->anchor.reference : kNoId;
  if (last_ && !lost_ && last_frame_ && last_->input.frame == *last_frame_) {
    motion_ = Motion{estimate.T_camera_world * last_->T_camera_world.inverse(),
                     input.utime - last_utime_};
  } else {
    motion_.reset();
  }
  lost_ = false;

  for (const Id id : visible_) ++seen_points_[id].visible;
  for (const Id id : estimate.points)
    if (id >= 0) ++seen_points_[id].found;
  for (std::size_t s = 0; s < estimate.planes.size(); ++s) {
    if (estimate.planes[s] < 0) continue;
    auto& count = seen_planes_[estimate.planes[s]];
    ++count.visible;
    ++count.found;
  }

  last_ = PlacedFrame{input, AnchoredPose::at(estimate.T_camera_world, copy_.map(), held_by),
                      estimate.T_camera_world, estimate.points, estimate.planes};
  out.state = TrackingState::kTracked;
  out.T_camera_world = estimate.T_camera_world;
  out.covariance = estimate.covariance();
  out.reference = last_->anchor.reference;
  out.T_camera_reference = last_->anchor.T_camera_reference;
  out.points = estimate.point_inliers;
  out.planes = estimate.plane_inliers;

  const bool new_plane = sees_new_plane(input, estimate);
  const bool by_planes = estimate.point_inliers < options_.points_to_track;
  if (copy_.waiting() >= options_.max_pending) return;
  if (new_plane || few_are_left(input, estimate, reference))
    make_key_frame(out, new_plane, by_planes);
}

void Tracker::Impl::lose(TrackedFrame& out) {
  out.state = TrackingState::kLost;
  lost_ = true;
  motion_.reset();
  found_again_utime_.reset();
  fresh_planes_.clear();
}

// ORB-SLAM2's rules for RGB-D.
bool Tracker::Impl::few_are_left(const FrameInput& input, const PoseEstimate& estimate,
                                 Id reference) const {
  constexpr double kVeryFew = 0.25;
  constexpr int kLeast = 15, kFewClose = 100, kManyClose = 70;
  const auto& map = copy_.map();
  int of_reference = 0;
  const std::size_t least_observations = map.key_frames.size() > 2 ? 3 : 2;
  if (const auto found = map.key_frames.find(reference); found != map.key_frames.end()) {
    for (const Id id : found->second.points)
      if (id != kNoId && map.points.at(id).observations.size() >= least_observations)
        ++of_reference;
  }
  int known = 0, close_known = 0, close_unknown = 0;
  for (std::size_t i = 0; i < estimate.points.size(); ++i) {
    if (estimate.points[i] != kNoId) ++known;
    const float depth_m = input.features[i].depth_m;
    if (!(depth_m > 0.0f) || depth_m > options_.close_m) continue;
    ++(estimate.points[i] != kNoId ? close_known : close_unknown);
  }
  const bool few_close = close_known < kFewClose && close_unknown > kManyClose;
  const bool late = !key_frame_utime_ ||
                    seconds(input.utime - *key_frame_utime_) >= options_.key_frame_interval_s;
  const bool urgent = known < kVeryFew * of_reference || few_close;
  return (late || copy_.waiting() == 0 || urgent) &&
         (known < options_.key_frame_share * of_reference || few_close) &&
         (known > kLeast || estimate.plane_inliers >= 3);
}

// A large plane that nothing known matches, and that stays so.
bool Tracker::Impl::sees_new_plane(const FrameInput& input, const PoseEstimate& estimate) {
  if (!options_.use_planes) return false;
  std::vector<plane::PlaneSegment> unknown;
  for (std::size_t s = 0; s < estimate.planes.size(); ++s)
    if (estimate.planes[s] == kNoId && input.planes[s].cells >= options_.new_plane_cells)
      unknown.push_back(input.planes[s]);
  std::vector<KnownPlane> before;
  for (const auto& each : fresh_planes_) before.push_back(each.plane);
  const Matrix6d covariance = estimate.covariance();
  const auto matches =
      match_planes(unknown, before, estimate.T_camera_world, covariance, options_.plane_match);
  std::vector<FreshPlane> now;
  bool stays = false;
  for (std::size_t k = 0; k < unknown.size(); ++k) {
    FreshPlane fresh;
    fresh.since_utime = matches[k] < 0
                            ? last_utime_
                            : fresh_planes_[static_cast<std::size_t>(matches[k])].since_utime;
    fresh.plane.state = in_world(unknown[k].plane, estimate.T_camera_world);
    fresh.plane.covariance = covariance_in_world(unknown[k].plane, unknown[k].covariance,
                                                 estimate.T_camera_world, covariance);
    stays = stays || seconds(input.utime - fresh.since_utime) >= options_.new_plane_s;
    now.push_back(fresh);
  }
  fresh_planes_ = std::move(now);
  return stays;
}

// Of the last frame, which becomes one that waits for the map.
void Tracker::Impl::make_key_frame(TrackedFrame& out, bool new_plane, bool by_planes) {
  const auto in_map = [](std::vector<Id> ids) {
    for (Id& id : ids) id = std::max(id, kNoId);
    return ids;
  };
  const auto sightings = [](std::map<Id, Count>& counts) {
    std::vector<Sightings> list;
    for (const auto& [id, count] : counts) list.push_back({id, count.visible, count.found});
    counts.clear();
    return list;
  };
  NewKeyFrame key_frame;
  key_frame.input = last_->input;
  key_frame.T_camera_world = last_->T_camera_world;
  key_frame.map_version = copy_.map().version;
  key_frame.reference = last_->anchor.reference;
  key_frame.points = in_map(last_->points);
  key_frame.planes = in_map(last_->planes);
  key_frame.new_plane = new_plane;
  key_frame.by_planes = by_planes;
  key_frame.seen_points = sightings(seen_points_);
  key_frame.seen_planes = sightings(seen_planes_);
  out.key_frame = std::move(key_frame);
  copy_.wait_for(*last_);
  fresh_planes_.clear();
  key_frame_utime_ = last_->input.utime;
}

Tracker::Tracker(const TrackerOptions& options,
                 std::shared_ptr<const BinaryVocabulary> vocabulary) {
  options.validate();
  impl_ = std::make_unique<Impl>(options, std::move(vocabulary));
}
Tracker::~Tracker() = default;
Tracker::Tracker(Tracker&&) noexcept = default;
Tracker& Tracker::operator=(Tracker&&) noexcept = default;

void Tracker::update(const MapUpdate& update) {
  if (update.to_version == 0) return reset();
  try {
    impl_->update(update);
  } catch (const Error&) {
    const bool follows =
        update.from_version == 0 || update.from_version == impl_->copy().map().version;
    if (follows) reset();  // half an update is no map
    throw;
  }
}

TrackedFrame Tracker::track(const FrameInput& input) { return impl_->track(input); }
const Map& Tracker::map() const { return impl_->copy().map(); }
void Tracker::reset() {
  impl_ = std::make_unique<Impl>(TrackerOptions(impl_->options()), impl_->vocabulary());
}

}  // namespace weft::slam
