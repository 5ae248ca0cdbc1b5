#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "dataset/garment_truth.hpp"
#include "dataset/sequence.hpp"
#include "support/files.hpp"
#include "support/folder_contents.hpp"
#include "synth/arrange.hpp"
#include "synth/sequences_maker.hpp"
#include "synth/states_maker.hpp"
#include "tools/synth/procedural.hpp"
#include "tools/synth/rle.hpp"

namespace weft::synth {
namespace {

namespace fs = std::filesystem;

const StatesReport kQuiet = [](const StatesProgress&) {};
const auto kNever = [] { return false; };

/// Two of the procedural sacks, flat ones.
void write_sacks(const test::TemporaryFolder& folder) {
  write_simulation(folder / "a.wsim", test::procedural_sack("a", 0.004f));
  write_simulation(folder / "b.wsim", test::procedural_sack("b"));
}

TEST(Arrange, NothingOverlapsAndTouchingTouches) {
  const Simulation sack = test::procedural_sack();
  const std::vector<const Simulation*> three = {&sack, &sack, &sack};
  const Prism top = make_box({0, 0}, {2.0f, 1.6f}, -0.03f, 0.0f);
  Random random(5);
  for (const auto neighbours : {Neighbours::kApart, Neighbours::kTouching}) {
    const auto placements = arrange(random, three, top, neighbours);
    ASSERT_TRUE(placements);
    float nearest = 1e9f;
    for (std::size_t i = 0; i < 3; ++i) {
      for (const auto& p : sack.pose) {
        const Vec3 q = (*placements)[i].apply(p);
        EXPECT_TRUE(contains(top, q.head<2>()));
        for (std::size_t k = 0; k < i; ++k) {
          for (const auto& o : sack.pose)
            nearest = std::min(nearest, (q - (*placements)[k].apply(o)).head<2>().norm());
        }
      }
    }
    if (neighbours == Neighbours::kApart) {
      EXPECT_GT(nearest, 0.014f);
    } else {
      EXPECT_LT(nearest, 0.03f);
      EXPECT_GT(nearest, 0.0f);
    }
  }
  EXPECT_FALSE(
      arrange(random, three, make_box({0, 0}, {0.5f, 0.6f}, 0.0f, 0.1f), Neighbours::kTouching));
}

TEST(States, EveryRunOfArrangementsHasEachKindInItsShare) {
  for (int first = 0; first < 400; first += 100) {
    std::map<std::string, int> test, train;
    for (int i = first; i < first + 100; ++i) {
      const auto plan = plan_arrangement(i, true);
      ++(plan.test ? test : train)[plan.kind];
    }
    const auto near = [](std::map<std::string, int>& counts, const char* kind, double expected) {
      EXPECT_NEAR(counts[kind], expected, 1.5) << kind;
    };
    near(test, "single", 0.35 * 25);
    near(test, "apart", 0.30 * 25);
    near(test, "touching-different-colours", 0.20 * 25);
    near(test, "touching-same-colour", 0.15 * 25);
    near(train, "single", 0.35 * 75);
    near(train, "apart", 0.30 * 75);
    near(train, "touching-different-colours", 0.35 * 75);
    EXPECT_EQ(train.count("touching-same-colour"), 0u);
  }
  for (int i = 0; i < 100; ++i) {
    const auto plan = plan_arrangement(i, false);
    EXPECT_FALSE(plan.test);
    EXPECT_NE(plan.kind, "touching-same-colour");
  }
}

TEST(States, SameBytesAgainAndCocoAgreesWithTheLabels) {
  const test::TemporaryFolder in, out;
  write_sacks(in);
  StatesRecipe recipe;
  recipe.scenes = 2;
  recipe.views = 2;
  recipe.samples = 1;
  recipe.mesh_step_mm = 10.0;
  const auto make = [&](const std::string& folder, int jobs) {
    return make_states(*simulations_of_folder(in.string()), folder, recipe, "settings", jobs,
                       kQuiet, kNever);
  };
  EXPECT_EQ(make(out / "one", 1).done, 2);
  const auto first = test::folder_contents(out / "one");
  // What a kill leaves: an image without its notes, half a file, no COCO files.
  fs::copy(out / "one", out / "two", fs::copy_options::recursive);
  fs::remove(out / "two/meta/000001.json");
  fs::remove(out / "two/annotations/instances_train.json");
  test::write_bytes(out / "two/labels/000001.png", "half");
  make(out / "two", 2);
  EXPECT_EQ(first, test::folder_contents(out / "two"));
  EXPECT_EQ(first.count("meshes/flat/a.obj"), 1u);
  EXPECT_EQ(first.count("meshes/desk/round.obj"), 1u);

  // One T-shirt: its images are in the paper's first versions, or in the last if seen from beside.
  for (const char* split : {"train", "test"}) {
    const auto all = nlohmann::json::parse(
        first.at(std::string("annotations/instances_") + split + ".json"))["images"];
    std::map<std::string, std::size_t> expected;
    for (const auto& image : all) {
      const std::string subset = image["subset"];
      EXPECT_EQ(subset == "v4sd", image["view"] == "beside");
      EXPECT_EQ(subset.substr(1, 1), std::to_string(image["version"].get<int>()));
      if (split == std::string("test")) ++expected["test-" + subset];
      for (int v = image["version"]; v < 4 && split == std::string("train"); ++v)
        ++expected["train-v" + std::to_string(v)];
    }
    for (const auto& [name, bytes] : first) {
      const std::string stem = std::string("annotations/instances_") + split + "-";
      if (!name.starts_with(stem)) continue;
      const std::string key = name.substr(22, name.size() - 22 - 5);
      EXPECT_EQ(nlohmann::json::parse(bytes)["images"].size(), expected[key]) << key;
    }
  }
  EXPECT_EQ(first.count("annotations/instances_train-v3.json"), 1u);
  EXPECT_EQ(first.count("annotations/instances_test-v3mcs.json"), 1u);

  int annotations = 0, desks = 0;
  for (const char* split : {"train", "test"}) {
    const auto coco =
        nlohmann::json::parse(first.at(std::string("annotations/instances_") + split + ".json"));
    for (const auto& image : coco["images"]) {
      const std::string file = image["file_name"];
      const cv::Mat labels = cv::imread(out / ("one/labels/" + file), cv::IMREAD_UNCHANGED);
      const cv::Mat depth = cv::imread(out / ("one/depth/" + file), cv::IMREAD_UNCHANGED);
      const cv::Mat colour = cv::imread(out / ("one/images/" + file));
      ASSERT_EQ(labels.size(), cv::Size(640, 480));
      ASSERT_EQ(depth.type(), CV_16UC1);
      ASSERT_EQ(colour.size(), labels.size());
      EXPECT_GT(cv::countNonZero(depth), 640 * 480 / 2);
      for (const auto& a : coco["annotations"]) {
        if (a["image_id"] != image["id"]) continue;
        ++annotations;
        const cv::Mat mask = labels == a["label"].get<int>();
        const std::string counts = a["segmentation"]["counts"];
        EXPECT_EQ(cv::countNonZero(mask != test::decode_rle(counts, mask.rows, mask.cols)), 0);
        EXPECT_EQ(a["area"], cv::countNonZero(mask));
        const auto box = a["bbox"].get<std::vector<int>>();
        EXPECT_EQ(cv::countNonZero(mask(cv::Rect(box[0], box[1], box[2], box[3]))), a["area"]);
        desks += a["category_id"] == 7 ? 1 : 0;
      }
    }
  }
  EXPECT_GE(annotations, 4);
  EXPECT_EQ(desks, 2);
  const auto error = test::error_of([&] {
    make_states(*simulations_of_folder(in.string()), out / "one", recipe, "others", 1, kQuiet,
                kNever);
  });
  EXPECT_NE(error.find("other settings"), std::string::npos) << error;
}

struct Frame {
  double stamp = 0.0;
  Eigen::Isometry3d T_world_camera;
  cv::Mat colour, depth, labels;
};

/// Reads a sequence by its text files, as tools for the TUM format do.
std::vector<Frame> read_tum(const fs::path& folder) {
  std::map<std::string, Eigen::Isometry3d> truth;
  std::ifstream poses(folder / "groundtruth.txt");
  for (std::string line; std::getline(poses, line);) {
    if (line.starts_with("#")) continue;
    std::istringstream in(line);
    std::string stamp;
    double tx, ty, tz, x, y, z, w;
    EXPECT_TRUE(in >> stamp >> tx >> ty >> tz >> x >> y >> z >> w) << line;
    EXPECT_NEAR(x * x + y * y + z * z + w * w, 1.0, 1e-5);
    truth[stamp] = Eigen::Translation3d(tx, ty, tz) * Eigen::Quaterniond(w, x, y, z).normalized();
  }
  std::vector<Frame> frames;
  std::ifstream pairs(folder / "associations.txt");
  std::string rgb_stamp, rgb, depth_stamp, depth;
  while (pairs >> rgb_stamp >> rgb >> depth_stamp >> depth) {
    Frame f;
    f.stamp = std::stod(rgb_stamp);
    f.T_world_camera = truth.at(rgb_stamp);
    f.colour = cv::imread((folder / rgb).string());
    f.depth = cv::imread((folder / depth).string(), cv::IMREAD_UNCHANGED);
    f.labels = cv::imread((folder / "masks" / (rgb_stamp + ".png")).string(), cv::IMREAD_UNCHANGED);
    frames.push_back(std::move(f));
  }
  return frames;
}

TEST(Sequences, DepthOfOneFrameIsWhereAnotherSeesIt) {
  const test::TemporaryFolder in, out;
  write_sacks(in);
  SequencesRecipe recipe;
  recipe.scenes = 1;
  recipe.seconds = 0.201;  // six frames
  recipe.samples = 1;
  const auto make = [&](int jobs) {
    return make_sequences(*simulations_of_folder(in.string()), out / "set", recipe, "", jobs,
                          kQuiet, kNever);
  };
  EXPECT_EQ(make(2).done, 1);
  const fs::path folder = out / "set/sequence-000";
  const auto first = test::folder_contents(out / "set");
  // A kill in the middle: the last frames and the lists are missing.
  fs::remove(folder / "groundtruth.txt");
  const std::string last = tum_stamp(5) + ".png";
  fs::remove(folder / "masks" / last);
  test::write_bytes((folder / "rgb" / last).string(), "half");
  make(1);
  EXPECT_EQ(first, test::folder_contents(out / "set"));

  const auto frames = read_tum(folder);
  ASSERT_EQ(frames.size(), 6u);
  EXPECT_NEAR(frames[5].stamp - frames[0].stamp, 5.0 / 30.0, 1e-5);
  std::map<std::string, double> camera;
  std::ifstream yaml(folder / "camera.yaml");
  for (std::string line; std::getline(yaml, line);) {
    const auto colon = line.find(": ");
    if (!line.starts_with("#")) camera[line.substr(0, colon)] = std::stod(line.substr(colon + 2));
  }
  const Frame &a = frames[0], &b = frames[5];
  EXPECT_GT((a.T_world_camera.translation() - b.T_world_camera.translation()).norm(), 0.01);
  const Eigen::Isometry3d T_b_a = b.T_world_camera.inverse() * a.T_world_camera;
  std::vector<double> error_px_disparity;
  int same_label = 0, count = 0;
  for (int v = 0; v < a.depth.rows; v += 3) {
    for (int u = 0; u < a.depth.cols; u += 3) {
      const double z = a.depth.at<std::uint16_t>(v, u) / camera.at("depth_factor");
      if (z == 0.0) continue;
      const Eigen::Vector3d p =
          T_b_a * Eigen::Vector3d((u - camera.at("cx")) * z / camera.at("fx"),
                                  (v - camera.at("cy")) * z / camera.at("fy"), z);
      const int x = cvRound(camera.at("fx") * p.x() / p.z() + camera.at("cx"));
      const int y = cvRound(camera.at("fy") * p.y() / p.z() + camera.at("cy"));
      if (x < 0 || y < 0 || x >= b.depth.cols || y >= b.depth.rows) continue;
      const double seen = b.depth.at<std::uint16_t>(y, x) / camera.at("depth_factor");
      if (seen == 0.0) continue;
      error_px_disparity.push_back(575 * 0.075 * std::abs(1.0 / seen - 1.0 / p.z()));
      same_label += b.labels.at<std::uint8_t>(y, x) == a.labels.at<std::uint8_t>(v, u) ? 1 : 0;
      ++count;
    }
  }
  ASSERT_GT(count, 10'000);
  // Noise of the sensor: an eighth of a pixel of disparity, bands and blotches.
  std::sort(error_px_disparity.begin(), error_px_disparity.end());
  EXPECT_LT(error_px_disparity[error_px_disparity.size() / 2], 0.12);
  EXPECT_LT(error_px_disparity[error_px_disparity.size() * 9 / 10], 0.6);
  EXPECT_GT(same_label, 0.96 * count);
  // Wrong poses would not do: the identity leaves more.
  double by_identity = 0.0;
  int pairs = 0;
  for (int v = 0; v < a.depth.rows; v += 3) {
    for (int u = 0; u < a.depth.cols; u += 3) {
      const double za = a.depth.at<std::uint16_t>(v, u), zb = b.depth.at<std::uint16_t>(v, u);
      if (za == 0.0 || zb == 0.0) continue;
      by_identity += 575 * 0.075 * std::abs(5000 / za - 5000 / zb);
      ++pairs;
    }
  }
  double mean = 0.0;
  for (const double e : error_px_disparity) mean += e / static_cast<double>(count);
  EXPECT_LT(mean, 0.7 * by_identity / pairs);
}

TEST(Sequences, AboveTellsWhereTheGarmentAndItsPartsAre) {
  const test::TemporaryFolder in, out;
  write_simulation(in / "a.wsim", test::procedural_sack("a"));
  Simulation other = test::procedural_sack("b");
  other.turned_over = true;  // its parts cannot be seen: never drawn
  write_simulation(in / "b.wsim", other);
  SequencesRecipe recipe;
  recipe.view = SequencesRecipe::View::kAbove;
  recipe.scenes = 1;
  recipe.seconds = 0.1;  // three frames
  recipe.samples = 1;
  const auto make = [&] {
    return make_sequences(*simulations_of_folder(in.string()), out / "set", recipe, "", 1, kQuiet,
                          kNever);
  };
  make();
  const fs::path folder = out / "set/sequence-000";
  const auto truth = dataset::read_garment_truth((folder / "garments.json").string());
  ASSERT_EQ(truth.size(), 1u);
  EXPECT_EQ(truth[0].garment, "tshirt");
  ASSERT_EQ(truth[0].parts.size(), 2u);
  const auto frames = read_tum(folder);
  ASSERT_EQ(frames.size(), 3u);
  const auto sequence = dataset::open_sequence(folder.string());
  ASSERT_EQ(sequence.frames.size(), 3u);
  const auto frame = sequence.read(0);
  const Eigen::Isometry3d T_camera_world = frames[0].T_world_camera.inverse();
  const auto check = [&](const Eigen::Vector3d& position_world, const std::string& name) {
    const Eigen::Vector3d point_camera = T_camera_world * position_world;
    EXPECT_GT(point_camera.z(), 0.6) << name;
    EXPECT_LT(point_camera.z(), 1.2) << name;
    const Eigen::Vector2d pixel = frame.camera.project(point_camera);
    const int u = cvRound(pixel.x()), v = cvRound(pixel.y());
    ASSERT_TRUE(u >= 0 && v >= 0 && u < frame.depth.cols && v < frame.depth.rows) << name;
    EXPECT_EQ(int{frames[0].labels.at<std::uint8_t>(v, u)}, 1) << name;
    EXPECT_NEAR(frame.depth_m(u, v), point_camera.z(), 0.015) << name;
  };
  check(truth[0].position_world, "sack");
  for (const auto& part : truth[0].parts) check(part.position_world, part.part);
  // The patch's middle is 10 cm left of and 14 cm below the sack's, however that is turned.
  EXPECT_NEAR((truth[0].parts[1].position_world - truth[0].position_world).norm(),
              Eigen::Vector2d(0.1, 0.14).norm(), 0.006);
  EXPECT_NEAR(truth[0].parts[1].seen_share, 1.0, 0.02);
  EXPECT_NEAR(truth[0].parts[0].seen_share, 0.5, 0.02);  // of the collar the front

  fs::remove(in / "a.wsim");
  recipe.seed = 2;
  const auto error = test::error_of([&] {
    make_sequences(*simulations_of_folder(in.string()), out / "none", recipe, "", 1, kQuiet,
                   kNever);
  });
  EXPECT_NE(error.find("no simulation with parts lies flat"), std::string::npos) << error;
}

TEST(ArmPath, IsSmoothAndLooksDownAtItsTarget) {
  Random random(2);
  for (int k = 0; k < 20; ++k) {
    const Eigen::Vector3d target(0.1 * k, -0.2, 0.0);
    const ArmPath path = draw_arm_path(random, target);
    for (int frame = 0; frame < 600; ++frame) {
      const CameraPose p = path.at(frame / 30.0), q = path.at((frame + 1) / 30.0);
      EXPECT_LT((q.origin - p.origin).norm(), 0.03f);  // 0.9 m/s
      EXPECT_GT(q.forward.dot(p.forward), 0.9990f);
      EXPECT_LT(p.forward.z(), -0.85f);               // at most 32 degrees from straight down
      const float t = -p.origin.z() / p.forward.z();  // gaze meets the desk's plane
      EXPECT_LT((p.origin + t * p.forward - target.cast<float>()).norm(), 0.08f);
    }
  }
}

TEST(CameraPath, IsSmoothAndLooksAtTheDesk) {
  Random random(2);
  for (int k = 0; k < 20; ++k) {
    const CameraPath path = draw_path(random);
    for (int frame = 0; frame < 600; ++frame) {
      const CameraPose p = path.at(frame / 30.0), q = path.at((frame + 1) / 30.0);
      EXPECT_LT((q.origin - p.origin).norm(), 0.03f);  // 0.9 m/s
      EXPECT_GT(q.forward.dot(p.forward), 0.9995f);    // 1.8 degrees a frame
      const float t = -p.origin.z() / p.forward.z();   // gaze meets the desk's plane
      EXPECT_LT((p.origin + t * p.forward).norm(), 0.5f);
      EXPECT_LT(p.origin.head<2>().norm(), 1.7f);
    }
  }
}

}  // namespace
}  // namespace weft::synth
