#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <vector>

/// Model files: a little-endian container of named sections, each a text or an array of numbers of
/// one type, with a kind, a version and a checksum. The same sections give the same bytes in
/// whatever order they were added.
///
/// Layout: "WEFTBLOB", u32 format, u32 version, text kind, u32 section count, then per section text
/// name, u8 type, u64 count, the elements; u64 FNV-1a of everything before it. A text is a u32
/// length and its bytes.
namespace weft {

class BlobWriter {
 public:
  /// kind names what the file holds ("vocabulary"); version is that of the kind's own sections.
  BlobWriter(std::string kind, std::uint32_t version) : kind_(std::move(kind)), version_(version) {}

  /// Adding a name twice throws Error.
  void add(const std::string& name, const std::string& text);
  void add(const std::string& name, std::span<const std::uint8_t> values);
  void add(const std::string& name, std::span<const std::int16_t> values);
  void add(const std::string& name, std::span<const std::int32_t> values);
  void add(const std::string& name, std::span<const std::int64_t> values);
  void add(const std::string& name, std::span<const float> values);
  void add(const std::string& name, std::span<const double> values);
  /// A single number, kept as an array of one.
  void add_number(const std::string& name, std::int64_t value) {
    add(name, std::span<const std::int64_t>(&value, 1));
  }
  void add_number(const std::string& name, double value) {
    add(name, std::span<const double>(&value, 1));
  }

  std::vector<std::uint8_t> bytes() const;
  /// Writes beside the file and renames, so that a reader never sees half of it. Throws Error.
  void write(const std::string& path) const;

 private:
  struct Section {
    std::uint8_t type;
    std::uint64_t count;
    std::vector<std::uint8_t> data;
  };
  template <class T>
  void add_values(const std::string& name, std::span<const T> values);
  std::string kind_;
  std::uint32_t version_;
  std::map<std::string, Section> sections_;
};

/// Reads what BlobWriter wrote. Every check that fails throws Error with the file and the reason:
/// truncated or damaged files, another kind or a newer version, missing sections, other types,
/// other sizes than asked for. Files above 256 MiB are refused.
class BlobReader {
 public:
  static BlobReader from_file(const std::string& path, const std::string& kind,
                              std::uint32_t newest_version);
  static BlobReader from_bytes(std::span<const std::uint8_t> bytes, const std::string& name,
                               const std::string& kind, std::uint32_t newest_version);

  std::uint32_t version() const { return version_; }
  /// FNV-1a of the whole file: names the model.
  std::uint64_t hash() const { return hash_; }
  const std::string& name() const { return name_; }

  bool has(const std::string& section) const { return sections_.contains(section); }
  std::string text(const std::string& section) const;
  /// T: std::uint8_t, std::int16_t, std::int32_t, std::int64_t, float or double. Floating-point
  /// values are finite.
  template <class T>
  std::vector<T> values(const std::string& section) const;
  /// The same with the number of values it must hold.
  template <class T>
  std::vector<T> values(const std::string& section, std::size_t count) const;
  std::int64_t integer(const std::string& section, std::int64_t low, std::int64_t high) const;
  double number(const std::string& section) const;

  /// Throws Error naming the file, for checks of the sections' meaning.
  [[noreturn]] void fail(const std::string& reason) const;

 private:
  struct Section {
    std::uint8_t type;
    std::uint64_t count;
    std::vector<std::uint8_t> data;
  };
  const Section& find(const std::string& section, std::uint8_t type) const;
  std::string name_;
  std::uint32_t version_ = 0;
  std::uint64_t hash_ = 0;
  std::map<std::string, Section> sections_;
};

}  // namespace weft
