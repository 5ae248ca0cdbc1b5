#include "base/settings.hpp"

#include <yaml-cpp/yaml.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>

#include "base/check_fields.hpp"
#include "base/error.hpp"

namespace weft {

namespace {

std::string place(const std::string& name, const YAML::Node& node) {
  const int line = node.Mark().line;
  return line >= 0 ? name + ":" + std::to_string(line + 1) : name;
}

using Places = std::map<std::string, std::string>;

}  // namespace

struct Settings::Data {
  YAML::Node node;
  std::string name;
  Places places;  // of the keys ("group.key") that set() wrote

  /// What an error about a key begins with; at: its node.
  std::string place_of(const std::string& path, const YAML::Node& at) const {
    const auto written = places.find(path);
    return written != places.end() ? written->second : place(name, at);
  }
  std::string place_of(const std::string& path) const {
    YAML::Node at = node;
    std::istringstream keys(path);
    for (std::string key; std::getline(keys, key, '.');) {
      const YAML::Node child = std::as_const(at)[key];
      if (!child) return name;
      at.reset(child);
    }
    return place_of(path, at);
  }
};

namespace {

std::string key_of(const YAML::Node& key, const std::string& name) {
  try {
    return key.as<std::string>();
  } catch (const YAML::Exception&) {
    throw Error(place(name, key) + ": a key must be a word, not a list or a map");
  }
}

YAML::Node parse(const std::string& text, const std::string& name) {
  YAML::Node node;
  try {
    node = YAML::Load(text);
  } catch (const YAML::Exception& e) {
    throw Error(name + ":" + std::to_string(e.mark.line + 1) + ": not valid YAML: " + e.msg);
  }
  if (node.IsNull()) node = YAML::Node(YAML::NodeType::Map);
  if (!node.IsMap())
    throw Error(place(name, node) + ": expected a map of settings (key: value lines)");
  return node;
}

void note(Places& places, const std::string& path, const YAML::Node& node,
          const std::string& from) {
  places[path] = from;
  if (!node.IsMap()) return;
  for (const auto& entry : node)
    note(places, path + "." + key_of(entry.first, from), entry.second, from);
}

/// Replaces the values of base by those of over, key by key.
void merge_into(YAML::Node base, const YAML::Node& over, const std::string& path,
                const std::string& from, Places& places) {
  for (const auto& entry : over) {
    const auto key = key_of(entry.first, from);
    if (entry.second.IsMap() && base[key] && base[key].IsMap()) {
      merge_into(base[key], entry.second, path + key + ".", from, places);
    } else {
      base[key] = entry.second;
      note(places, path + key, entry.second, from);
    }
  }
}

// Walks the options and the YAML side by side.
class Reader : public OptionVisitor {
 public:
  using PlaceOf = std::function<std::string(const std::string&, const YAML::Node&)>;
  Reader(const YAML::Node& root, const std::string& name, PlaceOf place_of)
      : name_(name), place_of_(std::move(place_of)) {
    levels_.push_back({root, {}, ""});
  }

  void field(const char* name, int& value, Range<int>, const char*, const char*) override {
    get(name, value, "a whole number");
  }
  void field(const char* name, double& value, Range<double>, const char*, const char*) override {
    get(name, value, "a number");
  }
  void field(const char* name, bool& value, const char*) override {
    get(name, value, "true or false");
  }
  void field(const char* name, std::string& value, const char*) override {
    get(name, value, "a text");
  }
  void field(const char* name, std::vector<double>& value, Range<int>, const char*,
             const char*) override {
    get(name, value, "a list of numbers");
  }
  void field(const char* name, std::vector<std::string>& value, const char*) override {
    get(name, value, "a list of texts");
  }

  /// Every key of the YAML must have been asked for.
  void finish_level() {
    const auto& level = levels_.back();
    for (const auto& entry : level.node) {
      const auto key = key_of(entry.first, name_);
      if (level.known.contains(key)) continue;
      std::string known;
      for (const auto& each : level.known) known += (known.empty() ? "" : ", ") + each;
      throw Error(place_of_(level.path + key, entry.first) + ": unknown key '" + level.path + key +
                  "'; expected one of: " + known);
    }
  }

