#include "tools/weft/message_types.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <set>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/text_file.hpp"

namespace weft {
namespace {

/// Bytes of a primitive type on the wire; 0 for strings and types of their own.
int primitive_size(const std::string& type) {
  static const std::map<std::string, int> sizes = {{"int8_t", 1},  {"int16_t", 2}, {"int32_t", 4},
                                                   {"int64_t", 8}, {"byte", 1},    {"boolean", 1},
                                                   {"float", 4},   {"double", 8}};
  const auto at = sizes.find(type);
  return at == sizes.end() ? 0 : at->second;
}

bool is_primitive(const std::string& type) { return type == "string" || primitive_size(type) > 0; }

}  // namespace

struct MessageTypes::Type {
  struct Dimension {
    bool constant = false;
    std::string text;  // as in the file: it goes into the fingerprint
    std::size_t size = 0;
  };
  struct Member {
    std::string type;  // without a package
    std::string name;
    std::vector<Dimension> dimensions;
    std::shared_ptr<const Type> nested;
  };
  std::string name;
  std::string where;  // file:line
  std::vector<Member> members;
};

namespace {

using Type = MessageTypes::Type;

/// The LCM type language: package, struct, const, members with fixed or variable dimensions.
class Parser {
 public:
  Parser(std::string file, const std::string& text) : file_(std::move(file)), text_(text) {
    advance();
  }

  std::vector<Type> parse() {
    std::vector<Type> types;
    while (!token_.empty()) {
      if (token_ == "package") {
        advance();
        name();
        expect(";");
      } else if (token_ == "struct") {
        types.push_back(parse_struct());
      } else {
        fail("expected 'package' or 'struct'");
      }
    }
    return types;
  }

 private:
  [[noreturn]] void fail(const std::string& what) const {
    throw Error(file_ + ":" + std::to_string(line_) + ": " + what + ", not '" + token_ + "'");
  }

  void advance() {
    for (;;) {
      while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) skip();
      if (text_.compare(at_, 2, "//") == 0) {
        while (at_ < text_.size() && text_[at_] != '\n') skip();
      } else if (text_.compare(at_, 2, "/*") == 0) {
        const auto end = text_.find("*/", at_ + 2);
        while (at_ < text_.size() && at_ < (end == std::string::npos ? end : end + 2)) skip();
      } else {
        break;
      }
    }
    token_.clear();
    const auto word = [&](char c) {
      return std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '.' || c == '-' ||
             c == '+';
    };
    if (at_ < text_.size() && !word(text_[at_])) {
      token_ = text_[at_];
      skip();
    } else {
      while (at_ < text_.size() && word(text_[at_])) {
        token_ += text_[at_];
        skip();
      }
    }
  }
  void skip() { line_ += text_[at_++] == '\n'; }

  void expect(const char* what) {
    if (token_ != what) fail(std::string("expected '") + what + "'");
    advance();
  }
  std::string name() {
    if (token_.empty() ||
        !(std::isalpha(static_cast<unsigned char>(token_[0])) || token_[0] == '_'))
      fail("expected a name");
    std::string taken = token_;
    advance();
    return taken;
  }

  Type parse_struct() {
    Type type;
    advance();
    type.where = file_ + ":" + std::to_string(line_);
    type.name = name();
    expect("{");
    while (token_ != "}") {
      if (token_ == "const") {
        while (!token_.empty() && token_ != ";") advance();
        expect(";");
        continue;
      }
      std::string of = name();
      if (const auto dot = of.rfind('.'); dot != std::string::npos) of.erase(0, dot + 1);
      for (;;) {
        Type::Member member{of, name(), {}, nullptr};
        while (token_ == "[") {
          advance();
          member.dimensions.push_back(dimension(type));
          expect("]");
        }
        type.members.push_back(std::move(member));
        if (token_ != ",") break;
        advance();
      }
      expect(";");
    }
    expect("}");
    return type;
  }

  Type::Dimension dimension(const Type& type) {
    Type::Dimension dimension{false, token_, 0};
    if (!token_.empty() && token_.size() < 9 &&
        std::all_of(token_.begin(), token_.end(), [](char c) { return c >= '0' && c <= '9'; })) {
      dimension.constant = true;
      dimension.size = std::stoul(token_);
    } else if (std::none_of(type.members.begin(), type.members.end(), [&](const auto& member) {
                 return member.name == token_ && member.dimensions.empty() &&
                        member.type.starts_with("int");
               })) {
      fail("expected a size, or a whole-number member above");
    }
    advance();
    return dimension;
  }

