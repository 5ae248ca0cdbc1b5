#include "base/blob.hpp"

#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <type_traits>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/text_file.hpp"

namespace weft {
namespace {

constexpr char kMagic[8] = {'W', 'E', 'F', 'T', 'B', 'L', 'O', 'B'};
constexpr std::uint32_t kFormat = 1;
constexpr std::uint64_t kMaxFileSize = 256u << 20;
constexpr std::uint8_t kText = 0;

template <class T>
constexpr std::uint8_t type_code() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return 1;
  if constexpr (std::is_same_v<T, std::int16_t>) return 2;
  if constexpr (std::is_same_v<T, std::int32_t>) return 3;
  if constexpr (std::is_same_v<T, std::int64_t>) return 4;
  if constexpr (std::is_same_v<T, float>) return 5;
  if constexpr (std::is_same_v<T, double>) return 6;
}

constexpr std::uint64_t kElementSize[] = {1, 1, 2, 4, 8, 4, 8};
constexpr const char* kTypeName[] = {"text", "u8", "i16", "i32", "i64", "f32", "f64"};

void put(std::vector<std::uint8_t>& out, std::uint64_t value, int size) {
  for (int i = 0; i < size; ++i) out.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

void put_text(std::vector<std::uint8_t>& out, const std::string& text) {
  put(out, text.size(), 4);
  out.insert(out.end(), text.begin(), text.end());
}

std::uint64_t load(const std::uint8_t* data, int size) {
  std::uint64_t value = 0;
  for (int i = 0; i < size; ++i) value |= static_cast<std::uint64_t>(data[i]) << (8 * i);
  return value;
}

template <class T>
std::uint64_t to_bits(T value) {
  std::conditional_t<
      sizeof(T) == 8, std::uint64_t,
      std::conditional_t<sizeof(T) == 4, std::uint32_t,
                         std::conditional_t<sizeof(T) == 2, std::uint16_t, std::uint8_t>>>
      bits;
  std::memcpy(&bits, &value, sizeof value);
  return bits;
}

template <class T>
T from_bits(std::uint64_t bits) {
  T value;
  if constexpr (sizeof(T) == 8) {
    std::memcpy(&value, &bits, 8);
  } else {
    const auto narrow = static_cast<std::uint32_t>(bits);
    if constexpr (sizeof(T) == 4) {
      std::memcpy(&value, &narrow, 4);
    } else {
      value = static_cast<T>(narrow);
    }
  }
  return value;
}

// Bounded reading: every length is checked against what is left.
class Cursor {
 public:
  Cursor(std::span<const std::uint8_t> bytes, const std::string& name)
      : bytes_(bytes), name_(name) {}
  std::uint64_t number(int size) {
    return load(take(static_cast<std::uint64_t>(size)).data(), size);
  }
  std::string text() {
    const auto part = take(number(4));
    return {part.begin(), part.end()};
  }
  std::span<const std::uint8_t> take(std::uint64_t size) {
    if (size > bytes_.size()) throw Error(name_ + ": the model file ends too early; copy it again");
    const auto part = bytes_.first(static_cast<std::size_t>(size));
    bytes_ = bytes_.subspan(static_cast<std::size_t>(size));
    return part;
  }
  bool empty() const { return bytes_.empty(); }

 private:
  std::span<const std::uint8_t> bytes_;
  const std::string& name_;
};

}  // namespace

template <class T>
void BlobWriter::add_values(const std::string& name, std::span<const T> values) {
  Section section{type_code<T>(), values.size(), {}};
  section.data.reserve(values.size() * sizeof(T));
  for (const T value : values) put(section.data, to_bits(value), sizeof(T));
  if (!sections_.emplace(name, std::move(section)).second)
    throw Error("section '" + name + "' added twice to a " + kind_ + " file");
}

void BlobWriter::add(const std::string& name, const std::string& text) {
  if (!sections_.emplace(name, Section{kText, text.size(), {text.begin(), text.end()}}).second)
    throw Error("section '" + name + "' added twice to a " + kind_ + " file");
}
void BlobWriter::add(const std::string& name, std::span<const std::uint8_t> values) {
  add_values(name, values);
}
void BlobWriter::add(const std::string& name, std::span<const std::int16_t> values) {
  add_values(name, values);
}
void BlobWriter::add(const std::string& name, std::span<const std::int32_t> values) {
  add_values(name, values);
}
void BlobWriter::add(const std::string& name, std::span<const std::int64_t> values) {
  add_values(name, values);
}
void BlobWriter::add(const std::string& name, std::span<const float> values) {
  add_values(name, values);
}
void BlobWriter::add(const std::string& name, std::span<const double> values) {
  add_values(name, values);
}

std::vector<std::uint8_t> BlobWriter::bytes() const {
  std::vector<std::uint8_t> out(kMagic, kMagic + sizeof kMagic);
  put(out, kFormat, 4);
  put(out, version_, 4);
  put_text(out, kind_);
  put(out, sections_.size(), 4);
  for (const auto& [name, section] : sections_) {
    put_text(out, name);
    put(out, section.type, 1);
    put(out, section.count, 8);
    out.insert(out.end(), section.data.begin(), section.data.end());
  }
  Hash64 hash;
  hash.add(out.data(), out.size());
  put(out, hash.value(), 8);
  return out;
}

void BlobWriter::write(const std::string& path) const {
  const auto data = bytes();
  if (data.size() > kMaxFileSize) {
    throw Error(path + ": the model needs " + std::to_string(data.size()) +
                " bytes, more than the 256 MiB a reader accepts");
  }
  write_text_file(path, {data.begin(), data.end()});
}

BlobReader BlobReader::from_file(const std::string& path, const std::string& kind,
                                 std::uint32_t newest_version) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) throw Error(path + ": cannot open the " + kind + " file; train it or fix the path");
  const auto size = static_cast<std::int64_t>(file.tellg());
  if (size < 0 || static_cast<std::uint64_t>(size) > kMaxFileSize)
    throw Error(path + ": not a regular file of at most 256 MiB");
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(size));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(bytes.data()), size);
  if (!file) throw Error(path + ": cannot read the file");
  return from_bytes(bytes, path, kind, newest_version);
}

