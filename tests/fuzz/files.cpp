#include <cmath>
#include <filesystem>
#include <limits>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/blob.hpp"
#include "base/settings.hpp"
#include "dataset/garment_truth.hpp"
#include "dataset/iri.hpp"
#include "dataset/plane_scans.hpp"
#include "dataset/readers.hpp"
#include "dataset/scene.hpp"
#include "dataset/sequence.hpp"
#include "dataset/trajectory_file.hpp"
#include "fuzz/blob.hpp"
#include "fuzz/fuzz.hpp"
#include "messages/rgbd.hpp"
#include "rgbd/pcd_io.hpp"
#include "stage/lcm_url.hpp"
#include "stage/log.hpp"
#include "support/files.hpp"
#include "synth/simulation.hpp"
#include "tools/weft/log_tools.hpp"
#include "tools/weft/process_set.hpp"

/// Files: scans, annotations, models, logs, settings.
namespace weft::fuzz {
namespace {

rgbd::Cloud cloud() {
  rgbd::Cloud cloud;
  cloud.width = 8;
  cloud.height = 6;
  for (int i = 0; i < 48; ++i) {
    const auto at = static_cast<float>(i);
    cloud.points.emplace_back(0.01f * at, 0.5f - 0.01f * at, 0.9f + 0.001f * at);
  }
  cloud.points[5].setConstant(std::numeric_limits<float>::quiet_NaN());
  cloud.colour = cv::Mat(6, 8, CV_8UC3, cv::Scalar(20, 60, 200));
  return cloud;
}

WEFT_FUZZ_TARGET(Pcd) {
  const test::TemporaryFolder folder;
  Target target{{}, [](const Bytes& bytes) { rgbd::parse_pcd(text_of(bytes), "x"); }};
  using E = rgbd::PcdEncoding;
  for (const E encoding : {E::kAscii, E::kBinary, E::kBinaryCompressed}) {
    rgbd::write_pcd(folder / "a.pcd", cloud(), encoding);
    target.inputs.push_back(bytes_of(test::read_bytes(folder / "a.pcd")));
  }
  return target;
}

WEFT_FUZZ_TARGET(IriAnnotation) {
  dataset::Scene scene;
  scene.name = "a";
  scene.frame.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
  scene.polygons = {{"polo collar", "collar", {{10, 10}, {60, 12}, {30, 50}}, false, 0.9},
                    {"jeans hips", "", {{100, 10}, {160, 12}, {130, 50.5f}}, true, 0.2}};
  scene.garment = "polo";
  scene.simulation = "polo-0001";
  scene.split = "train";
  const std::string other =
      "Garment = jeans\nsplit: test-seen\nsize: 640 480\ncamera: 525 525 319.5 239.5\n"
      "PART: jeans hips\npolygon: [1, 2; 30, 4; 5, 60]  # three corners\nvisible: 0.5\n";
  return {{bytes_of(dataset::format_iri_annotation(scene)), bytes_of(other)},
          [](const Bytes& bytes) { dataset::parse_iri_annotation(text_of(bytes), "x"); }};
}

WEFT_FUZZ_TARGET(Blob) {
  BlobWriter writer("vocabulary", 2);
  writer.add("text", "what it is");
  writer.add("bytes", std::vector<std::uint8_t>{1, 2, 3});
  writer.add("words", std::vector<std::int16_t>{-1, 300});
  writer.add("floats", std::vector<float>{0.5f, 2.0f});
  writer.add("doubles", std::vector<double>{0.25, -1e9, 3.0});
  writer.add_number("count", std::int64_t{7});
  return {{writer.bytes(), BlobWriter("vocabulary", 1).bytes()},
          [](const Bytes& bytes) {
            const auto reader = BlobReader::from_bytes(bytes, "x", "vocabulary", 2);
            if (reader.has("text")) reader.text("text");
            if (reader.has("bytes")) reader.values<std::uint8_t>("bytes");
            if (reader.has("words")) reader.values<std::int16_t>("words");
            if (reader.has("floats")) reader.values<float>("floats", 2);
            if (reader.has("doubles")) reader.values<double>("doubles");
            if (reader.has("count")) reader.integer("count", 0, 100);
          },
          repair_blob};
}

/// The reader, then the tools that judge what it read.
WEFT_FUZZ_TARGET(LcmLog) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.lcm";
  stage::LogWriter writer(path);
  for (int i = 0; i < 6; ++i) {
    writer.write(1000 * i, i % 2 ? "WORDS" : "RGBD_FRAME",
                 Bytes(static_cast<std::size_t>(20 * i), static_cast<std::uint8_t>(i)));
  }
  writer.close();
  return {{bytes_of(test::read_bytes(path))}, through_file([](const std::string& log) {
            stage::LogReader reader(log);
            stage::LogEvent event;
            std::size_t events = 0;
            for (std::int64_t before = -1; reader.next(event); ++events) {
              require(reader.offset() > before, "the reader stands still");
              before = reader.offset();
            }
            reader.rewind();
            for (; reader.next(event); --events)
              require(event.channel.size() <= 63u, "a channel's name of more than 63 characters");
            require(events == 0, "another number of events when read again");
            survey_log(log, MessageTypes::built_in());
          })};
}

struct Nested {
  messages::FrameEncoding encoding;
  dataset::DatasetOptions scans;
  std::string name = "none";
  std::vector<std::string> mappings;
  void visit(OptionVisitor& v) {
    v.group("encoding", encoding);
    v.group("scans", scans);
    v.field("name", name, "");
    v.field("mappings", mappings, "");
  }
  void validate() const { encoding.validate(); }
};

WEFT_FUZZ_TARGET(Settings) {
  const std::string text =
      "# a comment\nencoding: {colour: png, jpeg_quality: 80}\nscans:\n  fx_px: 525.5\n"
      "  registration_offset_px: [1.5, -2]\nname: 'a b'\nmappings:\n  - A=B\n  - \"C=D\"\n";
  return {{bytes_of(text), bytes_of("name: x\nencoding:\n  depth: rvl\n")}, [](const Bytes& bytes) {
            Nested options;
            auto settings = Settings::from_text(text_of(bytes), "x");
            settings.read(options);
            settings.set("encoding.jpeg_quality=90");
            settings.read(options);
          }};
}

WEFT_FUZZ_TARGET(Setting) {
  return {{bytes_of("encoding.jpeg_quality=90"), bytes_of("mappings=[a=b, c=d]")},
          [](const Bytes& bytes) {
            Nested options;
            auto settings = Settings::empty("x");
            settings.set(text_of(bytes));
            settings.read(options);
          }};
}

WEFT_FUZZ_TARGET(ProcessSetFile) {
  const std::string text =
      "name: a\nmode: live\nlan: true\nlcm: {ttl: 1, group: 239.255.76.67, port: 7667, "
      "prefix: red, receive_buffer: 4194304}\n"
      "sources: [RGBD_FRAME]\nprocesses:\n  - name: mask\n    exec: weft-foreground\n"
      "    with: {a: 1, b: {c: [1, 2]}}\n    map: {WORDS: WORDS_SIFT}\n    host: robot-2\n"
      "    source: true\n    camera: left\n    trigger: single\n    rate_hz: 2.5\n    queue: 4\n"
      "    deadline_ms: 2000\n    stop_wait_s: 5\n";
  return {{bytes_of(text)},
          [](const Bytes& bytes) { ProcessSet::from_text(text_of(bytes), "x.yaml"); }};
}

WEFT_FUZZ_TARGET(LcmUrl) {
  return {{bytes_of("udpm://239.255.76.67:7667?ttl=1&recv_buf_size=4194304"), bytes_of("memq://")},
          [](const Bytes& bytes) { stage::LcmUrl::parse(text_of(bytes)); }};
}

/// The type language of LCM, of which `--types` reads files of others.
WEFT_FUZZ_TARGET(LcmTypeFile) {
  const std::string text =
      "package weft; // a comment\nstruct a_t {\n  const int32_t A = 1, B = 0x2;\n  int32_t n;\n"
      "  double m[3][n]; /* another */ string s;\n}\nstruct b_t { weft.a_t a[2]; byte x, y[4]; }\n";
  return {{bytes_of(text)}, [](const Bytes& bytes) {
            MessageTypes types;
            types.add({{"x.lcm", text_of(bytes)}});
          }};
}

WEFT_FUZZ_TARGET(Trajectory) {
  const std::string text =
      "# stamp tx ty tz qx qy qz qw\n1305031098.6659 1.3 0.6 1.6 0.65 0.6 -0.3 -0.35\n"
      "1305031098.7 -1.3e-2 0.6 1.6 0 0 0 1\n";
  return {{bytes_of(text)},
          [](const Bytes& bytes) { dataset::parse_trajectory(text_of(bytes), "x"); }};
}

WEFT_FUZZ_TARGET(GarmentTruth) {
  const std::string text =
      R"({"garments": [{"garment": "polo", "position_m": [1, 2, -3.5], "parts": [{"part": "polo )"
      R"(collar", "instance": "", "position_m": [0, 0.5, 1], "seen_share": 0.4}]}]})";
  return {{bytes_of(text)},
          [](const Bytes& bytes) { dataset::parse_garment_truth(text_of(bytes), "x"); }};
}