  std::string file_;
  const std::string& text_;
  std::size_t at_ = 0;
  int line_ = 1;
  std::string token_;
};

std::uint64_t hash_byte(std::uint64_t hash, char c) {
  const auto shifted = static_cast<std::uint64_t>(static_cast<std::int64_t>(hash) >> 55);
  return ((hash << 8) ^ shifted) + static_cast<std::uint64_t>(static_cast<std::int64_t>(c));
}

std::uint64_t hash_text(std::uint64_t hash, const std::string& text) {
  hash = hash_byte(hash, static_cast<char>(text.size()));
  for (const char c : text) hash = hash_byte(hash, c);
  return hash;
}

/// As lcm-gen computes it: names and primitive types of the members and their dimensions, and
/// nested types by their own fingerprints. A type has no members of itself here.
std::uint64_t fingerprint_of(const Type& type) {
  std::uint64_t hash = 0x12345678;
  std::uint64_t nested = 0;
  for (const auto& member : type.members) {
    hash = hash_text(hash, member.name);
    if (is_primitive(member.type)) hash = hash_text(hash, member.type);
    hash = hash_byte(hash, static_cast<char>(member.dimensions.size()));
    for (const auto& dimension : member.dimensions) {
      hash = hash_byte(hash, dimension.constant ? 0 : 1);
      hash = hash_text(hash, dimension.text);
    }
    if (member.nested) nested += fingerprint_of(*member.nested);
  }
  return std::rotl(hash + nested, 1);
}

/// Walks through the bytes of a message; with `out`, notes every value.
class Walker {
 public:
  Walker(const std::vector<std::uint8_t>& bytes, std::vector<MessageField>* out)
      : bytes_(bytes), out_(out) {}

  /// Whether the bytes from `at` on are exactly one value of this type.
  bool exactly(const Type& type, std::size_t at) {
    at_ = at;
    return walk(type, "") && at_ == bytes_.size();
  }

 private:
  std::size_t left() const { return bytes_.size() - at_; }

  bool walk(const Type& type, const std::string& prefix) {
    std::map<std::string, std::int64_t> sizes;  // whole numbers that may size an array below
    for (const auto& member : type.members) {
      const std::string path = prefix.empty() ? member.name : prefix + "." + member.name;
      if (member.dimensions.empty() && member.type.starts_with("int")) {
        const int size = primitive_size(member.type);
        if (left() < static_cast<std::size_t>(size)) return false;
        sizes[member.name] = whole(size);
        note(path, std::to_string(sizes[member.name]), true);
        at_ += static_cast<std::size_t>(size);
      } else if (!dimensions(member, 0, path, sizes)) {
        return false;
      }
    }
    return true;
  }

  bool dimensions(const Type::Member& member, std::size_t depth, const std::string& path,
                  const std::map<std::string, std::int64_t>& sizes) {
    if (depth == member.dimensions.size()) return value(member, path);
    const auto& dimension = member.dimensions[depth];
    std::size_t count = dimension.size;
    if (!dimension.constant) {
      const auto given = sizes.at(dimension.text);
      if (given < 0) return false;
      count = static_cast<std::size_t>(given);
    }
    if (count > left()) return false;  // every element takes a byte or more
    const auto size = static_cast<std::size_t>(primitive_size(member.type));
    const bool bytes = member.type == "byte";
    if (depth + 1 == member.dimensions.size() && size > 0 && (bytes || !out_)) {
      if (count > left() / size) return false;
      if (bytes && out_) note_bytes(path, count);
      at_ += count * size;
      return true;
    }
    for (std::size_t i = 0; i < count; ++i) {
      if (!dimensions(member, depth + 1, out_ ? path + "[" + std::to_string(i) + "]" : path, sizes))
        return false;
    }
    return true;
  }

  bool value(const Type::Member& member, const std::string& path) {
    if (member.nested) return walk(*member.nested, path);
    if (member.type == "string") {
      if (left() < 4) return false;
      const auto length = whole(4);  // with the 0 at its end
      at_ += 4;
      if (length < 1 || static_cast<std::uint64_t>(length) > left()) return false;
      const auto end = at_ + static_cast<std::size_t>(length) - 1;
      if (bytes_[end] != 0) return false;
      note(path,
           std::string(bytes_.begin() + static_cast<std::ptrdiff_t>(at_),
                       bytes_.begin() + static_cast<std::ptrdiff_t>(end)),
           false);
      at_ = end + 1;
      return true;
    }
    const int size = primitive_size(member.type);
    if (left() < static_cast<std::size_t>(size)) return false;
    if (out_) {
      if (member.type == "double") {
        real(path, std::bit_cast<double>(whole(8)));
      } else if (member.type == "float") {
        real(path, std::bit_cast<float>(static_cast<std::int32_t>(whole(4))));
      } else if (member.type == "byte") {
        note(path, std::to_string(bytes_[at_]), true);
      } else {
        note(path, std::to_string(whole(size)), true);
      }
    }
    at_ += static_cast<std::size_t>(size);
    return true;
  }

