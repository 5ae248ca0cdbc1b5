#include "base/blob.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <limits>

#include "base/error.hpp"
#include "base/random.hpp"

namespace weft {
namespace {

BlobWriter sample() {
  BlobWriter writer("sample", 3);
  const std::vector<std::uint8_t> bytes = {0, 1, 255};
  const std::vector<std::int16_t> shorts = {-32768, 7};
  const std::vector<std::int32_t> ints = {-2147483647 - 1, 2147483647};
  const std::vector<float> floats = {0.1f, -1e30f};
  const std::vector<double> doubles = {0.1, 1e300};
  writer.add("bytes", bytes);
  writer.add("shorts", shorts);
  writer.add("ints", ints);
  writer.add("floats", floats);
  writer.add("doubles", doubles);
  writer.add("text", "collar\nand sleeves");
  writer.add_number("count", std::int64_t{-5});
  writer.add_number("scale", 2.5);
  return writer;
}

std::string error_of(const std::function<void()>& body) {
  try {
    body();
  } catch (const Error& e) {
    return e.what();
  }
  return "no error";
}

TEST(Blob, ReturnsEveryTypeUnchanged) {
  const auto bytes = sample().bytes();
  const auto reader = BlobReader::from_bytes(bytes, "memory", "sample", 3);
  EXPECT_EQ(reader.version(), 3u);
  EXPECT_EQ(reader.values<std::uint8_t>("bytes"), (std::vector<std::uint8_t>{0, 1, 255}));
  EXPECT_EQ(reader.values<std::int16_t>("shorts"), (std::vector<std::int16_t>{-32768, 7}));
  EXPECT_EQ(reader.values<std::int32_t>("ints", 2),
            (std::vector<std::int32_t>{-2147483647 - 1, 2147483647}));
  EXPECT_EQ(reader.values<float>("floats"), (std::vector<float>{0.1f, -1e30f}));
  EXPECT_EQ(reader.values<double>("doubles"), (std::vector<double>{0.1, 1e300}));
  EXPECT_EQ(reader.text("text"), "collar\nand sleeves");
  EXPECT_EQ(reader.integer("count", -10, 10), -5);
  EXPECT_EQ(reader.number("scale"), 2.5);
}

TEST(Blob, BytesDoNotDependOnTheOrderOfAdding) {
  BlobWriter a("k", 1), b("k", 1);
  a.add("x", "1");
  a.add_number("y", 2.0);
  b.add_number("y", 2.0);
  b.add("x", "1");
  EXPECT_EQ(a.bytes(), b.bytes());
  EXPECT_THROW(a.add("x", "again"), Error);
}

TEST(Blob, FileRoundTripAndMissingFile) {
  const auto path = std::filesystem::temp_directory_path() /
                    ("weft_blob_test_" + std::to_string(getpid()) + ".weft");
  sample().write(path);
  const auto reader = BlobReader::from_file(path, "sample", 3);
  EXPECT_EQ(reader.text("text"), "collar\nand sleeves");
  EXPECT_FALSE(std::filesystem::exists(path.string() + ".tmp"));
  std::filesystem::remove(path);
  const auto text = error_of([&] { BlobReader::from_file(path, "sample", 3); });
  EXPECT_NE(text.find(path.string()), std::string::npos) << text;
}

TEST(Blob, ErrorsSayFileAndReason) {
  const auto bytes = sample().bytes();
  const auto open = [&](const std::string& kind, std::uint32_t version) {
    return BlobReader::from_bytes(bytes, "the/file", kind, version);
  };
  EXPECT_EQ(error_of([&] { open("other", 3); }), "the/file: holds a 'sample', expected a 'other'");
  EXPECT_NE(error_of([&] { open("sample", 2); }).find("version 3"), std::string::npos);
  const auto reader = open("sample", 3);
  EXPECT_EQ(error_of([&] { reader.text("none"); }), "the/file: section 'none' is missing");
  EXPECT_EQ(error_of([&] { reader.values<float>("ints"); }),
            "the/file: section 'ints' is i32, expected f32");
  EXPECT_EQ(error_of([&] { reader.values<float>("floats", 3); }),
            "the/file: section 'floats' holds 2 values, expected 3");
  EXPECT_EQ(error_of([&] { reader.integer("count", 0, 9); }),
            "the/file: section 'count' is -5, expected 0 to 9");
}

TEST(Blob, RefusesNonFiniteValues) {
  BlobWriter writer("k", 1);
  writer.add_number("bad", std::numeric_limits<double>::quiet_NaN());
  const auto bytes = writer.bytes();
  const auto reader = BlobReader::from_bytes(bytes, "f", "k", 1);
  EXPECT_THROW(reader.number("bad"), Error);
}

// Cut anywhere or with any byte changed, a file is refused and never read out of bounds.
TEST(Blob, RefusesDamagedFiles) {
  const auto bytes = sample().bytes();
  for (std::size_t size = 0; size < bytes.size(); ++size) {
    EXPECT_THROW(BlobReader::from_bytes(std::span(bytes).first(size), "f", "sample", 3), Error);
  }
  Random random(7);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    auto damaged = bytes;
    damaged[i] ^= static_cast<std::uint8_t>(1 + random.below(255));
    EXPECT_THROW(BlobReader::from_bytes(damaged, "f", "sample", 3), Error);
  }
}

// With a checksum that fits, impossible lengths are still caught.
TEST(Blob, RefusesImpossibleLengthsBehindAGoodChecksum) {
  const auto original = sample().bytes();
  for (std::size_t i = 8; i + 8 < original.size(); ++i) {
    auto damaged = original;
    damaged[i] = 0xff;
    std::uint64_t hash = 0xcbf29ce484222325u;
    for (std::size_t k = 0; k + 8 < damaged.size(); ++k)
      hash = (hash ^ damaged[k]) * 0x100000001b3u;
    for (std::size_t k = 0; k < 8; ++k)
      damaged[damaged.size() - 8 + k] = static_cast<std::uint8_t>(hash >> (8 * k));
    try {
      const auto reader = BlobReader::from_bytes(damaged, "f", "sample", 0xffffffffu);
      (void)reader.has("text");
    } catch (const Error&) {
    }
  }
}

}  // namespace
}  // namespace weft
