#include "slam/mapper.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <set>
#include <string>

#include "base/error.hpp"
#include "slam/plane_gate.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {
namespace {

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;

void check(const NewKeyFrame& key_frame) {
  const auto& input = key_frame.input;
  const std::string where = "key frame of frame " + std::to_string(input.frame);
  input.camera.validate(where);
  check_pose(key_frame.T_camera_world, where);
  if (input.frame < 0) throw Error(where + ": frames count up from 0");
  if (key_frame.points.size() != input.features.size() ||
      key_frame.planes.size() != input.planes.size()) {
    throw Error(where + ": " + std::to_string(key_frame.points.size()) + " points for " +
                std::to_string(input.features.size()) + " features, " +
                std::to_string(key_frame.planes.size()) + " planes for " +
                std::to_string(input.planes.size()) + " segments");
  }
  for (const auto& feature : input.features) {
    if (!std::isfinite(feature.u_px) || !std::isfinite(feature.v_px) ||
        !std::isfinite(feature.depth_m) || feature.depth_m < 0.0f || feature.depth_m > 1e4f ||
        std::abs(feature.u_px) > 1e5f || std::abs(feature.v_px) > 1e5f || feature.level < 0 ||
        feature.level > 31)
      throw Error(where + ": a feature's place, depth or level cannot be");
  }
  for (const auto& segment : input.planes) {
    check_plane({segment.plane.normal, segment.plane.distance_m, false}, where + ", a plane");
    with_floors(segment.covariance, {});
    for (const auto& point : segment.points_camera)
      if (!point.allFinite()) throw Error(where + ": a plane's point is not finite");
  }
}

}  // namespace

class Mapper::Impl {
 public:
  Impl(const MapperOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary)
      : options_(options), points_(options.points), planes_(options.planes) {
    options_.validate();
    options_.adjustment.use_planes = options_.adjustment.use_planes && options_.use_planes;
    if (vocabulary) loops_.emplace(options.loops, options.points.noise, std::move(vocabulary));
  }

  void go_on(SavedMap saved) {
    editor_ = MapEditor(std::move(saved.map), saved.next);
    points_.set_young(std::move(saved.young_points));
    frame_ = saved.frame;
    utime_ = saved.utime;
    if (loops_)
      for (const auto& [id, key_frame] : editor_.map().key_frames) loops_->add(key_frame);
  }
  SavedMap saved() const {
    return {editor_.map(), editor_.next_ids(), points_.young(), frame_, utime_, {}};
  }

  MapUpdate add(const NewKeyFrame& in) {
    check(in);
    const Rigid3d T_camera_world = check_against_map(in);
    report_ = {};
    const bool first = editor_.map().key_frames.empty();
    KeyFrame key_frame;
    key_frame.frame = in.input.frame;
    key_frame.utime = in.input.utime;
    key_frame.camera = in.input.camera;
    key_frame.T_camera_world = T_camera_world;
    key_frame.features = in.input.features;
    if (options_.use_planes)
      for (const auto& segment : in.input.planes) key_frame.planes.push_back({segment, kNoId});
    const std::int64_t frames = in.input.frame - frame_;
    const double frame_s =
        first || frame_ < 0 || frames <= 0  // -1: of another session
            ? 0.0
            : 1e-6 * static_cast<double>(in.input.utime - utime_) / static_cast<double>(frames);
    const Id id = editor_.add_key_frame(std::move(key_frame));
    report_.key_frame = id;
    Matrix6d pose_covariance = Matrix6d::Zero();
    if (!first) {
      link(id, in);
      set_parent(id, in.reference);
      pose_covariance = refine(id, in);
      report_.found = points_.fuse(editor_, id, around(id));
    }
    if (options_.use_planes) {
      report_.new_planes = planes_.associate(editor_, id, pose_covariance);
      planes_.judge(editor_, id, in.seen_planes, frame_s);
    }
    points_.cull(editor_, id);
    report_.by_depth = points_.add_by_depth(editor_, id);
    if (!first) {
      const auto near = nearest(id);
      report_.by_parallax = points_.add_by_parallax(editor_, id, near);
      for (const Id other : near) points_.fuse(editor_, other, points_of(id));
      std::set<Id> theirs;
      for (const Id other : near)
        for (const Id point : points_of(other)) theirs.insert(point);
      points_.fuse(editor_, id, std::vector<Id>(theirs.begin(), theirs.end()));
      report_.adjustment = adjust(editor_, points_, options_.points.noise,
                                  window(editor_.map(), id, options_.adjustment.local_key_frames),
                                  std::numeric_limits<int>::max(), options_.adjustment);
    }
    if (options_.use_planes) {
      for (const auto& sighting : editor_.key_frame(id).planes)
        if (sighting.plane != kNoId && !editor_.plane(sighting.plane).confirmed)
          planes_.estimate(editor_, sighting.plane);
      report_.planes_merged = planes_.merge(editor_);
    }
    keep_what_brought_planes();
    cull_key_frames(id);
    if (loops_) {
      loops_->add(editor_.key_frame(id));
      if (const auto loop = loops_->detect(editor_.map(), points_, id)) close(*loop);
    }
    frame_ = in.input.frame;
    utime_ = in.input.utime;
    return editor_.take_update(frame_);
  }

