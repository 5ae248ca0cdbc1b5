#include "tools/weft/message_types.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>

#include "lib/stage/fake_stage.hpp"
#include "support/files.hpp"
#include "tools/weft/message.hpp"
#include "weft/grasps_t.hpp"
#include "weft/image_prior_t.hpp"
#include "weft/part_candidates_t.hpp"
#include "weft/part_detections_t.hpp"
#include "weft/stage_status_t.hpp"
#include "weft/stage_timing_t.hpp"

namespace weft {
namespace {

using Bytes = std::vector<std::uint8_t>;
using Verdict = MessageTypes::Verdict;

weft::part_detections_t detections() {
  auto message = stage::fake::message<part_detections_t>(stage::fake::header(41));
  message.model_hash = -7;
  message.view.sensor_from_view[5] = 0.1;
  message.detections.resize(2);
  message.detection_count = 2;
  message.detections[1].part = "polo collar";
  message.detections[1].probability = 1.0 / 3.0;
  message.detections[1].corners_sensor[3][1] = -2.5;
  return message;
}

std::string text(const MessageTypes::Decoded& decoded, const std::string& path) {
  for (const auto& field : decoded.fields) {
    if (field.path == path) return field.text;
  }
  return "no " + path;
}

/// The fingerprints lcm-gen wrote into the code.
template <class Message>
void expect_known() {
  Message message{};
  const auto bytes = encode_message(message);
  EXPECT_EQ(MessageTypes::built_in().type_of(bytes), Message::getTypeName());
  EXPECT_EQ(MessageTypes::built_in().check(bytes), Verdict::kWhole) << Message::getTypeName();
}

TEST(MessageTypes, KnowsWhatLcmGenKnows) {
  expect_known<camera_model_t>();
  expect_known<foreground_t>();
  expect_known<grasps_t>();
  expect_known<header_t>();
  expect_known<image_prior_t>();
  expect_known<part_candidates_t>();
  expect_known<part_detections_t>();
  expect_known<probability_map_t>();
  expect_known<rgbd_frame_t>();
  expect_known<stage_status_t>();
  expect_known<stage_timing_t>();
  expect_known<status_t>();
  expect_known<view_t>();
  expect_known<words_t>();
}

TEST(MessageTypes, DecodesEveryValue) {
  const auto decoded = MessageTypes::built_in().decode(encode_message(detections()));
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->type, "part_detections_t");
  EXPECT_EQ(text(*decoded, "header.seq"), "41");
  EXPECT_EQ(text(*decoded, "model_hash"), "-7");
  EXPECT_EQ(text(*decoded, "view.sensor_from_view[5]"), "0.1");
  EXPECT_EQ(text(*decoded, "detection_count"), "2");
  EXPECT_EQ(text(*decoded, "detections[1].part"), "polo collar");
  EXPECT_EQ(std::stod(text(*decoded, "detections[1].probability")), 1.0 / 3.0);
  EXPECT_EQ(text(*decoded, "detections[1].corners_sensor[3][1]"), "-2.5");
  auto words = stage::fake::message<words_t>(stage::fake::header(1));
  words.cells = {-2, 300, -32768};
  words.cell_count = 3;
  const auto cells = MessageTypes::built_in().decode(encode_message(words));
  ASSERT_TRUE(cells);
  EXPECT_EQ(text(*cells, "cells[2]"), "-32768");
  const auto frame = MessageTypes::built_in().decode(
      encode_message(stage::fake::frame(stage::fake::header(1), 50)));
  ASSERT_TRUE(frame);
  EXPECT_TRUE(text(*frame, "data").starts_with("50 bytes, hash ")) << text(*frame, "data");
}

TEST(MessageTypes, AgreesWithTheGeneratedDecoderOnDamagedMessages) {
  const auto good = encode_message(detections());
  const auto attempt = [&](const Bytes& bytes) {
    // Exactly as large as the message, so that a sanitizer sees a byte read beyond it.
    const auto verdict = MessageTypes::built_in().check(bytes);
    EXPECT_EQ(verdict == Verdict::kWhole, MessageTypes::built_in().decode(bytes).has_value());
    return verdict;
  };
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_EQ(attempt(Bytes(good.begin(), good.begin() + static_cast<std::ptrdiff_t>(length))),
              length < 8 ? Verdict::kUnknown : Verdict::kDamaged);
  int refused = 0;
  for (std::size_t i = 8; i < good.size(); ++i) {
    for (const int value : {0x00, 0x7f, 0x80, 0xff}) {
      Bytes bytes = good;
      bytes[i] = static_cast<std::uint8_t>(value);
      const bool whole = attempt(bytes) == Verdict::kWhole;
      refused += !whole;
      const auto generated = decode_message<part_detections_t>(bytes);
      // The generated decoder does not look for a string's 0.
      EXPECT_TRUE(generated || !whole) << "byte " << i;
    }
  }
  EXPECT_GT(refused, 50);
}

TEST(MessageTypes, NamesTheFieldsThatDiffer) {
  auto a = detections(), b = detections();
  b.detections[0].probability = std::numeric_limits<double>::quiet_NaN();
  b.detections.pop_back();
  b.detection_count = 1;
  const auto& types = MessageTypes::built_in();
  const auto differences = field_differences(types.decode(encode_message(a))->fields,
                                             types.decode(encode_message(b))->fields);
  ASSERT_GE(differences.size(), 3u);
  EXPECT_EQ(differences[0].path, "detection_count");
  EXPECT_EQ(differences[1].path, "detections[0].probability");
  EXPECT_EQ(differences[1].b, "nan");
  EXPECT_EQ(differences[2].path, "detections[1].part");
  EXPECT_EQ(differences[2].b, "-");
  const auto shown = describe_difference(types, encode_message(a), encode_message(b), 2);
  EXPECT_NE(shown.find("\n  detection_count: 2 | 1\n"), std::string::npos) << shown;
  EXPECT_NE(shown.find("more"), std::string::npos) << shown;
  EXPECT_EQ(describe_difference(types, {1, 2, 3}, {1, 2}, 5),
            "first different byte 2; 3 bytes of an unknown type | 2 bytes of an unknown type");
}

TEST(MessageTypes, TakesTypesOfAnExperiment) {
  const test::TemporaryFolder folder;
  test::write_bytes(folder / "wrinkle_t.lcm", R"(
package lab; // a type beside weft's
struct wrinkle_t {
    const int32_t KIND_A = 1, KIND_B = 0x2;
    weft.header_t header; /* known
    already */
    int8_t  rows, columns;
    float   depth_m[rows][columns];
    boolean sharp;
    edge_t  edges[2];
})");
  test::write_bytes(folder / "edge_t.lcm",
                    "package lab; struct edge_t { int16_t from; byte kind; }");
  auto types = MessageTypes::built_in();
  types.add_folder(folder.string());
  Bytes bytes;
  // What lcm-gen 1.3.1 computes for these files.
  for (int i = 7; i >= 0; --i)
    bytes.push_back(static_cast<std::uint8_t>(0xb6cb40aafada7761u >> (8 * i)));
  weft::header_t header = stage::fake::header(5);
  Bytes nested(static_cast<std::size_t>(header._getEncodedSizeNoHash()));
  header._encodeNoHash(nested.data(), 0, static_cast<int>(nested.size()));
  bytes.insert(bytes.end(), nested.begin(), nested.end());
  const Bytes rest = {1, 2, 0x3f, 0x80, 0, 0, 0xbf, 0, 0, 0, 1, 0, 7, 9, 0xff, 0xff, 3};
  bytes.insert(bytes.end(), rest.begin(), rest.end());
  const auto decoded = types.decode(bytes);
  ASSERT_TRUE(decoded);
  EXPECT_EQ(decoded->type, "wrinkle_t");
  EXPECT_EQ(text(*decoded, "depth_m[0][1]"), "-0.5");
  EXPECT_EQ(text(*decoded, "edges[1].from"), "-1");
  EXPECT_EQ(text(*decoded, "edges[0].kind"), "9");
  EXPECT_EQ(MessageTypes::built_in().check(bytes), Verdict::kUnknown);
}

TEST(MessageTypes, SaysWhatIsWrongWithALcmFile) {
  const auto error = [](const std::string& text) {
    MessageTypes types = MessageTypes::built_in();
    return test::error_of([&] { types.add({{"x.lcm", text}}); });
  };
  EXPECT_EQ(error("package a; struct t { int8_t x; }"), "");
  EXPECT_NE(error("package a;\nstruct t { int8_t x }").find("x.lcm:2: expected ';', not '}'"),
            std::string::npos);
  EXPECT_NE(error("struct t { other_t x; }").find("other_t"), std::string::npos);
  EXPECT_NE(error("struct t { t x; }").find("contains itself"), std::string::npos);
  EXPECT_NE(error("struct t { int8_t x[n]; }").find("whole-number member above"),
            std::string::npos);
  EXPECT_NE(error("struct t { int8_t x").find("expected ';'"), std::string::npos);
  EXPECT_NE(error("enum t { A, B }").find("expected 'package' or 'struct'"), std::string::npos);
  EXPECT_NE(error("struct t { int8_t code; int16_t reason; string text; }").find("status_t"),
            std::string::npos);
}

}  // namespace
}  // namespace weft