  std::int64_t whole(int size) const {
    std::uint64_t value = bytes_[at_] >= 0x80 ? ~std::uint64_t{0} : 0;
    for (int i = 0; i < size; ++i) value = value << 8 | bytes_[at_ + static_cast<std::size_t>(i)];
    return static_cast<std::int64_t>(value);
  }
  template <class Real>
  void real(const std::string& path, Real value) {
    note(path, fmt::format("{}", value), std::isfinite(value));
  }
  void note(const std::string& path, std::string text, bool number) {
    if (out_) out_->push_back({path, std::move(text), number});
  }
  void note_bytes(const std::string& path, std::size_t count) {
    Hash64 hash;
    hash.add(bytes_.data() + at_, count);
    note(path, fmt::format("{} bytes, hash {}", count, to_hex(hash.value())), false);
  }

  const std::vector<std::uint8_t>& bytes_;
  std::vector<MessageField>* out_;
  std::size_t at_ = 0;
};

void put(std::vector<std::uint8_t>& to, std::uint64_t value, int bytes) {
  for (int i = bytes - 1; i >= 0; --i) to.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
}

void put_example(const Type& type, int count, std::vector<std::uint8_t>& to) {
  const auto sizes_an_array = [&](const std::string& name) {
    return std::any_of(type.members.begin(), type.members.end(), [&](const auto& member) {
      return std::any_of(member.dimensions.begin(), member.dimensions.end(),
                         [&](const auto& dimension) { return dimension.text == name; });
    });
  };
  for (const auto& member : type.members) {
    std::size_t values = 1;
    for (const auto& dimension : member.dimensions)
      values *= dimension.constant ? dimension.size : static_cast<std::size_t>(count);
    for (std::size_t i = 0; i < values; ++i) {
      if (member.nested) {
        put_example(*member.nested, count, to);
      } else if (member.type == "string") {
        put(to, static_cast<std::uint64_t>(count) + 1, 4);
        to.insert(to.end(), static_cast<std::size_t>(count), 'a');
        to.push_back(0);
      } else if (member.type == "double") {
        put(to, std::bit_cast<std::uint64_t>(1.0), 8);
      } else if (member.type == "float") {
        put(to, std::bit_cast<std::uint32_t>(1.0f), 4);
      } else {
        put(to, sizes_an_array(member.name) ? static_cast<std::uint64_t>(count) : 1,
            primitive_size(member.type));
      }
    }
  }
}

}  // namespace

const MessageTypes& MessageTypes::built_in() {
  static const MessageTypes types = [] {
    MessageTypes all;
    all.add(internal::lcm_files());
    return all;
  }();
  return types;
}

void MessageTypes::add_folder(const std::filesystem::path& folder) {
  std::map<std::string, std::string> files;
  if (!std::filesystem::is_directory(folder)) throw Error(folder.string() + ": is no folder");
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (entry.path().extension() == ".lcm" && entry.is_regular_file())
      files[entry.path().string()] = read_text_file(entry.path());
  }
  if (files.empty()) throw Error(folder.string() + ": holds no .lcm file");
  add(files);
}

void MessageTypes::add(const std::map<std::string, std::string>& text_by_file) {
  std::map<std::string, std::shared_ptr<Type>> fresh;
  for (const auto& [file, text] : text_by_file) {
    for (auto& type : Parser(file, text).parse()) {
      const auto [other, is_new] = fresh.emplace(type.name, std::make_shared<Type>(type));
      if (!is_new)
        throw Error(type.where + ": " + type.name + " is also in " + other->second->where);
    }
  }
  // Nested types first; what is left then contains itself, or what is in no file.
  std::set<std::string> done;
  while (done.size() < fresh.size()) {
    const auto before = done.size();
    std::string unknown;
    for (auto& [name, type] : fresh) {
      if (done.contains(name)) continue;
      bool complete = true;
      for (auto& member : type->members) {
        if (is_primitive(member.type)) continue;
        if (const auto other = fresh.find(member.type); other != fresh.end()) {
          if (done.contains(member.type)) member.nested = other->second;
        } else if (const auto known = by_name_.find(member.type); known != by_name_.end()) {
          member.nested = known->second;
        }
        if (member.nested) continue;
        complete = false;
        unknown = type->where + ": the type " + member.type + " of " + name + "." + member.name +
                  " is in none of the files, or contains itself";
      }
      if (complete) done.insert(name);
    }
    if (done.size() == before) throw Error(unknown);
  }
  for (const auto& [name, type] : fresh) {
    const auto [other, is_new] = by_fingerprint_.emplace(fingerprint_of(*type), type);
    if (!is_new && other->second->name != name)
      throw Error(type->where + ": " + name + " has the same fields as " + other->second->name +
                  " (" + other->second->where + "): LCM would confuse them; rename a field");
    by_name_[name] = type;
  }
}