  const Map& map() const { return editor_.map(); }
  std::int64_t frame() const { return frame_; }
  const Report& report() const { return report_; }

 private:
  /// The pose in the present map.
  Rigid3d check_against_map(const NewKeyFrame& in) const {
    const Map& map = editor_.map();
    const std::string where = "key frame of frame " + std::to_string(in.input.frame);
    if (map.key_frames.empty()) return in.T_camera_world;
    if (in.input.frame <= frame_) {
      throw Error(where + " does not come after frame " + std::to_string(frame_) +
                  ", the last in the map");
    }
    if (!(in.input.camera == map.key_frames.begin()->second.camera)) {
      throw Error(where + " is of another camera than the map; begin a new one");
    }
    if (in.map_version < 0 || in.map_version > map.version ||
        in.map_version < map.version - MapEditor::kRemembered) {
      throw Error(where + " was tracked in version " + std::to_string(in.map_version) +
                  " of the map, which is at version " + std::to_string(map.version) +
                  "; give the tracker the whole map");
    }
    if (in.reference == kNoId) return in.T_camera_world;
    Rigid3d T_reference_then;
    const auto now = map.key_frames.find(in.reference);
    if (now == map.key_frames.end() ||
        !editor_.pose_at(in.reference, in.map_version, T_reference_then))
      return in.T_camera_world;
    return in.T_camera_world * T_reference_then.inverse() * now->second.T_camera_world;
  }

  /// What the tracker saw, as far as it is in the map still, and how often it looked for what.
  void link(Id id, const NewKeyFrame& in) {
    std::set<Id> used;
    for (std::size_t i = 0; i < in.points.size(); ++i) {
      const Id point = editor_.present_point(in.points[i]);
      if (point == kNoId || !used.insert(point).second) continue;
      editor_.observe_point(point, id, static_cast<int>(i));
      ++report_.tracked;
    }
    for (const auto& [point, visible, found] : in.seen_points) {
      const Id present = editor_.present_point(point);
      if (present != kNoId && found >= 0 && visible >= found && visible <= 1000000)
        editor_.count(present, visible, found);
    }
  }

  void set_parent(Id id, Id reference) {
    const auto shared = neighbours(editor_.map(), editor_.key_frame(id), 1);
    Id parent = shared.empty() ? reference : shared.front().key_frame;
    const auto& key_frames = editor_.map().key_frames;
    if (!key_frames.contains(parent)) parent = std::prev(key_frames.find(id))->first;
    editor_.set_parent(id, parent);
  }