WEFT_FUZZ_TARGET(PartsFile) {
  const std::string text =
      "{\"scenes\": {\"00001\": {\"polo collar\": [[[1, 2], [30.5, 4], [5, 60]]], "
      "\"ignore\": {\"jeans hips\": \"out of sight\"}}, \"b\": {}}}";
  return {{bytes_of(text)},
          through_file([](const std::string& path) { dataset::read_parts_file(path); })};
}

/// The camera matrix of depth images with labelled planes.
WEFT_FUZZ_TARGET(PlaneScanMatrix) {
  const auto folder = std::make_shared<test::TemporaryFolder>();
  test::write_bytes(*folder / "depth_1.png", "");
  const std::string text = "525.5 0 319.5\n0 -525.5 239.5\n0 0 1\n";
  return {{bytes_of(text)}, through_file([folder](const std::string& path) {
            const std::string link = *folder / "kinect.K";
            if (!std::filesystem::is_symlink(link)) std::filesystem::create_symlink(path, link);
            for (const auto& file : dataset::list_plane_scans(folder->string()))
              file.camera.validate(path);
          })};
}

/// A simulated garment, from which scans are rendered.
WEFT_FUZZ_TARGET(Simulation) {
  synth::Simulation simulation;
  simulation.garment = "polo";
  simulation.state = "flat";
  simulation.cut = "{}";
  simulation.panels = {{"front", "front", 0}, {"back", "back", 1}};
  simulation.parts = {
      {"polo collar",
       "collar",
       {{0, {{0, 0}, {0.1f, 0}, {0.1f, 0.1f}}, false, 0}, {1, {{0, 0}, {0.1f, 0}}, true, 0.02f}}}};
  simulation.features.resize(2);
  simulation.features[0].kind = "hem";
  simulation.features[0].points = {{0, 0}, {0.1f, 0}};
  simulation.features[1].kind = "button";
  simulation.features[1].points = {{0, 0}};
  simulation.features[1].radius_m = 0.005f;
  simulation.pattern = {{0, 0}, {0.1f, 0}, {0, 0.1f}, {0.1f, 0.1f}};
  simulation.pose = {{0, 0, 0.1f}, {0.1f, 0, 0.1f}, {0, 0.1f, 0.1f}, {0.1f, 0.1f, 0.2f}};
  simulation.faces = {{0, 1, 2}, {1, 3, 2}};
  simulation.panel_of_face = {0, 1};
  const test::TemporaryFolder folder;
  synth::write_simulation(folder / "a.wsim", simulation);
  return {{bytes_of(test::read_bytes(folder / "a.wsim"))},
          through_file([](const std::string& path) { synth::read_simulation(path); })};
}

