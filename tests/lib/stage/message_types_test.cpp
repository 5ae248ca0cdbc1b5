#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <random>
#include <set>

#include "base/hash.hpp"
#include "fake_stage.hpp"
#include "weft/camera_in_base_t.hpp"
#include "weft/camera_pose_t.hpp"
#include "weft/clock_pong_t.hpp"
#include "weft/image_prior_t.hpp"
#include "weft/keyframe_t.hpp"
#include "weft/map_content_t.hpp"
#include "weft/map_objects_t.hpp"
#include "weft/map_update_t.hpp"
#include "weft/part_candidates_t.hpp"
#include "weft/part_detections_t.hpp"
#include "weft/planes_t.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

/// What holds for every message type in lcmtypes/.
namespace weft {
namespace {

using stage::fake::Bytes;
using stage::fake::encode;

struct Known {
  std::int64_t now;    // what this build computes
  std::uint64_t held;  // what logs were written with
};

template <class Message>
std::int64_t now() {
  return static_cast<std::int64_t>(Message::getHash());
}

/// A fingerprint changes with the name or type of any field. Logs hold it: when one changes, keep
/// the old type under a new name and write a converter, then enter the new fingerprint here.
const std::map<std::string, Known>& known_types() {
  static const std::map<std::string, Known> types{
      {"camera_in_base_t", {now<camera_in_base_t>(), 0x8abec4b64dc2ba67u}},
      {"camera_model_t", {now<camera_model_t>(), 0x0d804340371ff466u}},
      {"camera_pose_t", {now<camera_pose_t>(), 0xee3b475679bc18abu}},
      {"cylinder_segment_t", {now<cylinder_segment_t>(), 0xebb0a4ba6c8fe445u}},
      {"features_t", {now<features_t>(), 0xff841f90eafa3389u}},
      {"clock_pong_t", {now<clock_pong_t>(), 0x2fb1200a44ae4959u}},
      {"foreground_t", {now<foreground_t>(), 0xb35ec6fbd1eb45d9u}},
      {"grasp_t", {now<grasp_t>(), 0x04d9318dbfb11f33u}},
      {"grasps_t", {now<grasps_t>(), 0xe863abdf0bd0053eu}},
      {"header_t", {now<header_t>(), 0xdd479d0c4ec6448fu}},
      {"image_prior_t", {now<image_prior_t>(), 0x6a8484cf19549806u}},
      {"keyframe_t", {now<keyframe_t>(), 0x01b01df59833eac1u}},
      {"map_content_t", {now<map_content_t>(), 0x036d4974e9113bddu}},
      {"map_key_frame_change_t", {now<map_key_frame_change_t>(), 0xb5ef0d4942e146e3u}},
      {"map_key_frame_t", {now<map_key_frame_t>(), 0x4fa4c0c8a06b7e3au}},
      {"map_object_t", {now<map_object_t>(), 0x62bde0a4f418b01eu}},
      {"map_objects_t", {now<map_objects_t>(), 0x57ee8a0e82fef72cu}},
      {"map_observation_t", {now<map_observation_t>(), 0x99f4f3f9146a0e38u}},
      {"map_part_t", {now<map_part_t>(), 0x7454e93652183ecdu}},
      {"map_plane_t", {now<map_plane_t>(), 0x18cd4c6858acf1f4u}},
      {"map_point_t", {now<map_point_t>(), 0xa28c8523f276365bu}},
      {"map_update_t", {now<map_update_t>(), 0x352f11829511e5a5u}},
      {"part_candidate_t", {now<part_candidate_t>(), 0xe64488e3159eb298u}},
      {"part_candidates_t", {now<part_candidates_t>(), 0x8b54f3372401477bu}},
      {"part_detection_t", {now<part_detection_t>(), 0xcacaea41cefac2b3u}},
      {"part_detections_t", {now<part_detections_t>(), 0x1985690fb6a63b4eu}},
      {"part_map_t", {now<part_map_t>(), 0xca0f1c6bc5482ae8u}},
      {"part_prior_t", {now<part_prior_t>(), 0x914a2714a116be47u}},
      {"plane_segment_t", {now<plane_segment_t>(), 0x0901f6fde761cd91u}},
      {"plane_t", {now<plane_t>(), 0x68e2d83f10e62d8bu}},
      {"planes_t", {now<planes_t>(), 0xca2129b90f0b0adfu}},
      {"pose_t", {now<pose_t>(), 0x935131a40df559d9u}},
      {"probability_map_t", {now<probability_map_t>(), 0xe0c45f97f811b169u}},
      {"rgbd_frame_t", {now<rgbd_frame_t>(), 0x3195003552ca216au}},
      {"sightings_t", {now<sightings_t>(), 0x8f2393ded4b1593eu}},
      {"stage_status_t", {now<stage_status_t>(), 0xe3b8f89478512ef2u}},
      {"stage_timing_t", {now<stage_timing_t>(), 0x6186b97f76e19ff1u}},
      {"status_t", {now<status_t>(), 0xf295ebf8bbebd66bu}},
      {"type_fingerprint_t", {now<type_fingerprint_t>(), 0x4d2b9c8e12f33893u}},
      {"view_t", {now<view_t>(), 0xf863a0991c6b237du}},
      {"words_t", {now<words_t>(), 0x31c2f5a82d07967bu}}};
  return types;
}

TEST(MessageTypes, FingerprintsAreHeld) {
  for (const auto& [name, type] : known_types()) {
    EXPECT_EQ(to_hex(static_cast<std::uint64_t>(type.now)), to_hex(type.held)) << name;
  }
}

TEST(MessageTypes, NoTwoShareAFingerprint) {
  std::map<std::int64_t, std::string> by_fingerprint;
  for (const auto& [name, type] : known_types()) {
    const auto [other, is_new] = by_fingerprint.emplace(type.now, name);
    EXPECT_TRUE(is_new) << name << " and " << other->second << " are confused: rename a field";
  }
}

TEST(MessageTypes, AllAreHeld) {
  std::set<std::string> files;
  std::set<std::string> held;
  for (const auto& entry : std::filesystem::directory_iterator(WEFT_SOURCE_DIR "/lcmtypes"))
    if (entry.path().extension() == ".lcm") files.insert(entry.path().stem());
  for (const auto& [name, type] : known_types()) held.insert(name);
  EXPECT_EQ(files, held);
}

/// Decodes bytes with one byte after another changed, and cut at every length: must neither crash,
/// nor read beyond the end (the address sanitizer watches), nor allocate by a hostile count.
template <class Message>
void damage(const Message& message) {
  const Bytes good = encode(message);
  Message decoded{};
  ASSERT_EQ(decoded.decode(good.data(), 0, static_cast<int>(good.size())),
            static_cast<int>(good.size()));
  EXPECT_EQ(encode(decoded), good);
  int refused = 0;
  const auto attempt = [&](const Bytes& bytes) {
    // Exactly as large as the message, so that the sanitizer sees every byte read beyond it.
    const auto copy = std::make_unique<std::uint8_t[]>(bytes.size());
    std::copy(bytes.begin(), bytes.end(), copy.get());
    Message hostile{};
    const int size = static_cast<int>(bytes.size());
    refused += hostile.decode(copy.get(), 0, size) != size;
  };
  for (std::size_t length = 0; length < good.size(); ++length)
    attempt(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length)));
  EXPECT_EQ(refused, static_cast<int>(good.size()));
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const int value : {0x00, 0x7f, 0x80, 0xff}) {
      Bytes bytes = good;
      bytes[i] = static_cast<std::uint8_t>(value);
      attempt(bytes);
    }
  }
}

