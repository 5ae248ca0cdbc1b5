#include "rgbd/pcd_io.hpp"

#include <gtest/gtest.h>
#include <pcl/io/pcd_io.h>
#include <pcl/point_types.h>

#include <cmath>
#include <cstring>
#include <limits>

#include "base/random.hpp"
#include "support/files.hpp"

namespace weft::rgbd {
namespace {

using test::error_of;
using test::read_bytes;
using test::TemporaryFolder;

Cloud random_cloud(int width, int height, bool coloured, std::uint64_t seed) {
  Random random(seed);
  Cloud cloud;
  cloud.width = width;
  cloud.height = height;
  for (int i = 0; i < width * height; ++i) {
    const float z = static_cast<float>(random.uniform(0.5, 3.0));
    cloud.points.push_back(random.below(5) == 0
                               ? Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN())
                               : Eigen::Vector3f(static_cast<float>(random.uniform(-1, 1)),
                                                 static_cast<float>(random.uniform(-1, 1)), z));
  }
  if (coloured) {
    cloud.colour.create(height, width, CV_8UC3);
    for (int i = 0; i < width * height; ++i)
      for (int c = 0; c < 3; ++c)
        cloud.colour.ptr<cv::Vec3b>()[i][c] = static_cast<std::uint8_t>(random.below(256));
  }
  return cloud;
}

void expect_equal(const Cloud& a, const Cloud& b) {
  ASSERT_EQ(a.width, b.width);
  ASSERT_EQ(a.height, b.height);
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    if (std::isnan(a.points[i].z())) {
      ASSERT_TRUE(b.points[i].array().isNaN().all()) << i;
    } else {
      ASSERT_EQ(a.points[i], b.points[i]) << i;
    }
  }
  ASSERT_EQ(a.colour.empty(), b.colour.empty());
  if (!a.colour.empty()) {
    ASSERT_EQ(0, std::memcmp(a.colour.data, b.colour.data, a.points.size() * 3));
  }
}

Cloud read_with_pcl(const std::string& path) {
  pcl::PointCloud<pcl::PointXYZRGB> in;
  EXPECT_EQ(0, pcl::io::loadPCDFile(path, in));
  Cloud cloud;
  cloud.width = static_cast<int>(in.width);
  cloud.height = static_cast<int>(in.height);
  cloud.colour.create(cloud.height, cloud.width, CV_8UC3);
  for (std::size_t i = 0; i < in.size(); ++i) {
    const auto& p = in.points[i];
    cloud.points.emplace_back(p.x, p.y, p.z);
    cloud.colour.ptr<cv::Vec3b>()[i] = {p.b, p.g, p.r};
  }
  return cloud;
}

class PcdEncodings : public testing::TestWithParam<PcdEncoding> {};

TEST_P(PcdEncodings, RoundTripIsExactWithAndWithoutColour) {
  const TemporaryFolder folder;
  for (const bool coloured : {false, true}) {
    const Cloud cloud = random_cloud(31, 17, coloured, 5);
    write_pcd(folder / "a.pcd", cloud, GetParam());
    expect_equal(cloud, read_pcd(folder / "a.pcd"));
  }
}

TEST_P(PcdEncodings, PclReadsWhatWeWrite) {
  const TemporaryFolder folder;
  const Cloud cloud = random_cloud(31, 17, true, 6);
  write_pcd(folder / "a.pcd", cloud, GetParam());
  expect_equal(cloud, read_with_pcl(folder / "a.pcd"));
}

template <class Point>
void we_read_what_pcl_writes(PcdEncoding encoding) {
  const TemporaryFolder folder;
  const Cloud cloud = random_cloud(31, 17, true, 7);
  pcl::PointCloud<Point> out(31, 17);
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i].getVector3fMap() = cloud.points[i];
    const cv::Vec3b bgr = cloud.colour.ptr<cv::Vec3b>()[i];
    out[i].b = bgr[0];
    out[i].g = bgr[1];
    out[i].r = bgr[2];
  }
  pcl::PCDWriter writer;
  const std::string path = folder / "a.pcd";
  if (encoding == PcdEncoding::kAscii) writer.writeASCII(path, out, 9);
  if (encoding == PcdEncoding::kBinary) writer.writeBinary(path, out);
  if (encoding == PcdEncoding::kBinaryCompressed) writer.writeBinaryCompressed(path, out);
  expect_equal(cloud, read_pcd(path));
}

TEST_P(PcdEncodings, WeReadWhatPclWrites) {
  we_read_what_pcl_writes<pcl::PointXYZRGB>(GetParam());
  we_read_what_pcl_writes<pcl::PointXYZRGBA>(GetParam());
  we_read_what_pcl_writes<pcl::PointXYZRGBNormal>(GetParam());  // fields between and after
}