/// A CTU scan's annotation, beside images that fit it.
WEFT_FUZZ_TARGET(CtuAnnotation) {
  const auto folder = std::make_shared<test::TemporaryFolder>();
  cv::imwrite(*folder / "c.png", cv::Mat(8, 8, CV_8UC3, cv::Scalar(1, 2, 3)));
  cv::imwrite(*folder / "d.png", cv::Mat(3, 4, CV_16UC1, cv::Scalar(900)));
  const std::string text =
      "path_c: c.png\npath_d: d.png\ntype: polo-long\npoly_c:\n- [1, 2]\n- [30.5, 4]\n- [5, 6]\n";
  return {{bytes_of(text)}, through_file([folder](const std::string& path) {
            const std::string link = *folder / "cloA00001.yaml";
            if (!std::filesystem::is_symlink(link)) std::filesystem::create_symlink(path, link);
            dataset::open_ctu(folder->string())->read(0);
          })};
}

/// One file of a recording that is otherwise whole; others: path and content.
Target sequence_file(const std::string& name, const std::vector<std::string>& inputs,
                     const std::map<std::string, std::string>& others) {
  const auto folder = std::make_shared<test::TemporaryFolder>();
  for (const auto& [path, text] : others) {
    std::filesystem::create_directories(std::filesystem::path(*folder / path).parent_path());
    test::write_bytes(*folder / path, text);
  }
  Target target{{}, through_file([folder, name](const std::string& path) {
                  const std::string link = *folder / name;
                  if (!std::filesystem::is_symlink(link))
                    std::filesystem::create_symlink(path, link);
                  const auto sequence = dataset::open_sequence(folder->string());
                  require(std::isfinite(sequence.depth_unit_m) && sequence.depth_unit_m > 0,
                          "an impossible depth unit");
                  sequence.camera.validate("camera");
                  for (const auto& pose : sequence.truth)
                    require(pose.camera_in_world.allFinite() &&
                                pose.rotation_world_camera.coeffs().allFinite(),
                            "a pose that is not finite");
                })};
  for (const auto& input : inputs) target.inputs.push_back(bytes_of(input));
  return target;
}

