#include "rgbd/pcd_io.hpp"

#include <pcl/io/lzf.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <string_view>

#include "base/error.hpp"

namespace weft::rgbd {
namespace {

constexpr std::uint64_t kMaxPoints = 1u << 26;
constexpr int kMaxSide = 8192;
constexpr int kMaxFields = 64;
constexpr std::uint64_t kMaxPointBytes = 1024;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

std::string read_file(const std::string& path) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  std::ifstream in(path, std::ios::binary);
  if (error || !in) throw Error(path + ": cannot be opened as a file");
  std::string bytes(size, '\0');
  if (!in.read(bytes.data(), static_cast<std::streamsize>(size)))
    throw Error(path + ": cannot be read");
  return bytes;
}

struct Field {
  std::string name;
  std::uint64_t size = 4;
  char type = 'F';
  std::uint64_t count = 1;
  std::uint64_t offset = 0;  // bytes, within a point
  std::uint64_t first = 0;   // index of its first number within a point
};

struct Header {
  std::vector<Field> fields;
  std::uint64_t width = 0, height = 0, points = 0;
  std::uint64_t point_bytes = 0, point_numbers = 0;
  std::string data;
  std::size_t body = 0;  // offset of the first byte after the DATA line

  const Field* find(std::string_view name) const {
    for (const Field& field : fields)
      if (field.name == name) return &field;
    return nullptr;
  }
};

class HeaderReader {
 public:
  HeaderReader(const std::string& path, const std::string& bytes) : path_(path), bytes_(bytes) {}

  Header read() {
    while (header_.data.empty()) read_line();
    check();
    return header_;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw Error(path_ + ": line " + std::to_string(line_) + ": " + what);
  }

  std::uint64_t number(const std::string& word, const char* what) const {
    std::uint64_t value = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || end != word.data() + word.size() || value > kMaxPoints)
      fail(std::string(what) + " \"" + word + "\" is not a number up to " +
           std::to_string(kMaxPoints));
    return value;
  }

  void read_line() {
    constexpr std::size_t kMaxLine = 4096;
    ++line_;
    const std::size_t end = bytes_.find('\n', header_.body);
    if (end == std::string::npos || end - header_.body > kMaxLine || line_ > 100)
      fail("no end of the PCD header (a line DATA ...) found; is this a PCD file?");
    std::string line = bytes_.substr(header_.body, end - header_.body);
    header_.body = end + 1;
    if (!line.empty() && line.back() == '\r') line.pop_back();
    std::istringstream stream(line);
    std::vector<std::string> words;
    for (std::string word; stream >> word;) words.push_back(word);
    if (words.empty() || words[0][0] == '#') return;
    const std::string key = words[0];
    words.erase(words.begin());
    if (key == "VERSION") {
      if (words.size() != 1 || (words[0] != "0.7" && words[0] != ".7"))
        fail("VERSION 0.7 expected");
    } else if (key == "FIELDS") {
      if (words.empty() || words.size() > kMaxFields) fail("1 to 64 names of FIELDS expected");
      if (!header_.fields.empty()) fail("a second FIELDS");
      for (const std::string& word : words) header_.fields.push_back({word});
    } else if (key == "SIZE" || key == "TYPE" || key == "COUNT") {
      if (words.size() != header_.fields.size() || words.empty())
        fail(key + " has " + std::to_string(words.size()) + " values for " +
             std::to_string(header_.fields.size()) + " FIELDS");
      for (std::size_t i = 0; i < words.size(); ++i) {
        Field& field = header_.fields[i];
        if (key == "SIZE") field.size = number(words[i], "SIZE");
        if (key == "COUNT") field.count = number(words[i], "COUNT");
        if (key == "TYPE") field.type = words[i].size() == 1 ? words[i][0] : '?';
      }
    } else if (key == "WIDTH" || key == "HEIGHT" || key == "POINTS") {
      if (words.size() != 1) fail("one number expected after " + key);
      (key == "WIDTH"    ? header_.width
       : key == "HEIGHT" ? header_.height
                         : header_.points) = number(words[0], key.c_str());
    } else if (key == "VIEWPOINT") {
      // Where the scanner stood in some world. The points are in its own frame all the same.
      if (words.size() != 7) fail("seven numbers expected after VIEWPOINT");
    } else if (key == "DATA") {
      if (words.size() != 1 ||
          (words[0] != "ascii" && words[0] != "binary" && words[0] != "binary_compressed"))
        fail("DATA ascii, binary or binary_compressed expected");
      header_.data = words[0];
    } else {
      fail("\"" + key.substr(0, 40) + "\" is not a keyword of a PCD header");
    }
  }

