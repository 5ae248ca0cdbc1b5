#include <gtest/gtest.h>

#include <filesystem>
#include <limits>
#include <opencv2/core.hpp>

#include "base/blob.hpp"
#include "base/hash.hpp"
#include "base/settings.hpp"
#include "dataset/iri.hpp"
#include "dataset/scene.hpp"
#include "fuzz/fuzz.hpp"
#include "messages/rgbd.hpp"
#include "rgbd/pcd_io.hpp"
#include "stage/log.hpp"
#include "support/files.hpp"

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

TEST(Fuzz, Pcd) {
  const test::TemporaryFolder folder;
  Target target{"PCD", {}, [](const Bytes& bytes) { rgbd::parse_pcd(text_of(bytes), "x"); }};
  using E = rgbd::PcdEncoding;
  for (const E encoding : {E::kAscii, E::kBinary, E::kBinaryCompressed}) {
    rgbd::write_pcd(folder / "a.pcd", cloud(), encoding);
    target.inputs.push_back(bytes_of(test::read_bytes(folder / "a.pcd")));
  }
  run(target);
}

TEST(Fuzz, IriAnnotation) {
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
  run({"IRI annotation",
       {bytes_of(dataset::format_iri_annotation(scene)), bytes_of(other)},
       [](const Bytes& bytes) { dataset::parse_iri_annotation(text_of(bytes), "x"); }});
}

TEST(Fuzz, Blob) {
  BlobWriter writer("vocabulary", 2);
  writer.add("text", "what it is");
  writer.add("bytes", std::vector<std::uint8_t>{1, 2, 3});
  writer.add("words", std::vector<std::int16_t>{-1, 300});
  writer.add("floats", std::vector<float>{0.5f, 2.0f});
  writer.add("doubles", std::vector<double>{0.25, -1e9, 3.0});
  writer.add_number("count", std::int64_t{7});
  run({"blob",
       {writer.bytes(), BlobWriter("vocabulary", 1).bytes()},
       [](const Bytes& bytes) {
         const auto reader = BlobReader::from_bytes(bytes, "x", "vocabulary", 2);
         if (reader.has("text")) reader.text("text");
         if (reader.has("bytes")) reader.values<std::uint8_t>("bytes");
         if (reader.has("words")) reader.values<std::int16_t>("words");
         if (reader.has("floats")) reader.values<float>("floats", 2);
         if (reader.has("doubles")) reader.values<double>("doubles");
         if (reader.has("count")) reader.integer("count", 0, 100);
       },
       [](Bytes& bytes) {
         if (bytes.size() < 8) return;
         Hash64 hash;
         hash.add(bytes.data(), bytes.size() - 8);
         for (std::size_t i = 0; i < 8; ++i) {
           bytes[bytes.size() - 8 + i] = static_cast<std::uint8_t>(hash.value() >> (8 * i));
         }
       }});
}

TEST(Fuzz, LcmLog) {
  const test::TemporaryFolder folder;
  const std::string path = folder / "a.lcm";
  stage::LogWriter writer(path);
  for (int i = 0; i < 6; ++i) {
    writer.write(1000 * i, i % 2 ? "WORDS" : "RGBD_FRAME",
                 Bytes(static_cast<std::size_t>(20 * i), static_cast<std::uint8_t>(i)));
  }
  writer.close();
  run({"LCM log", {bytes_of(test::read_bytes(path))}, [&](const Bytes& bytes) {
         std::filesystem::remove(path);  // to replace it would wait for the disk
         test::write_bytes(path, text_of(bytes));
         stage::LogReader reader(path);
         stage::LogEvent event;
         std::size_t events = 0;
         for (std::int64_t before = -1; reader.next(event); ++events) {
           ASSERT_GT(reader.offset(), before);
           before = reader.offset();
         }
         reader.rewind();
         for (; reader.next(event); --events) ASSERT_LE(event.channel.size(), 63u);
         ASSERT_EQ(events, 0u);
       }});
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

TEST(Fuzz, Settings) {
  const std::string text =
      "# a comment\nencoding: {colour: png, jpeg_quality: 80}\nscans:\n  fx_px: 525.5\n"
      "  registration_offset_px: [1.5, -2]\nname: 'a b'\nmappings:\n  - A=B\n  - \"C=D\"\n";
  run({"settings",
       {bytes_of(text), bytes_of("name: x\nencoding:\n  depth: rvl\n")},
       [](const Bytes& bytes) {
         Nested options;
         auto settings = Settings::from_text(text_of(bytes), "x");
         settings.read(options);
         settings.set("encoding.jpeg_quality=90");
         settings.read(options);
       }});
  run({"setting",
       {bytes_of("encoding.jpeg_quality=90"), bytes_of("mappings=[a=b, c=d]")},
       [](const Bytes& bytes) {
         Nested options;
         auto settings = Settings::empty("x");
         settings.set(text_of(bytes));
         settings.read(options);
       }});
}

}  // namespace
}  // namespace weft::fuzz
