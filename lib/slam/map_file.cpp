#include "slam/map_file.hpp"

#include <cmath>
#include <set>

#include "base/blob.hpp"
#include "base/error.hpp"
#include "slam/residuals.hpp"

namespace weft::slam {
namespace {

constexpr const char* kKind = "map";
constexpr std::uint32_t kVersion = 2;                  // 2: with garments
constexpr std::int64_t kMost = std::int64_t{1} << 60;  // of ids, versions, frames and times

void add(std::vector<double>& out, const Eigen::MatrixXd& values) {
  out.insert(out.end(), values.reshaped().begin(), values.reshaped().end());
}
void add(std::vector<float>& out, const std::vector<Eigen::Vector3f>& points) {
  for (const auto& point : points) out.insert(out.end(), {point.x(), point.y(), point.z()});
}
void add(std::vector<std::uint8_t>& out, const Descriptor& descriptor) {
  for (const std::uint64_t word : descriptor)
    for (int byte = 0; byte < 8; ++byte)
      out.push_back(static_cast<std::uint8_t>(word >> (8 * byte)));
}
void add_pose(std::vector<double>& out, const Rigid3d& pose) {
  add(out, pose.rotation.coeffs());
  add(out, pose.translation);
}

/// An array of the file, read from its beginning to its end.
template <class T>
class Source {
 public:
  Source(const BlobReader& file, const std::string& section)
      : file_(file), section_(section), values_(file.values<T>(section)) {}
  Source(const BlobReader& file, const std::string& section, std::size_t count)
      : file_(file), section_(section), values_(file.values<T>(section, count)) {}

  T next() {
    if (at_ == values_.size()) file_.fail("section " + section_ + " is too short");
    return values_[at_++];
  }
  T next(T low, T high) {
    const T value = next();
    if (value < low || value > high) file_.fail("a value of section " + section_ + " cannot be");
    return value;
  }
  /// A number of things that take `each` values of another section.
  template <class U>
  std::size_t count(const Source<U>& of, std::size_t each) {
    const T value = next();
    if (value < 0 || static_cast<std::uint64_t>(value) > of.left() / each)
      file_.fail("a count of section " + section_ + " is more than there is");
    return static_cast<std::size_t>(value);
  }
  std::size_t size() const { return values_.size(); }
  std::size_t left() const { return values_.size() - at_; }
  void done() const {
    if (at_ != values_.size()) file_.fail("section " + section_ + " is too long");
  }