  void check() {
    if (header_.fields.empty()) fail("the header names no FIELDS");
    for (Field& field : header_.fields) {
      const bool good =
          (field.type == 'F' && (field.size == 4 || field.size == 8)) ||
          ((field.type == 'I' || field.type == 'U') &&
           (field.size == 1 || field.size == 2 || field.size == 4 || field.size == 8));
      if (!good || field.count < 1 || field.count > kMaxPointBytes)
        fail("field " + field.name + " has no valid SIZE, TYPE and COUNT");
      field.offset = header_.point_bytes;
      field.first = header_.point_numbers;
      header_.point_bytes += field.size * field.count;
      header_.point_numbers += field.count;
      if (header_.point_bytes > kMaxPointBytes) fail("a point has more than 1024 bytes");
    }
    if (header_.width < 1 || header_.height < 1) fail("WIDTH and HEIGHT must be at least 1");
    if (header_.height > 1 && (header_.width > kMaxSide || header_.height > kMaxSide))
      fail("an organised cloud of " + std::to_string(header_.width) + "x" +
           std::to_string(header_.height) + " is larger than 8192x8192");
    if (header_.points != header_.width * header_.height)
      fail("POINTS " + std::to_string(header_.points) +
           " is not WIDTH x HEIGHT = " + std::to_string(header_.width * header_.height));
    for (const char* name : {"x", "y", "z"}) {
      const Field* field = header_.find(name);
      if (!field || field->type != 'F' || field->size != 4 || field->count != 1)
        fail(std::string("a field ") + name + " of TYPE F, SIZE 4, COUNT 1 is needed");
    }
    for (const char* name : {"rgb", "rgba"}) {
      const Field* field = header_.find(name);
      if (field && (field->size != 4 || field->count != 1 || field->type == 'I'))
        fail(std::string("the field ") + name + " must have TYPE F or U, SIZE 4, COUNT 1");
    }
  }

  const std::string& path_;
  const std::string& bytes_;
  Header header_;
  int line_ = 0;
};

/// Puts numbers of one point, given as its 4-byte words, into the cloud.
class Filler {
 public:
  Filler(const std::string& path, const Header& header) : path_(path) {
    const Field* colour = header.find("rgb") ? header.find("rgb") : header.find("rgba");
    fields_ = {header.find("x"), header.find("y"), header.find("z"), colour};
    cloud_.width = static_cast<int>(header.width);
    cloud_.height = static_cast<int>(header.height);
    cloud_.points.resize(header.points);
    if (colour) cloud_.colour.create(cloud_.height, cloud_.width, CV_8UC3);
  }
  const std::array<const Field*, 4>& fields() const { return fields_; }

  void set(std::size_t index, const std::array<std::uint32_t, 4>& words) {
    std::array<float, 3> xyz;
    std::memcpy(xyz.data(), words.data(), sizeof xyz);
    bool missing = false;
    for (const float value : xyz) {
      missing |= std::isnan(value);
      if (std::isinf(value))
        throw Error(path_ + ": point " + std::to_string(index) + " has an infinite coordinate");
    }
    cloud_.points[index] =
        missing ? Eigen::Vector3f::Constant(kNan) : Eigen::Vector3f(xyz[0], xyz[1], xyz[2]);
    if (fields_[3]) {
      cloud_.colour.ptr<cv::Vec3b>()[index] = {static_cast<std::uint8_t>(words[3]),
                                               static_cast<std::uint8_t>(words[3] >> 8),
                                               static_cast<std::uint8_t>(words[3] >> 16)};
    }
  }
  Cloud take() { return std::move(cloud_); }

 private:
  const std::string& path_;
  Cloud cloud_;
  std::array<const Field*, 4> fields_;
};

std::string points_of(const Header& header) {
  return std::to_string(header.points) + " points of " + std::to_string(header.point_bytes) +
         " bytes";
}