BlobReader BlobReader::from_bytes(std::span<const std::uint8_t> bytes, const std::string& name,
                                  const std::string& kind, std::uint32_t newest_version) {
  BlobReader reader;
  reader.name_ = name;
  if (bytes.size() < sizeof kMagic + 8 || std::memcmp(bytes.data(), kMagic, sizeof kMagic) != 0)
    reader.fail("not a Weft model file");
  const auto body = bytes.first(bytes.size() - 8);
  Hash64 hash;
  hash.add(body.data(), body.size());
  if (load(bytes.data() + body.size(), 8) != hash.value())
    reader.fail("the checksum does not fit the content; the file is damaged, copy it again");
  Cursor cursor(body.subspan(sizeof kMagic), reader.name_);
  const auto format = cursor.number(4);
  if (format != kFormat)
    reader.fail("container format " + std::to_string(format) + "; this build reads format 1");
  reader.version_ = static_cast<std::uint32_t>(cursor.number(4));
  const std::string found = cursor.text();
  if (found != kind) reader.fail("holds a '" + found + "', expected a '" + kind + "'");
  if (reader.version_ > newest_version) {
    reader.fail(kind + " version " + std::to_string(reader.version_) + "; this build reads up to " +
                std::to_string(newest_version) + ", update Weft or train again");
  }
  const auto count = cursor.number(4);
  for (std::uint64_t i = 0; i < count; ++i) {
    const std::string section = cursor.text();
    const auto type = static_cast<std::uint8_t>(cursor.number(1));
    const auto elements = cursor.number(8);
    if (type >= std::size(kElementSize))
      reader.fail("section '" + section + "' has an unknown type");
    if (elements > kMaxFileSize) reader.fail("section '" + section + "' has an impossible size");
    const auto data = cursor.take(elements * kElementSize[type]);
    if (!reader.sections_.emplace(section, Section{type, elements, {data.begin(), data.end()}})
             .second)
      reader.fail("section '" + section + "' stands there twice");
  }
  if (!cursor.empty()) reader.fail("bytes after the last section");
  Hash64 whole;
  whole.add(bytes.data(), bytes.size());
  reader.hash_ = whole.value();
  return reader;
}

void BlobReader::fail(const std::string& reason) const { throw Error(name_ + ": " + reason); }

const BlobReader::Section& BlobReader::find(const std::string& section, std::uint8_t type) const {
  const auto found = sections_.find(section);
  if (found == sections_.end()) fail("section '" + section + "' is missing");
  if (found->second.type != type) {
    fail("section '" + section + "' is " + kTypeName[found->second.type] + ", expected " +
         kTypeName[type]);
  }
  return found->second;
}

std::string BlobReader::text(const std::string& section) const {
  const auto& data = find(section, kText).data;
  return {data.begin(), data.end()};
}

template <class T>
std::vector<T> BlobReader::values(const std::string& section) const {
  const auto& found = find(section, type_code<T>());
  std::vector<T> out(static_cast<std::size_t>(found.count));
  for (std::size_t i = 0; i < out.size(); ++i) {
    out[i] = from_bits<T>(load(found.data.data() + i * sizeof(T), sizeof(T)));
    if constexpr (std::is_floating_point_v<T>) {
      if (!std::isfinite(out[i]))
        fail("section '" + section + "' holds a value that is not finite");
    }
  }
  return out;
}

template <class T>
std::vector<T> BlobReader::values(const std::string& section, std::size_t count) const {
  auto out = values<T>(section);
  if (out.size() != count) {
    fail("section '" + section + "' holds " + std::to_string(out.size()) + " values, expected " +
         std::to_string(count));
  }
  return out;
}

#define WEFT_INSTANTIATE(T)                                                                    \
  template std::vector<T> BlobReader::values<T>(const std::string& section) const;             \
  template std::vector<T> BlobReader::values<T>(const std::string& section, std::size_t count) \
      const;
WEFT_INSTANTIATE(std::uint8_t)
WEFT_INSTANTIATE(std::int16_t)
WEFT_INSTANTIATE(std::int32_t)
WEFT_INSTANTIATE(std::int64_t)
WEFT_INSTANTIATE(float)
WEFT_INSTANTIATE(double)
#undef WEFT_INSTANTIATE

std::int64_t BlobReader::integer(const std::string& section, std::int64_t low,
                                 std::int64_t high) const {
  const auto value = values<std::int64_t>(section, 1)[0];
  if (value < low || value > high) {
    fail("section '" + section + "' is " + std::to_string(value) + ", expected " +
         std::to_string(low) + " to " + std::to_string(high));
  }
  return value;
}

double BlobReader::number(const std::string& section) const {
  return values<double>(section, 1)[0];
}

}  // namespace weft
