#include "bovw/vocabulary.hpp"
#include "detector/prior.hpp"
#include "detector/refiner.hpp"
#include "detector/window_scorer.hpp"
#include "fuzz/blob.hpp"
#include "fuzz/fuzz.hpp"
#include "slam/map_file.hpp"
#include "slam/vocabulary.hpp"
#include "support/files.hpp"

/// Trained models and saved maps.
namespace weft::fuzz {
namespace {

/// Model: has read() and write() of a path.
template <class Model>
Target target(const std::vector<Model>& models) {
  const test::TemporaryFolder folder;
  Target target{{}, through_file([](const std::string& path) { Model::read(path); }), repair_blob};
  for (const Model& model : models) {
    model.write(folder / "model");
    target.inputs.push_back(bytes_of(test::read_bytes(folder / "model")));
  }
  return target;
}

std::vector<detector::HistogramBlock> blocks() {
  return {{"sift", 7, 4, true}, {"finddd", 8, 3, false}};
}

WEFT_FUZZ_TARGET(ScoreModel) {
  detector::ScoreModel model;
  model.blocks = blocks();
  model.parts = {{"polo collar", {{1, -2, 3, 4, 5, 6}, {7, 8, 9}}, 0.5, {{60, 48}, {90, 40.5}}},
                 {"jeans hips", {{1, -2, 3, 4, 5, 6}, {7, 8, 9}}, -0.5, {{120, 48}}}};
  return target<detector::ScoreModel>({model});
}

WEFT_FUZZ_TARGET(RefineModel) {
  detector::RefineModel model;
  model.blocks = blocks();
  detector::PartSvm svm;
  svm.part = "polo collar";
  svm.shapes = {{60, 48}};
  svm.counts = {1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 8, 7, 6, 5, 4, 3, 2, 1};
  svm.coefficients = {0.5, -0.5};
  model.parts = {svm};
  return target<detector::RefineModel>({model});
}

WEFT_FUZZ_TARGET(PriorModel) {
  detector::PriorModel model;
  model.blocks = {{"sift", 7, 4, false}};
  model.parts = {{"polo collar", {0.5, -1, 2, 3}, 0.25, 0.1}};
  return target<detector::PriorModel>({model});
}

WEFT_FUZZ_TARGET(Vocabulary) {
  return target<bovw::Vocabulary>(
      {bovw::Vocabulary("sift", 4, {1, 2, 3, 4, 50, 60, 70, 80}, 9, "step_px: 6\n")});
}

WEFT_FUZZ_TARGET(BinaryVocabulary) {
  std::vector<std::vector<slam::Descriptor>> pictures(3);
  for (std::uint64_t i = 0; i < 30; ++i)
    pictures[i % 3].push_back({i * 0x9e3779b97f4a7c15u, ~i, i << 40, i});
  return target<slam::BinaryVocabulary>(
      {slam::BinaryVocabulary::train(pictures, {.branching = 3, .levels = 2})});
}

/// Two key frames, each with features and a plane segment, that see the same points and plane.
slam::SavedMap saved_map() {
  slam::MapEditor editor;
  for (int k = 0; k < 2; ++k) {
    slam::KeyFrame key_frame;
    key_frame.frame = 10 * k;
    key_frame.camera = {64, 48, 50.0, 50.0, 31.5, 23.5};
    key_frame.T_camera_world.translation.x() = 0.1 * k;
    for (int i = 0; i < 4; ++i) {
      slam::Feature feature;
      feature.u_px = 10.0f * static_cast<float>(i);
      feature.depth_m = 1.0f;
      feature.descriptor = {1, 2, 3, static_cast<std::uint64_t>(i)};
      key_frame.features.push_back(feature);
    }
    plane::PlaneSegment segment;
    segment.plane.distance_m = -1.0;
    segment.covariance = 1e-4 * Eigen::Matrix3d::Identity();
    segment.points_camera = {{0, 0, 1}, {0.1f, 0, 1}};
    key_frame.planes.push_back({segment, slam::kNoId});
    editor.add_key_frame(key_frame);
  }
  editor.set_parent(1, 0);
  editor.tie(0, 1);
  const slam::Id plane = editor.add_plane({0, 0, -1}, -1.0);
  editor.edit_plane(plane).cloud_world = {{0, 0, 1}};
  for (int i = 0; i < 3; ++i) editor.add_point({0.1 * i, 0, 1}, 0);
  for (int k = 0; k < 2; ++k) {
    editor.observe_plane(plane, k, 0);
    for (int i = 0; i < 3; ++i) editor.observe_point(i, k, i);
  }
  editor.take_update(10);
  slam::SavedMap saved{editor.map(), editor.next_ids(), {2}, 10, 333, {}};
  slam::Garment garment;
  garment.id = 1;
  garment.anchor = 1;
  slam::GarmentPart part;
  part.part = "collar";
  garment.parts = {part, part};
  saved.garments = {{garment}, 2};
  return saved;
}

WEFT_FUZZ_TARGET(Map) {
  return {{slam::format_map(saved_map()), slam::format_map({})},
          [](const Bytes& bytes) {
            const auto saved = slam::parse_map(bytes, "x");
            const slam::MapEditor editor(saved.map, saved.next);
            for (const auto& [id, point] : saved.map.points)
              for (const auto& [key_frame, index] : point.observations)
                require(
                    editor.key_frame(key_frame).points.at(static_cast<std::size_t>(index)) == id,
                    "a key frame does not know of a point it sees");
            require(slam::format_map(saved) ==
                        slam::format_map(slam::parse_map(slam::format_map(saved), "x")),
                    "a map that was read and written is another");
          },
          repair_blob};
}

}  // namespace
}  // namespace weft::fuzz