TEST_P(PcdEncodings, TruncatedFilesAreErrorsThatNameTheFile) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.pcd";
  write_pcd(path, random_cloud(8, 4, true, 8), GetParam());
  const std::string bytes = read_bytes(path);
  for (std::size_t size = 0; size + 12 < bytes.size(); size += 7) {
    EXPECT_EQ(0u, error_of([&] { parse_pcd(bytes.substr(0, size), path); }).find(path))
        << "cut to " << size;
  }
}

TEST_P(PcdEncodings, FlippedBytesNeverDoHarm) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.pcd";
  write_pcd(path, random_cloud(8, 4, true, 9), GetParam());
  const std::string bytes = read_bytes(path);
  Random random(3);
  int errors = 0;
  for (int run = 0; run < 2000; ++run) {
    std::string damaged = bytes;
    for (int flips = 0; flips < 2; ++flips)
      damaged[random.below(damaged.size())] = static_cast<char>(random.below(256));
    const std::string error = error_of([&] {
      const Cloud cloud = parse_pcd(damaged, path);
      ASSERT_EQ(cloud.points.size(), static_cast<std::size_t>(cloud.width) * cloud.height);
    });
    if (!error.empty()) {
      ++errors;
      ASSERT_EQ(0u, error.find(path)) << error;
    }
  }
  EXPECT_GT(errors, 200);
}

INSTANTIATE_TEST_SUITE_P(All, PcdEncodings,
                         testing::Values(PcdEncoding::kAscii, PcdEncoding::kBinary,
                                         PcdEncoding::kBinaryCompressed));

TEST(Pcd, HeadersThatLieAreErrorsWithTheReason) {
  const std::string start = "VERSION .7\nFIELDS x y z\n";
  const std::string types = "SIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n";
  const std::pair<std::string, std::string> cases[] = {
      {"", "no end of the PCD header"},
      {"hello\n", "\"hello\" is not a keyword"},
      {"VERSION .6\n", "VERSION 0.7 expected"},
      {start + types + "WIDTH 99999999999\n", "is not a number up to"},
      {start + types + "WIDTH 8192\nHEIGHT 8192\nPOINTS 67108864\nDATA binary\n", "truncated?"},
      {start + types + "WIDTH 8192\nHEIGHT 8192\nPOINTS 67108864\nDATA ascii\n", "too short"},
      {start + types + "WIDTH 8192\nHEIGHT 8192\nPOINTS 67108864\nDATA binary_compressed\n12345678",
       "claims"},
      {start + types + "WIDTH 9000\nHEIGHT 2\nPOINTS 18000\nDATA binary\n", "larger than 8192"},
      {start + types + "WIDTH 2\nHEIGHT 2\nPOINTS 5\nDATA ascii\n", "is not WIDTH x HEIGHT"},
      {start + types + "WIDTH 0\nHEIGHT 2\nPOINTS 0\nDATA ascii\n", "at least 1"},
      {start + "SIZE 4 4\n", "2 values for 3 FIELDS"},
      {start + "SIZE 4 4 3\nTYPE F F F\nDATA ascii\n", "field z has no valid SIZE"},
      {start + "SIZE 4 4 8\nTYPE F F F\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n",
       "a field z of TYPE F, SIZE 4"},
      {start + types + "COUNT 1 1 9999\nDATA ascii\n", "field z has no valid"},
      {start + types + "VIEWPOINT 0 0 1\n", "seven numbers expected"},
      {start + types + "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 three\n",
       "\"three\" is not a value of field z"},
      {start + types + "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 inf\n", "infinite"},
      {start + types + "WIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 3 4\n", "more data than"},
  };
  const TemporaryFolder folder;
  const std::string path = folder / "lie.pcd";
  for (const auto& [text, reason] : cases) {
    const std::string error = error_of([&] { parse_pcd(text, path); });
    EXPECT_NE(error.find(reason), std::string::npos) << text << " -> " << error;
    EXPECT_EQ(error.find(path), 0u) << error;
  }
  EXPECT_NE(error_of([&] { read_pcd(folder / "none.pcd"); }).find("cannot be opened as a file"),
            std::string::npos);
  EXPECT_NE(error_of([&] { read_pcd(folder.string()); }).find("cannot be opened as a file"),
            std::string::npos);
}

TEST(Pcd, ReadsRealScansLikePcl) {
  const auto scan = test::data_folder() / "pcl-scans/office1.pcd";
  WEFT_NEEDS_DATA(scan);
  const Cloud cloud = read_pcd(scan.string());
  expect_equal(read_with_pcl(scan.string()), cloud);
  const CameraFit fit = fit_camera(cloud, "office1");
  EXPECT_NEAR(fit.camera.fx, 525.0, 1e-3);
  EXPECT_NEAR(fit.camera.fy, 525.0, 1e-3);
  EXPECT_NEAR(fit.camera.cx, 320.0, 1e-3);
  EXPECT_NEAR(fit.camera.cy, 240.0, 1e-3);
  EXPECT_LT(fit.max_error_px, 1e-3);
  EXPECT_NEAR(fit.points / 307200.0, 0.828, 0.001);
}

}  // namespace
}  // namespace weft::rgbd