const std::string kRgbList = "# colour\n1305031098.6659 rgb/a.png\n1305031098.70 rgb/b.png\n";
const std::string kDepthList = "1305031098.67 depth/a.png\n1305031098.69 depth/b.png\n";

WEFT_FUZZ_TARGET(SequenceList) {
  return sequence_file("rgb.txt", {kRgbList}, {{"depth.txt", kDepthList}});
}

WEFT_FUZZ_TARGET(SequenceAssociations) {
  return sequence_file("associations.txt",
                       {"1.5 rgb/a.png 1.6 depth/a.png\n2 depth/b.png 2 rgb/b.png\n"},
                       {{"rgb.txt", kRgbList}, {"depth.txt", kDepthList}});
}

WEFT_FUZZ_TARGET(SequenceCamera) {
  return sequence_file("camera.yaml",
                       {"width: 640\nheight: 480\nfx: 525\nfy: 525.5\ncx: 319.5\ncy: 239.5\n"
                        "depth_factor: 5000\n"},
                       {{"rgb.txt", kRgbList}, {"depth.txt", kDepthList}});
}

WEFT_FUZZ_TARGET(SequencePose) {
  return sequence_file("frame-000000.pose.txt", {"1 0 0 0.5\n0 1 0 -0.5\n0 0 1 2e-1\n0 0 0 1\n"},
                       {{"frame-000000.color.png", ""}, {"frame-000000.depth.png", ""}});
}

/// Images of data sets, as they lie there.
WEFT_FUZZ_TARGET(ImageFile) {
  const cv::Mat depth(3, 4, CV_16UC1, cv::Scalar(900)), colour(8, 8, CV_8UC3, cv::Scalar(1, 2, 3));
  Target target{{}, through_file([](const std::string& path) {
                  try {
                    dataset::read_depth_image(path);
                  } catch (const Error&) {
                    dataset::read_colour_image(path);
                  }
                })};
  for (const auto& [image, ending] :
       {std::pair{depth, ".png"}, {colour, ".png"}, {colour, ".jpg"}}) {
    target.inputs.emplace_back();
    cv::imencode(ending, image, target.inputs.back());
  }
  return target;
}

}  // namespace
}  // namespace weft::fuzz
