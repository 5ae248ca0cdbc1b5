#pragma once

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

/// One description of an Options struct serves everything that walks over its fields: reading YAML,
/// checking ranges, the settings hash, the printed reference. A struct describes itself in one
/// member:
///
///   struct SiftOptions {
///     int bin_px = 4;
///     void visit(OptionVisitor& v) {
///       v.field("bin_px", bin_px, {2, 16}, "px", "width of a spatial bin; chosen by
///       cross-validation");
///     }
///     void validate() const { validate_fields(*this, "SiftOptions"); }  // then rules across
///     fields
///   };
namespace weft {

template <class T>
struct Range {
  T low = std::numeric_limits<T>::lowest();
  T high = std::numeric_limits<T>::max();
};

class OptionVisitor {
 public:
  virtual ~OptionVisitor() = default;
  /// Both ends of the range are allowed values. unit: "px", "m", "" ...; doc: what it does, why
  /// this default, source.
  virtual void field(const char* name, int& value, Range<int> range, const char* unit,
                     const char* doc) = 0;
  virtual void field(const char* name, double& value, Range<double> range, const char* unit,
                     const char* doc) = 0;
  virtual void field(const char* name, bool& value, const char* doc) = 0;
  virtual void field(const char* name, std::string& value, const char* doc) = 0;
  /// A list of numbers; sizes: allowed lengths.
  virtual void field(const char* name, std::vector<double>& value, Range<int> sizes,
                     const char* unit, const char* doc) = 0;
  virtual void field(const char* name, std::vector<std::string>& value, const char* doc) = 0;

  /// One of several names.
  template <class Enum>
  void choice(const char* name, Enum& value,
              std::initializer_list<std::pair<const char*, Enum>> choices, const char* doc) {
    std::vector<const char*> names;
    int index = -1;
    for (const auto& [text, each] : choices) {
      if (each == value) index = static_cast<int>(names.size());
      names.push_back(text);
    }
    choice_index(name, index, names, doc);
    if (index >= 0) value = (choices.begin() + index)->second;
  }

  /// Options within options.
  template <class Options>
  void group(const char* name, Options& options) {
    if (!begin_group(name)) return;
    options.visit(*this);
    end_group();
  }

 protected:
  virtual void choice_index(const char* name, int& index, const std::vector<const char*>& names,
                            const char* doc) = 0;
  virtual bool begin_group(const char* name) = 0;
  virtual void end_group() = 0;
};

namespace internal {
void check_fields(void (*visit)(void*, OptionVisitor&), void* options, std::string_view where);
std::uint64_t hash_fields(void (*visit)(void*, OptionVisitor&), void* options);
std::string print_fields(void (*visit)(void*, OptionVisitor&), void* options);
template <class Options>
void visit_erased(void* options, OptionVisitor& visitor) {
  static_cast<Options*>(options)->visit(visitor);
}
}  // namespace internal

/// Throws Error naming the option, its value and the range or length it breaks.
template <class Options>
void validate_fields(const Options& options, std::string_view where) {
  Options copy = options;
  internal::check_fields(&internal::visit_erased<Options>, &copy, where);
}

/// A hash of all fields with their names: equal exactly when the settings are equal.
template <class Options>
std::uint64_t options_hash(const Options& options) {
  Options copy = options;
  return internal::hash_fields(&internal::visit_erased<Options>, &copy);
}

/// YAML with each field's documentation as a comment: the reference a user copies from.
template <class Options>
std::string options_to_yaml(const Options& options) {
  Options copy = options;
  return internal::print_fields(&internal::visit_erased<Options>, &copy);
}

}  // namespace weft
