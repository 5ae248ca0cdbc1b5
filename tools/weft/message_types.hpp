#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace weft {

/// One value in a message.
struct MessageField {
  std::string path;     // "detections[2].centre_sensor[0]"
  std::string text;     // a number so that it reads back to the same value; bytes: size and hash
  bool number = false;  // text is a number, not nan or inf
};

/// Decodes messages by the .lcm files they were made from, found by the fingerprint a message
/// begins with: what spy shows, verify and compare point at, and the log tools check payloads by.
/// Types of experimental stages need no rebuild, just their .lcm files.
class MessageTypes {
 public:
  /// Those in lcmtypes/ when this program was built.
  static const MessageTypes& built_in();

  /// All .lcm files of a folder, which may use each other's types and those known before. Throws
  /// Error (file:line) on what is not the LCM type language, on an unknown type, and on a type
  /// whose fingerprint another has.
  void add_folder(const std::filesystem::path& folder);
  void add(const std::map<std::string, std::string>& text_by_file);

  struct Decoded {
    std::string type;  // without the package
    std::vector<MessageField> fields;
  };
  enum class Verdict { kUnknown, kDamaged, kWhole };
  /// kUnknown: no type has this fingerprint; kDamaged: one has, but the bytes are not exactly one
  /// such message. Reads no byte beyond the end, whatever the bytes say.
  Verdict check(const std::vector<std::uint8_t>& message) const;
  /// nullopt unless check() says kWhole.
  std::optional<Decoded> decode(const std::vector<std::uint8_t>& message) const;
  /// Name of the message's type; empty when unknown.
  std::string type_of(const std::vector<std::uint8_t>& message) const;
  /// A whole message of a type: arrays of variable size have `count` elements a dimension, at most
  /// 127, texts as many letters, and all other numbers are 1. Throws Error for an unknown type.
  std::vector<std::uint8_t> example(const std::string& type, int count) const;

  struct Type;

 private:
  const Type* find(const std::vector<std::uint8_t>& message) const;
  std::map<std::string, std::shared_ptr<const Type>> by_name_;
  std::map<std::uint64_t, std::shared_ptr<const Type>> by_fingerprint_;
};

struct FieldDifference {
  std::string path;
  std::string a, b;  // "-" where a message has no such field
};
/// Fields that are not the same, in the order of the messages.
std::vector<FieldDifference> field_differences(const std::vector<MessageField>& a,
                                               const std::vector<MessageField>& b);

/// "type; field: a, b" lines for a person, at most `limit` fields. Falls back to the first byte
/// that differs when a message cannot be decoded.
std::string describe_difference(const MessageTypes& types, const std::vector<std::uint8_t>& a,
                                const std::vector<std::uint8_t>& b, std::size_t limit);

namespace internal {
const std::map<std::string, std::string>& lcm_files();
}
}  // namespace weft