Cloud read_ascii(const std::string& path, const std::string& bytes, const Header& header) {
  // Each number takes two bytes at least: a header cannot claim more points than the file holds.
  if ((bytes.size() - header.body) / 2 + 1 < header.points * header.point_numbers)
    throw Error(path + ": too short for its " + points_of(header));
  Filler filler(path, header);
  const char* at = bytes.data() + header.body;
  const char* const end = bytes.data() + bytes.size();
  const auto skip_blank = [&] {
    while (at != end && (*at == ' ' || *at == '\t' || *at == '\r' || *at == '\n')) ++at;
  };
  std::array<std::uint32_t, 4> words{};
  for (std::uint64_t i = 0; i < header.points; ++i) {
    const auto fail = [&](const std::string& what) {
      throw Error(path + ": point " + std::to_string(i) + " of " + std::to_string(header.points) +
                  ": " + what);
    };
    for (std::uint64_t n = 0; n < header.point_numbers; ++n) {
      skip_blank();
      const char* const start = at;
      while (at != end && static_cast<unsigned char>(*at) > ' ') ++at;
      if (start == at) fail("the file ends here");
      for (std::size_t k = 0; k < words.size(); ++k) {
        const Field* field = filler.fields()[k];
        if (!field || field->first != n) continue;
        std::from_chars_result result{};
        if (field->type == 'F') {
          float value = 0.0f;
          result = std::from_chars(start, at, value);
          std::memcpy(&words[k], &value, sizeof value);
        } else {
          result = std::from_chars(start, at, words[k]);
        }
        if (result.ec != std::errc() || result.ptr != at)
          fail("\"" + std::string(start, std::min<std::ptrdiff_t>(at - start, 40)) +
               "\" is not a value of field " + field->name);
      }
    }
    filler.set(i, words);
  }
  skip_blank();
  if (at != end) throw Error(path + ": more data than its " + points_of(header));
  return filler.take();
}

/// body: the points' bytes; by_field: all of one field, then all of the next (as compressed).
Cloud from_bytes(const std::string& path, const Header& header, const char* body, bool by_field) {
  Filler filler(path, header);
  std::array<std::uint32_t, 4> words{};
  for (std::uint64_t i = 0; i < header.points; ++i) {
    for (std::size_t k = 0; k < words.size(); ++k) {
      const Field* field = filler.fields()[k];
      if (!field) continue;
      const std::uint64_t at = by_field ? field->offset * header.points + i * field->size
                                        : i * header.point_bytes + field->offset;
      std::memcpy(&words[k], body + at, sizeof words[k]);
    }
    filler.set(i, words);
  }
  return filler.take();
}

Cloud read_compressed(const std::string& path, const std::string& bytes, const Header& header) {
  std::uint32_t sizes[2];
  if (bytes.size() - header.body < sizeof sizes)
    throw Error(path + ": ends before the sizes of its compressed data");
  std::memcpy(sizes, bytes.data() + header.body, sizeof sizes);
  const std::size_t have = bytes.size() - header.body - sizeof sizes;
  if (sizes[0] > have || sizes[0] == 0)
    throw Error(path + ": claims " + std::to_string(sizes[0]) +
                " bytes of compressed data and has " + std::to_string(have) + "; truncated?");
  if (sizes[1] != header.points * header.point_bytes)
    throw Error(path + ": claims " + std::to_string(sizes[1]) + " bytes of data for " +
                points_of(header));
  // LZF cannot expand by more than 264 / 3: what claims more is no honest file.
  if (sizes[1] / 88 > sizes[0])
    throw Error(path + ": " + std::to_string(sizes[0]) + " bytes cannot hold " + points_of(header));
  std::string raw(sizes[1], '\0');
  if (pcl::lzfDecompress(bytes.data() + header.body + sizeof sizes, sizes[0], raw.data(),
                         sizes[1]) != sizes[1])
    throw Error(path + ": the compressed data is damaged");
  return from_bytes(path, header, raw.data(), true);
}

std::uint32_t packed_colour(const Cloud& cloud, std::size_t i) {
  const cv::Vec3b bgr = cloud.colour.ptr<cv::Vec3b>()[i];
  return static_cast<std::uint32_t>(bgr[0] | bgr[1] << 8 | bgr[2] << 16);
}

}  // namespace