TEST(MessageTypes, DecodersCheckEveryCount) {
  const auto header = stage::fake::header(3);
  damage(stage::fake::frame(header, 50));
  auto words = stage::fake::message<words_t>(header);
  words.cells = {1, 2, 3};
  words.cell_count = 3;
  damage(words);
  auto foreground = stage::fake::message<foreground_t>(header);
  foreground.runs = {1, 2, 3};
  foreground.run_count = 3;
  damage(foreground);
  auto prior = stage::fake::message<image_prior_t>(header);
  prior.parts.resize(2);
  prior.part_count = 2;
  damage(prior);
  auto candidates = stage::fake::message<part_candidates_t>(header);
  candidates.candidates.resize(2);
  candidates.candidate_count = 2;
  damage(candidates);
  auto map = stage::fake::message<probability_map_t>(header);
  map.maps.resize(2);
  map.map_count = 2;
  for (auto& each : map.maps) {
    each.values = {1, 2, 3, 4};
    each.value_count = 4;
  }
  damage(map);
  auto detections = stage::fake::message<part_detections_t>(header);
  detections.detections.resize(2);
  detections.detection_count = 2;
  damage(detections);
  auto grasps = stage::fake::message<grasps_t>(header);
  grasps.grasps.resize(2);
  grasps.grasp_count = 2;
  damage(grasps);
  auto planes = stage::fake::message<planes_t>(header);
  planes.planes.resize(1);
  planes.plane_count = 1;
  planes.planes[0].points_camera_m = {1.0f, 2.0f, 3.0f};
  planes.planes[0].coordinate_count = 3;
  planes.cylinders.resize(1);
  planes.cylinder_count = 1;
  planes.labels = {1, 2};
  planes.label_size = 2;
  damage(planes);
  damage(stage::fake::message<camera_pose_t>(header));
  features_t features{};
  features.count = 1;
  features.u_px = features.v_px = features.depth_m = features.angle_deg = {1.0f};
  features.level = {1};
  features.descriptors.resize(32);
  features.descriptor_size = 32;
  auto key_frame = stage::fake::message<keyframe_t>(header);
  key_frame.features = features;
  key_frame.points = {1};
  key_frame.point_count = 1;
  key_frame.planes.resize(1);
  key_frame.plane_ids = {1};
  key_frame.plane_count = 1;
  key_frame.seen_points.ids = {1};
  key_frame.seen_points.visible = key_frame.seen_points.found = {2};
  key_frame.seen_points.sighting_count = 1;
  damage(key_frame);
  auto objects = stage::fake::message<map_objects_t>(header);
  objects.objects.resize(1);
  objects.object_count = 1;
  objects.objects[0].parts.resize(1);
  objects.objects[0].part_count = 1;
  damage(objects);
  auto update = stage::fake::message<map_update_t>(header);
  update.data = {1, 2, 3};
  update.data_size = 3;
  damage(update);
  map_content_t content{};
  content.new_key_frames.resize(1);
  content.new_key_frame_count = 1;
  content.new_key_frames[0].features = features;
  content.new_key_frames[0].loop_partners = {1};
  content.new_key_frames[0].loop_partner_count = 1;
  content.changes.resize(1);
  content.change_count = 1;
  content.points.resize(1);
  content.point_count = 1;
  content.points[0].observations.resize(1);
  content.points[0].observation_count = 1;
  content.planes.resize(1);
  content.plane_count = 1;
  content.planes[0].cloud_world_m = {1.0f};
  content.planes[0].coordinate_count = 1;
  content.removed_points = {1};
  content.removed_point_count = 1;
  damage(content);
  stage_status_t status{};
  status.fingerprints.resize(2);
  status.fingerprint_count = 2;
  damage(status);
  damage(stage_timing_t{});
}

}  // namespace
}  // namespace weft