const Type* MessageTypes::find(const std::vector<std::uint8_t>& message) const {
  if (message.size() < 8) return nullptr;
  std::uint64_t fingerprint = 0;
  for (std::size_t i = 0; i < 8; ++i) fingerprint = fingerprint << 8 | message[i];
  const auto at = by_fingerprint_.find(fingerprint);
  return at == by_fingerprint_.end() ? nullptr : at->second.get();
}

MessageTypes::Verdict MessageTypes::check(const std::vector<std::uint8_t>& message) const {
  const auto* type = find(message);
  if (!type) return Verdict::kUnknown;
  return Walker(message, nullptr).exactly(*type, 8) ? Verdict::kWhole : Verdict::kDamaged;
}

std::optional<MessageTypes::Decoded> MessageTypes::decode(
    const std::vector<std::uint8_t>& message) const {
  const auto* type = find(message);
  if (!type) return std::nullopt;
  Decoded decoded{type->name, {}};
  if (!Walker(message, &decoded.fields).exactly(*type, 8)) return std::nullopt;
  return decoded;
}

std::string MessageTypes::type_of(const std::vector<std::uint8_t>& message) const {
  const auto* type = find(message);
  return type ? type->name : "";
}

std::vector<std::uint8_t> MessageTypes::example(const std::string& type, int count) const {
  const auto at = by_name_.find(type);
  if (at == by_name_.end()) throw Error("there is no message type '" + type + "'");
  std::vector<std::uint8_t> message;
  put(message, fingerprint_of(*at->second), 8);
  put_example(*at->second, std::clamp(count, 0, 127), message);
  return message;
}

std::vector<FieldDifference> field_differences(const std::vector<MessageField>& a,
                                               const std::vector<MessageField>& b) {
  std::map<std::string, const MessageField*> other;
  for (const auto& field : b) other[field.path] = &field;
  std::vector<FieldDifference> out;
  std::set<std::string> seen;
  for (const auto& field : a) {
    seen.insert(field.path);
    const auto at = other.find(field.path);
    if (at == other.end()) {
      out.push_back({field.path, field.text, "-"});
    } else if (at->second->text != field.text) {
      out.push_back({field.path, field.text, at->second->text});
    }
  }
  for (const auto& field : b) {
    if (!seen.contains(field.path)) out.push_back({field.path, "-", field.text});
  }
  return out;
}

std::string describe_difference(const MessageTypes& types, const std::vector<std::uint8_t>& a,
                                const std::vector<std::uint8_t>& b, std::size_t limit) {
  const auto decoded_a = types.decode(a), decoded_b = types.decode(b);
  if (decoded_a && decoded_b && decoded_a->type == decoded_b->type) {
    const auto differences = field_differences(decoded_a->fields, decoded_b->fields);
    if (!differences.empty()) {
      std::string text = decoded_a->type + ", " + std::to_string(differences.size()) + " of " +
                         std::to_string(decoded_a->fields.size()) + " fields differ";
      for (std::size_t i = 0; i < std::min(limit, differences.size()); ++i) {
        const auto& each = differences[i];
        text += "\n  " + each.path + ": " + each.a + " | " + each.b;
      }
      if (differences.size() > limit)
        text += "\n  and " + std::to_string(differences.size() - limit) + " more";
      return text;
    }
  }
  const auto at = std::mismatch(a.begin(), a.end(), b.begin(), b.end()).first - a.begin();
  const auto what = [](const auto& decoded, const auto& type) {
    return decoded ? decoded->type : type.empty() ? "an unknown type" : type + ", damaged";
  };
  return "first different byte " + std::to_string(at) + "; " + std::to_string(a.size()) +
         " bytes of " + what(decoded_a, types.type_of(a)) + " | " + std::to_string(b.size()) +
         " bytes of " + what(decoded_b, types.type_of(b));
}

}  // namespace weft