Cloud read_pcd(const std::string& path) { return parse_pcd(read_file(path), path); }

Cloud parse_pcd(const std::string& bytes, const std::string& path) {
  const Header header = HeaderReader(path, bytes).read();
  if (header.data == "ascii") return read_ascii(path, bytes, header);
  if (header.data == "binary_compressed") return read_compressed(path, bytes, header);
  const std::uint64_t have = bytes.size() - header.body;
  if (have < header.points * header.point_bytes)
    throw Error(path + ": has " + std::to_string(have) + " bytes of data for " + points_of(header) +
                "; truncated?");
  return from_bytes(path, header, bytes.data() + header.body, false);
}

void write_pcd(const std::string& path, const Cloud& cloud, PcdEncoding encoding) {
  const std::size_t count = cloud.points.size();
  const bool coloured = !cloud.colour.empty();
  if (cloud.width < 1 || cloud.height < 1 || count > kMaxPoints ||
      count != static_cast<std::size_t>(cloud.width) * cloud.height ||
      (coloured && (cloud.colour.type() != CV_8UC3 || !cloud.colour.isContinuous() ||
                    cloud.colour.rows != cloud.height || cloud.colour.cols != cloud.width)))
    throw Error(path + ": the cloud's size, points and colour do not agree");
  const char* names[] = {"ascii", "binary", "binary_compressed"};
  std::ostringstream header;
  header << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
         << (!coloured ? "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
             : encoding == PcdEncoding::kAscii
                 ? "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
                 : "FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\n")
         << "WIDTH " << cloud.width << "\nHEIGHT " << cloud.height
         << "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << count << "\nDATA "
         << names[static_cast<int>(encoding)] << "\n";
  std::string bytes = header.str();
  const std::size_t words = coloured ? 4 : 3;
  if (encoding == PcdEncoding::kAscii) {
    char buffer[64];
    const auto put = [&](float value, char separator) {
      const auto end = std::isfinite(value)
                           ? std::to_chars(buffer, buffer + sizeof buffer, value).ptr
                           : std::strcpy(buffer, "nan") + 3;
      bytes.append(buffer, end);
      bytes.push_back(separator);
    };
    for (std::size_t i = 0; i < count; ++i) {
      const Eigen::Vector3f& p = cloud.points[i];
      put(p.x(), ' ');
      put(p.y(), ' ');
      put(p.z(), coloured ? ' ' : '\n');
      if (coloured) bytes += std::to_string(packed_colour(cloud, i)) + "\n";
    }
  } else {
    std::vector<std::uint32_t> raw(count * words);
    const bool by_field = encoding == PcdEncoding::kBinaryCompressed;
    for (std::size_t i = 0; i < count; ++i) {
      for (std::size_t k = 0; k < words; ++k) {
        std::uint32_t word;
        if (k == 3)
          word = packed_colour(cloud, i);
        else
          std::memcpy(&word, &cloud.points[i][static_cast<Eigen::Index>(k)], sizeof word);
        raw[by_field ? k * count + i : i * words + k] = word;
      }
    }
    const auto raw_bytes = static_cast<std::uint32_t>(raw.size() * sizeof raw[0]);
    if (by_field) {
      // Data that does not compress grows by a byte in 32.
      std::string packed(raw_bytes + raw_bytes / 16 + 64, '\0');
      const std::uint32_t size = pcl::lzfCompress(raw.data(), raw_bytes, packed.data(),
                                                  static_cast<unsigned>(packed.size()));
      if (size == 0) throw Error(path + ": the points cannot be compressed");
      const std::uint32_t sizes[2] = {size, raw_bytes};
      bytes.append(reinterpret_cast<const char*>(sizes), sizeof sizes);
      bytes.append(packed.data(), size);
    } else {
      bytes.append(reinterpret_cast<const char*>(raw.data()), raw_bytes);
    }
  }
  std::ofstream out(path, std::ios::binary);
  if (!out.write(bytes.data(), static_cast<std::streamsize>(bytes.size())) || !out.flush())
    throw Error(path + ": cannot be written");
}

}  // namespace weft::rgbd