 private:
  const BlobReader& file_;
  std::string section_;
  std::vector<T> values_;
  std::size_t at_ = 0;
};

template <int Rows, int Columns>
Eigen::Matrix<double, Rows, Columns> matrix(Source<double>& in) {
  Eigen::Matrix<double, Rows, Columns> out;
  for (auto& value : out.reshaped()) value = in.next();
  return out;
}
Descriptor descriptor(Source<std::uint8_t>& in) {
  Descriptor out{};
  for (auto& word : out)
    for (int byte = 0; byte < 8; ++byte) word |= std::uint64_t{in.next()} << (8 * byte);
  return out;
}
std::vector<Eigen::Vector3f> points(Source<float>& in, std::size_t count) {
  std::vector<Eigen::Vector3f> out(count);
  for (auto& point : out)
    for (auto& value : point) value = in.next(-1e6f, 1e6f);
  return out;
}

/// Ids of landmarks, ascending, below the next one.
std::vector<std::int64_t> ids(const BlobReader& file, const std::string& section, Id next) {
  auto out = file.values<std::int64_t>(section);
  for (std::size_t i = 0; i < out.size(); ++i)
    if (out[i] < 0 || out[i] >= next || (i > 0 && out[i] <= out[i - 1]))
      file.fail("the ids of section " + section + " are not in order");
  return out;
}

void write_key_frames(BlobWriter& file, const Map& map) {
  std::vector<std::int64_t> id, frame, utime, parent, partners;
  std::vector<std::int32_t> partner_count, feature_count, plane_count, point_count, plane_numbers;
  std::vector<double> pose, plane;
  std::vector<float> feature, plane_points;
  std::vector<std::uint8_t> level, descriptors, keep;
  for (const auto& [key, k] : map.key_frames) {
    id.push_back(key);
    frame.push_back(k.frame);
    utime.push_back(k.utime);
    parent.push_back(k.parent);
    keep.push_back(k.keep);
    add_pose(pose, k.T_camera_world);
    partner_count.push_back(static_cast<std::int32_t>(k.loop_partners.size()));
    partners.insert(partners.end(), k.loop_partners.begin(), k.loop_partners.end());
    feature_count.push_back(static_cast<std::int32_t>(k.features.size()));
    for (const auto& f : k.features) {
      feature.insert(feature.end(), {f.u_px, f.v_px, f.depth_m, f.angle_deg});
      level.push_back(static_cast<std::uint8_t>(f.level));
      add(descriptors, f.descriptor);
    }
    plane_count.push_back(static_cast<std::int32_t>(k.planes.size()));
    for (const auto& [segment, landmark] : k.planes) {
      add(plane, segment.plane.normal);
      plane.insert(plane.end(), {segment.plane.distance_m, segment.plane.rms_m});
      add(plane, segment.covariance);
      plane_numbers.insert(plane_numbers.end(), {segment.plane.support, segment.cells});
      point_count.push_back(static_cast<std::int32_t>(segment.points_camera.size()));
      add(plane_points, segment.points_camera);
    }
  }
  if (!map.key_frames.empty()) {
    const auto& camera = map.key_frames.begin()->second.camera;
    file.add_number("camera.width", std::int64_t{camera.width});
    file.add_number("camera.height", std::int64_t{camera.height});
    file.add("camera.numbers", std::vector<double>{camera.fx, camera.fy, camera.cx, camera.cy});
  }
  file.add("key_frame.id", id);
  file.add("key_frame.frame", frame);
  file.add("key_frame.utime", utime);
  file.add("key_frame.parent", parent);
  file.add("key_frame.keep", keep);
  file.add("key_frame.pose", pose);
  file.add("key_frame.partner_count", partner_count);
  file.add("key_frame.partners", partners);
  file.add("key_frame.features", feature_count);
  file.add("key_frame.planes", plane_count);
  file.add("feature.numbers", feature);
  file.add("feature.level", level);
  file.add("feature.descriptor", descriptors);
  file.add("segment.numbers", plane);
  file.add("segment.sizes", plane_numbers);
  file.add("segment.point_count", point_count);
  file.add("segment.points", plane_points);
}

void read_key_frames(const BlobReader& file, const NextIds& next, MapUpdate& out) {
  const auto key_frame_ids = ids(file, "key_frame.id", next.key_frame);
  const std::size_t n = key_frame_ids.size();
  const std::set<Id> known(key_frame_ids.begin(), key_frame_ids.end());
  rgbd::CameraModel camera;
  if (n > 0) {
    camera.width = static_cast<int>(file.integer("camera.width", 1, 8192));
    camera.height = static_cast<int>(file.integer("camera.height", 1, 8192));
    const auto numbers = file.values<double>("camera.numbers", 4);
    camera.fx = numbers[0];
    camera.fy = numbers[1];
    camera.cx = numbers[2];
    camera.cy = numbers[3];
    camera.validate(file.name());
  }
  Source<std::int64_t> frame(file, "key_frame.frame", n), utime(file, "key_frame.utime", n),
      parent(file, "key_frame.parent", n), partners(file, "key_frame.partners");
  Source<std::uint8_t> keep(file, "key_frame.keep", n), level(file, "feature.level"),
      descriptors(file, "feature.descriptor", 32 * level.size());
  Source<double> pose(file, "key_frame.pose", 7 * n), plane(file, "segment.numbers");
  Source<float> feature(file, "feature.numbers", 4 * level.size()),
      plane_points(file, "segment.points");
  Source<std::int32_t> partner_count(file, "key_frame.partner_count", n),
      features(file, "key_frame.features", n), planes(file, "key_frame.planes", n),
      sizes(file, "segment.sizes"), point_count(file, "segment.point_count", sizes.size() / 2);
  for (const Id id : key_frame_ids) {
    KeyFrame k;
    k.id = id;
    k.camera = camera;
    k.frame = frame.next(0, kMost);
    k.utime = utime.next(-kMost, kMost);
    k.keep = keep.next(0, 1) != 0;
    k.parent = parent.next();
    const bool first = id == key_frame_ids.front();
    if (first ? k.parent != kNoId : k.parent >= id || !known.contains(k.parent))
      file.fail("key frame " + std::to_string(id) + " has no parent");
    k.T_camera_world.rotation.coeffs() = matrix<4, 1>(pose);
    k.T_camera_world.translation = matrix<3, 1>(pose);
    check_pose(k.T_camera_world, file.name() + ": key frame " + std::to_string(id));
    for (std::size_t left = partner_count.count(partners, 1); left > 0; --left) {
      k.loop_partners.push_back(partners.next());
      if (!known.contains(k.loop_partners.back())) file.fail("a loop's other end is not there");
    }
    for (std::size_t left = features.count(level, 1); left > 0; --left) {
      Feature f;
      f.u_px = feature.next(-1e5f, 1e5f);
      f.v_px = feature.next(-1e5f, 1e5f);
      f.depth_m = feature.next(0.0f, 1e4f);
      f.angle_deg = feature.next(-1e4f, 1e4f);
      f.level = level.next(0, 31);
      f.descriptor = descriptor(descriptors);
      k.features.push_back(f);
    }
    for (std::size_t left = planes.count(point_count, 1); left > 0; --left) {
      plane::PlaneSegment s;
      s.plane.normal = matrix<3, 1>(plane);
      s.plane.distance_m = plane.next(-1e6, 1e6);
      s.plane.rms_m = plane.next(0.0, 1e6);
      s.covariance = matrix<3, 3>(plane);
      check_plane({s.plane.normal, s.plane.distance_m, false}, file.name() + ": a segment");
      with_floors(s.covariance, {});
      s.plane.support = sizes.next(0, 1 << 30);
      s.cells = sizes.next(0, 1 << 30);
      s.points_camera = points(plane_points, point_count.count(plane_points, 3));
      k.planes.push_back({std::move(s), kNoId});
    }
    out.new_key_frames.push_back(std::move(k));
  }
  partners.done();
  level.done();
  plane.done();
  sizes.done();
  plane_points.done();
}

void add(std::vector<std::int64_t>& key_frame, std::vector<std::int32_t>& index,
         const std::vector<Observation>& observations) {
  for (const auto& observation : observations) {
    key_frame.push_back(observation.key_frame);
    index.push_back(observation.index);
  }
}

/// apply() checks that they are there; here that they are in order and no thing is seen twice.
std::vector<Observation> observations(const BlobReader& file, std::size_t count,
                                      Source<std::int64_t>& key_frame, Source<std::int32_t>& index,
                                      bool may_repeat, std::set<std::pair<Id, int>>& taken) {
  std::vector<Observation> out(count);
  for (std::size_t i = 0; i < count; ++i) {
    out[i] = {key_frame.next(), index.next(0, 1 << 30)};
    const bool in_order =
        i == 0 || out[i].key_frame > out[i - 1].key_frame ||
        (may_repeat && out[i].key_frame == out[i - 1].key_frame && out[i].index > out[i - 1].index);
    if (!in_order || !taken.emplace(out[i].key_frame, out[i].index).second)
      file.fail("the observations of a landmark are not in order, or of two landmarks");
  }
  return out;
}

void write_points(BlobWriter& file, const Map& map) {
  std::vector<std::int64_t> id, first, seen_in;
  std::vector<std::int32_t> counters, count, seen_at;
  std::vector<double> numbers;
  std::vector<std::uint8_t> descriptors;
  for (const auto& [key, p] : map.points) {
    id.push_back(key);
    first.push_back(p.first_key_frame);
    add(numbers, p.position_world);
    add(numbers, p.viewing_direction);
    numbers.insert(numbers.end(), {p.min_distance_m, p.max_distance_m});
    add(descriptors, p.descriptor);
    counters.insert(counters.end(), {p.visible, p.found});
    count.push_back(static_cast<std::int32_t>(p.observations.size()));
    add(seen_in, seen_at, p.observations);
  }
  file.add("point.id", id);
  file.add("point.first_key_frame", first);
  file.add("point.numbers", numbers);
  file.add("point.descriptor", descriptors);
  file.add("point.counters", counters);
  file.add("point.observations", count);
  file.add("point.seen_in", seen_in);
  file.add("point.seen_at", seen_at);
}

void read_points(const BlobReader& file, const NextIds& next, MapUpdate& out) {
  const auto point_ids = ids(file, "point.id", next.point);
  const std::size_t n = point_ids.size();
  Source<std::int64_t> first(file, "point.first_key_frame", n), seen_in(file, "point.seen_in");
  Source<std::int32_t> counters(file, "point.counters", 2 * n),
      count(file, "point.observations", n), seen_at(file, "point.seen_at", seen_in.size());
  Source<double> numbers(file, "point.numbers", 8 * n);
  Source<std::uint8_t> descriptors(file, "point.descriptor", 32 * n);
  std::set<std::pair<Id, int>> taken;
  for (const Id id : point_ids) {
    MapPoint p;
    p.id = id;
    p.first_key_frame = first.next(0, next.key_frame - 1);
    p.position_world = matrix<3, 1>(numbers);
    p.viewing_direction = matrix<3, 1>(numbers);
    p.min_distance_m = numbers.next(0.0, 1e9);
    p.max_distance_m = numbers.next(0.0, 1e9);
    if (std::abs(p.viewing_direction.norm() - 1.0) > 1e-6 || p.position_world.norm() > 1e9)
      file.fail("point " + std::to_string(id) + " cannot be where it is");
    p.descriptor = descriptor(descriptors);
    p.visible = counters.next(0, 1 << 30);
    p.found = counters.next(0, 1 << 30);
    p.observations = observations(file, count.count(seen_at, 1), seen_in, seen_at, false, taken);
    if (p.observations.empty()) file.fail("point " + std::to_string(id) + " is seen by none");
    out.points.push_back(std::move(p));
  }
  seen_at.done();
}

void write_planes(BlobWriter& file, const Map& map) {
  std::vector<std::int64_t> id, seen_in;
  std::vector<std::int32_t> sightings, count, seen_at, cloud_count;
  std::vector<double> numbers;
  std::vector<float> cloud;
  std::vector<std::uint8_t> confirmed;
  for (const auto& [key, p] : map.planes) {
    id.push_back(key);
    add(numbers, p.normal_world);
    numbers.push_back(p.distance_m);
    add(numbers, p.covariance);
    cloud_count.push_back(static_cast<std::int32_t>(p.cloud_world.size()));
    add(cloud, p.cloud_world);
    sightings.push_back(p.sightings);
    confirmed.push_back(p.confirmed);
    count.push_back(static_cast<std::int32_t>(p.observations.size()));
    add(seen_in, seen_at, p.observations);
  }
  file.add("plane.id", id);
  file.add("plane.numbers", numbers);
  file.add("plane.cloud_count", cloud_count);
  file.add("plane.cloud", cloud);
  file.add("plane.sightings", sightings);
  file.add("plane.confirmed", confirmed);
  file.add("plane.observations", count);
  file.add("plane.seen_in", seen_in);
  file.add("plane.seen_at", seen_at);
}

void read_planes(const BlobReader& file, const NextIds& next, MapUpdate& out) {
  const auto plane_ids = ids(file, "plane.id", next.plane);
  const std::size_t n = plane_ids.size();
  Source<std::int64_t> seen_in(file, "plane.seen_in");
  Source<std::int32_t> sightings(file, "plane.sightings", n), count(file, "plane.observations", n),
      seen_at(file, "plane.seen_at", seen_in.size()), cloud_count(file, "plane.cloud_count", n);
  Source<double> numbers(file, "plane.numbers", 13 * n);
  Source<float> cloud(file, "plane.cloud");
  Source<std::uint8_t> confirmed(file, "plane.confirmed", n);
  std::set<std::pair<Id, int>> taken;
  for (const Id id : plane_ids) {
    MapPlane p;
    p.id = id;
    p.normal_world = matrix<3, 1>(numbers);
    p.distance_m = numbers.next(-1e6, 1e6);
    p.covariance = matrix<3, 3>(numbers);
    check_plane({p.normal_world, p.distance_m, false},
                file.name() + ": plane " + std::to_string(id));
    with_floors(p.covariance, {});
    p.cloud_world = points(cloud, cloud_count.count(cloud, 3));
    p.sightings = sightings.next(0, 1 << 30);
    p.confirmed = confirmed.next(0, 1) != 0;
    p.observations = observations(file, count.count(seen_at, 1), seen_in, seen_at, true, taken);
    out.planes.push_back(std::move(p));
  }
  cloud.done();
  seen_at.done();
}

void write_garments(BlobWriter& file, const SavedGarments& saved) {
  std::vector<std::int64_t> ids;  // its own, the plane's, the anchor's
  std::vector<std::int32_t> counters, parts, name_length, part_counters;
  std::vector<double> numbers, part_numbers;
  std::string names;
  for (const auto& g : saved.garments) {
    ids.insert(ids.end(), {g.id, g.supporting_plane, g.anchor});
    counters.insert(counters.end(), {g.in_map ? 1 : 0, g.sightings, g.consecutive, g.missed});
    add(numbers, g.position_world);
    add(numbers, g.covariance);
    numbers.push_back(g.extent_m);
    add(numbers, g.position_anchor);
    parts.push_back(static_cast<std::int32_t>(g.parts.size()));
    for (const auto& p : g.parts) {
      names += p.part;
      name_length.push_back(static_cast<std::int32_t>(p.part.size()));
      part_counters.insert(part_counters.end(), {p.sightings, p.has_grasp ? 1 : 0});
      add(part_numbers, p.position_world);
      add(part_numbers, p.covariance);
      part_numbers.insert(part_numbers.end(), {p.probability, p.grasp_score});
      add(part_numbers, p.approach_world);
      add(part_numbers, p.position_anchor);
    }
  }
  file.add_number("garment.next_id", saved.next_id);
  file.add("garment.ids", ids);
  file.add("garment.counters", counters);
  file.add("garment.numbers", numbers);
  file.add("garment.parts", parts);
  file.add("part.names", names);
  file.add("part.name_length", name_length);
  file.add("part.counters", part_counters);
  file.add("part.numbers", part_numbers);
}

SavedGarments read_garments(const BlobReader& file) {
  SavedGarments out;
  out.next_id = file.integer("garment.next_id", 0, kMost);
  Source<std::int32_t> parts(file, "garment.parts"), name_length(file, "part.name_length"),
      counters(file, "garment.counters", 4 * parts.size()),
      part_counters(file, "part.counters", 2 * name_length.size());
  Source<std::int64_t> ids(file, "garment.ids", 3 * parts.size());
  Source<double> numbers(file, "garment.numbers", 16 * parts.size()),
      part_numbers(file, "part.numbers", 20 * name_length.size());
  const std::string names = file.text("part.names");
  std::size_t at = 0;
  constexpr std::int32_t kMany = 1 << 30;
  while (parts.left() > 0) {
    Garment g;
    g.id = ids.next(0, kMost);
    g.supporting_plane = ids.next(kNoId, kMost);
    g.anchor = ids.next(kNoId, kMost);
    g.in_map = counters.next(0, 1) != 0;
    g.sightings = counters.next(0, kMany);
    g.consecutive = counters.next(0, kMany);
    g.missed = counters.next(0, kMany);
    g.position_world = matrix<3, 1>(numbers);
    g.covariance = matrix<3, 3>(numbers);
    g.extent_m = numbers.next();
    g.position_anchor = matrix<3, 1>(numbers);
    for (std::size_t left = parts.count(name_length, 1); left > 0; --left) {
      GarmentPart p;
      const auto length = static_cast<std::size_t>(name_length.next(0, kMany));
      if (length > names.size() - at) file.fail("the names of section part.names are too short");
      p.part = names.substr(at, length);
      at += length;
      p.sightings = part_counters.next(0, kMany);
      p.has_grasp = part_counters.next(0, 1) != 0;
      p.position_world = matrix<3, 1>(part_numbers);
      p.covariance = matrix<3, 3>(part_numbers);
      p.probability = part_numbers.next();
      p.grasp_score = part_numbers.next();
      p.approach_world = matrix<3, 1>(part_numbers);
      p.position_anchor = matrix<3, 1>(part_numbers);
      g.parts.push_back(std::move(p));
    }
    out.garments.push_back(std::move(g));
  }
  name_length.done();
  if (at != names.size()) file.fail("section part.names is too long");
  try {
    check_garments(out);
  } catch (const Error& error) {
    file.fail(error.what());
  }
  return out;
}

BlobWriter blob_of(const SavedMap& saved) {
  BlobWriter file(kKind, kVersion);
  file.add_number("version", saved.map.version);
  file.add("next_ids",
           std::vector<std::int64_t>{saved.next.key_frame, saved.next.point, saved.next.plane});
  file.add("last_frame", std::vector<std::int64_t>{saved.frame, saved.utime});
  file.add("young_points", std::vector<std::int64_t>(saved.young_points));
  write_key_frames(file, saved.map);
  write_points(file, saved.map);
  write_planes(file, saved.map);
  write_garments(file, saved.garments);
  return file;
}

SavedMap map_of(const BlobReader& file) {
  SavedMap out;
  Source<std::int64_t> next(file, "next_ids", 3), last(file, "last_frame", 2);
  out.next.key_frame = next.next(0, kMost);
  out.next.point = next.next(0, kMost);
  out.next.plane = next.next(0, kMost);
  out.frame = last.next(-1, kMost);
  out.utime = last.next(-kMost, kMost);
  out.young_points = file.values<std::int64_t>("young_points");
  MapUpdate whole;
  whole.to_version = file.integer("version", 0, kMost);
  read_key_frames(file, out.next, whole);
  read_points(file, out.next, whole);
  read_planes(file, out.next, whole);
  try {
    apply(whole, out.map);
  } catch (const Error& error) {
    file.fail(error.what());
  }
  for (const Id id : out.young_points)
    if (id < 0 || id >= out.next.point) file.fail("a young point's id cannot be");
  out.garments = read_garments(file);
  return out;
}

}  // namespace

std::vector<std::uint8_t> format_map(const SavedMap& saved) {
  auto bytes = blob_of(saved).bytes();
  if (bytes.size() > (std::size_t{256} << 20))
    throw Error("the map takes " + std::to_string(bytes.size() >> 20) +
                " MiB; a file of more than 256 MiB could not be read again");
  return bytes;
}

void write_map(const std::string& path, const SavedMap& saved) {
  format_map(saved);  // refuses what is too large
  blob_of(saved).write(path);
}

SavedMap parse_map(std::span<const std::uint8_t> bytes, const std::string& name) {
  return map_of(BlobReader::from_bytes(bytes, name, kKind, kVersion));
}

SavedMap read_map(const std::string& path) {
  return map_of(BlobReader::from_file(path, kKind, kVersion));
}

}  // namespace weft::slam