 protected:
  void choice_index(const char* name, int& index, const std::vector<const char*>& names,
                    const char*) override {
    std::string text, all;
    for (const char* each : names) all += (all.empty() ? "" : ", ") + std::string(each);
    const YAML::Node node = find(name);
    if (!node) return;
    get(name, text, "one of: " + all);
    for (std::size_t i = 0; i < names.size(); ++i) {
      if (text == names[i]) {
        index = static_cast<int>(i);
        return;
      }
    }
    fail(name, node, "one of: " + all);
  }
  bool begin_group(const char* name) override {
    const YAML::Node node = find(name);
    if (!node) return false;
    if (!node.IsMap()) fail(name, node, "a map of settings");
    levels_.push_back({node, {}, levels_.back().path + name + "."});
    return true;
  }
  void end_group() override {
    finish_level();
    levels_.pop_back();
  }

 private:
  struct Level {
    YAML::Node node;
    std::set<std::string> known;
    std::string path;
  };

  YAML::Node find(const char* name) {
    levels_.back().known.insert(name);
    const YAML::Node& node = levels_.back().node;
    const YAML::Node child = node[name];
    return child ? child : YAML::Node(YAML::NodeType::Undefined);
  }
  template <class T>
  void get(const char* name, T& value, const std::string& expected) {
    const YAML::Node node = find(name);
    if (!node) return;
    try {
      value = node.as<T>();
    } catch (const YAML::Exception&) {
      fail(name, node, expected);
    }
  }
  [[noreturn]] void fail(const char* name, const YAML::Node& node, const std::string& expected) {
    std::string got = node.IsScalar() ? "'" + node.Scalar() + "'"
                      : node.IsMap()  ? "a map"
                                      : "a list";
    const std::string path = levels_.back().path + name;
    throw Error(place_of_(path, node) + ": " + path + " is " + got + "; expected " + expected);
  }

  std::vector<Level> levels_;
  std::string name_;
  PlaceOf place_of_;
};

}  // namespace

Settings::Settings() : data_(std::make_unique<Data>()) {}
Settings::~Settings() = default;
Settings::Settings(Settings&&) noexcept = default;
Settings& Settings::operator=(Settings&&) noexcept = default;
Settings::Settings(const Settings& other) : data_(std::make_unique<Data>()) {
  data_->node = YAML::Clone(other.data_->node);
  data_->name = other.data_->name;
  data_->places = other.data_->places;
}

Settings Settings::from_text(const std::string& text, const std::string& name) {
  Settings settings;
  settings.data_->node = parse(text, name);
  settings.data_->name = name;
  return settings;
}

Settings Settings::empty(const std::string& name) { return from_text("", name); }

Settings Settings::from_file(const std::string& path) {
  std::ifstream file(path);
  if (!file)
    throw Error(path + ": cannot open the settings file; check the path and its permissions");
  std::ostringstream text;
  text << file.rdbuf();
  return from_text(text.str(), path);
}

void Settings::set(const std::string& assignment, const std::string& from) {
  const auto equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0) {
    throw Error("'" + assignment + "' does not set anything; write key=value or group.key=value");
  }
  std::string text;
  std::string indent;
  std::string key;
  std::istringstream keys(assignment.substr(0, equals));
  while (std::getline(keys, key, '.')) {
    text += (text.empty() ? "" : "\n") + indent + key + ":";
    indent += "  ";
  }
  const std::string where = from.empty() ? "--set " + assignment : from;
  const YAML::Node over = parse(text + " " + assignment.substr(equals + 1), where);
  merge_into(data_->node, over, "", where, data_->places);
}

const std::string& Settings::name() const { return data_->name; }

std::string Settings::path(const std::string& file) const {
  return (std::filesystem::path(name()).parent_path() / file).lexically_normal().string();
}
const YAML::Node& Settings::node() const { return data_->node; }

void Settings::read_fields(void (*visit)(void*, OptionVisitor&), void* options) const {
  Reader reader(data_->node, data_->name, [this](const std::string& path, const YAML::Node& at) {
    return data_->place_of(path, at);
  });
  visit(options, reader);
  reader.finish_level();
  try {
    internal::check_fields_at(visit, options,
                              [this](const std::string& path) { return data_->place_of(path); });
  } catch (const YAML::Exception& e) {
    throw Error(data_->name + ": " + e.what());
  }
}

}  // namespace weft
