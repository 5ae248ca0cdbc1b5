#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/options.hpp"

namespace YAML {
class Node;
}

namespace weft {

/// Strict YAML settings. Every read names file, line and key in its errors; a key nobody asked for
/// is an error.
class Settings {
 public:
  static Settings from_file(const std::string& path);
  static Settings from_text(const std::string& text, const std::string& name);
  /// No settings at all: every option keeps its default.
  static Settings empty(const std::string& name);
  ~Settings();
  Settings(Settings&&) noexcept;
  Settings& operator=(Settings&&) noexcept;
  Settings(const Settings&);

  /// Reads all fields of options, which keep their defaults where the YAML says nothing, then
  /// validates. Throws Error (file:line: key ...: what was expected) on an unknown key, a wrong
  /// type or a value out of range.
  template <class Options>
  void read(Options& options) const {
    read_fields(&internal::visit_erased<Options>, &options);
    options.validate();
  }

  /// Sets "group.key" to a YAML scalar or list, as on a command line: key=value. from: where it was
  /// written, for errors; default: "--set key=value".
  void set(const std::string& assignment, const std::string& from = "");

  const std::string& name() const;
  /// A file that a setting names: relative to the folder of the settings file, if there is one.
  std::string path(const std::string& file) const;
  const YAML::Node& node() const;  // for files that are not Options (process sets)

 private:
  Settings();
  void read_fields(void (*visit)(void*, OptionVisitor&), void* options) const;
  struct Data;
  std::unique_ptr<Data> data_;
};

}  // namespace weft