  /// The pose anew in the present map, what does not fit unlinked; returns its covariance.
  Matrix6d refine(Id id, const NewKeyFrame& in) {
    const KeyFrame& key_frame = editor_.key_frame(id);
    std::vector<Eigen::Vector3d> positions;
    std::vector<PointObservation> seen;
    std::vector<Id> ids;
    for (std::size_t i = 0; i < key_frame.points.size(); ++i) {
      if (key_frame.points[i] == kNoId) continue;
      seen.push_back(observe(key_frame.features[i], options_.points.noise));
      seen.back().point = static_cast<int>(positions.size());
      positions.push_back(editor_.point(key_frame.points[i]).position_world);
      ids.push_back(key_frame.points[i]);
    }
    std::vector<PlaneState> states;
    std::vector<PlaneObservation> seen_planes;
    for (std::size_t i = 0; options_.use_planes && i < in.planes.size(); ++i) {
      const auto found = editor_.map().planes.find(in.planes[i]);
      if (found == editor_.map().planes.end() || !found->second.confirmed) continue;
      seen_planes.push_back(observe(in.input.planes[i]));
      seen_planes.back().plane = static_cast<int>(states.size());
      states.push_back({found->second.normal_world, found->second.distance_m, false});
    }
    PosePrior prior{key_frame.T_camera_world, Matrix6d::Zero()};
    const double sigma_rad = options_.pose_sigma_deg * kRadiansPerDegree;
    prior.information.diagonal().head<3>().setConstant(1.0 / (sigma_rad * sigma_rad));
    prior.information.diagonal().tail<3>().setConstant(
        1.0 / (options_.pose_sigma_m * options_.pose_sigma_m));
    const PoseResult result = optimise_pose(key_frame.camera, key_frame.T_camera_world, positions,
                                            states, seen, seen_planes, options_.pose, prior);
    for (std::size_t i = 0; i < ids.size(); ++i)
      if (!result.point_inlier[i]) points_.drop(editor_, ids[i], id);
    editor_.set_pose(id, result.T_camera_world);
    return result.information.llt().solve(Matrix6d::Identity());
  }

  /// A key frame that was the first to see a plane of the map stays (garment-slam.txt 3.5.3).
  void keep_what_brought_planes() {
    std::set<Id> first;
    for (const auto& [id, plane] : editor_.map().planes)
      if (!plane.observations.empty()) first.insert(plane.observations.front().key_frame);
    std::vector<Id> changed;
    for (const auto& [id, key_frame] : editor_.map().key_frames)
      if (key_frame.keep != first.contains(id)) changed.push_back(id);
    for (const Id id : changed) editor_.set_keep(id, first.contains(id));
  }

  void cull_key_frames(Id newest) {
    const Map& map = editor_.map();
    for (const auto& [id, shared] : neighbours(map, map.key_frames.at(newest), 1)) {
      const KeyFrame& key_frame = map.key_frames.at(id);
      // The last one is what the tracker works with.
      if (id == map.key_frames.begin()->first || key_frame.keep ||
          !key_frame.loop_partners.empty() || std::next(map.key_frames.find(id))->first == newest)
        continue;
      if (!is_redundant(key_frame)) continue;
      for (const Id point : points_of(id)) points_.drop(editor_, point, id);
      editor_.remove_key_frame(id);
      if (loops_) loops_->remove(id);
      ++report_.key_frames_culled;
    }
  }

  bool is_redundant(const KeyFrame& key_frame) const {
    int close = 0, redundant = 0;
    for (std::size_t i = 0; i < key_frame.points.size(); ++i) {
      const Feature& feature = key_frame.features[i];
      if (key_frame.points[i] == kNoId || !(feature.depth_m > 0.0f) ||
          feature.depth_m > options_.points.close_m)
        continue;
      ++close;
      int others = 0;
      for (const auto& [other, index] : editor_.point(key_frame.points[i]).observations) {
        const auto& seen = editor_.key_frame(other).features[static_cast<std::size_t>(index)];
        others += other != key_frame.id && seen.level <= feature.level + 1;
      }
      redundant += others >= options_.redundant_views;
    }
    return redundant > options_.redundant_share * close;
  }

  void close(const Loop& loop) {
    report_.loop_refused = !loops_->close(editor_, points_, planes_, loop);
    if (report_.loop_refused) return;
    report_.loop = loop;
    // Everything, as far as the bounds allow: what lies nearest to the two ends.
    const auto& map = editor_.map();
    std::set<Id> all{loop.key_frame, loop.partner};
    std::vector<Id> edge(all.begin(), all.end());
    const auto most = static_cast<std::size_t>(options_.adjustment.full_key_frames);
    for (std::size_t i = 0; i < edge.size() && all.size() < most; ++i)
      for (const auto& [other, shared] : neighbours(map, map.key_frames.at(edge[i]), 1))
        if (all.size() < most && all.insert(other).second) edge.push_back(other);
    report_.full_adjustment = adjust(editor_, points_, options_.points.noise, all,
                                     options_.adjustment.full_observations, options_.adjustment);
    for (int again = 0; options_.use_planes && again < 2; ++again) {
      std::vector<Id> ids;
      for (const auto& [id, plane] : map.planes) ids.push_back(id);
      for (const Id id : ids) {
        if (!map.planes.at(id).confirmed) planes_.estimate(editor_, id);
        planes_.rebuild_cloud(editor_, id);
      }
      if (planes_.merge(editor_) == 0) break;
      adjust(editor_, points_, options_.points.noise, all, options_.adjustment.full_observations,
             options_.adjustment);
    }
    keep_what_brought_planes();
  }

  std::vector<Id> nearest(Id id) const {
    std::vector<Id> out;
    for (const auto& [other, shared] : neighbours(editor_.map(), editor_.key_frame(id), 1)) {
      if (static_cast<int>(out.size()) >= options_.neighbours) break;
      out.push_back(other);
    }
    const Id parent = editor_.key_frame(id).parent;
    if (out.empty() && parent != kNoId) out.push_back(parent);
    return out;
  }
  std::vector<Id> points_of(Id id) const {
    std::vector<Id> out;
    for (const Id point : editor_.key_frame(id).points)
      if (point != kNoId) out.push_back(point);
    return out;
  }
  /// The points its neighbours see, and theirs: what it may see as well.
  std::vector<Id> around(Id id) const {
    std::set<Id> key_frames, out;
    for (const Id near : nearest(id)) {
      key_frames.insert(near);
      for (const Id next : nearest(near)) key_frames.insert(next);
    }
    key_frames.erase(id);
    for (const Id key_frame : key_frames)
      for (const Id point : points_of(key_frame)) out.insert(point);
    return {out.begin(), out.end()};
  }

  MapperOptions options_;
  MapEditor editor_;
  PointMapper points_;
  PlaneMapper planes_;
  std::optional<LoopCloser> loops_;
  std::int64_t frame_ = -1, utime_ = 0;
  Report report_;
};

Mapper::Mapper(const MapperOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary)
    : impl_(std::make_unique<Impl>(options, std::move(vocabulary))) {}
Mapper::Mapper(const MapperOptions& options, std::shared_ptr<const BinaryVocabulary> vocabulary,
               SavedMap saved)
    : Mapper(options, std::move(vocabulary)) {
  impl_->go_on(std::move(saved));
}
Mapper::~Mapper() = default;
Mapper::Mapper(Mapper&&) noexcept = default;
Mapper& Mapper::operator=(Mapper&&) noexcept = default;
MapUpdate Mapper::add(const NewKeyFrame& key_frame) { return impl_->add(key_frame); }
const Map& Mapper::map() const { return impl_->map(); }
SavedMap Mapper::saved() const { return impl_->saved(); }
std::int64_t Mapper::frame() const { return impl_->frame(); }
const Mapper::Report& Mapper::report() const { return impl_->report(); }

}  // namespace weft::slam
