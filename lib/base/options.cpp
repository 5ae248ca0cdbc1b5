#include "base/options.hpp"

#include <cmath>
#include <cstdio>

#include "base/check_fields.hpp"
#include "base/error.hpp"
#include "base/hash.hpp"

namespace weft::internal {
namespace {

std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.17g", value);
  double shorter;
  char shortest[40];
  for (int digits = 1; digits < 17; ++digits) {
    std::snprintf(shortest, sizeof shortest, "%.*g", digits, value);
    if (std::sscanf(shortest, "%lf", &shorter) == 1 && shorter == value) return shortest;
  }
  return text;
}

std::string quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + '"';
}

template <class T>
std::string range_text(Range<T> range) {
  if (range.low == std::numeric_limits<T>::lowest() && range.high == std::numeric_limits<T>::max())
    return "any";
  if (range.high == std::numeric_limits<T>::max()) return ">= " + number(range.low);
  if (range.low == std::numeric_limits<T>::lowest()) return "<= " + number(range.high);
  return number(range.low) + " to " + number(range.high);
}

class PathVisitor : public OptionVisitor {
 protected:
  bool begin_group(const char* name) override {
    path_.push_back(name);
    return true;
  }
  void end_group() override { path_.pop_back(); }
  std::string full(const char* name) const {
    std::string text;
    for (const auto& part : path_) text += part + ".";
    return text + name;
  }
  std::size_t depth() const { return path_.size(); }

 private:
  std::vector<std::string> path_;
};

}  // namespace

using Where = std::function<std::string(const std::string&)>;

class RangeChecker : public PathVisitor {
 public:
  explicit RangeChecker(const Where& where) : where_(where) {}
  void field(const char* name, int& value, Range<int> range, const char* unit,
             const char*) override {
    check(name, value, range, unit);
  }
  void field(const char* name, double& value, Range<double> range, const char* unit,
             const char*) override {
    if (!std::isfinite(value)) fail(name, number(value), "a finite number");
    check(name, value, range, unit);
  }
  void field(const char*, bool&, const char*) override {}
  void field(const char*, std::string&, const char*) override {}
  void field(const char* name, std::vector<double>& value, Range<int> sizes, const char*,
             const char*) override {
    const int size = static_cast<int>(value.size());
    if (size < sizes.low || size > sizes.high) {
      fail(name, "a list of " + std::to_string(size),
           "a list of " + range_text(sizes) + " numbers");
    }
    for (const double each : value) {
      if (!std::isfinite(each)) fail(name, number(each), "finite numbers");
    }
  }
  void field(const char*, std::vector<std::string>&, const char*) override {}

 protected:
  void choice_index(const char* name, int& index, const std::vector<const char*>&,
                    const char*) override {
    if (index < 0) fail(name, "no known choice", "one of its choices");
  }

 private:
  template <class T>
  void check(const char* name, T value, Range<T> range, const char* unit) {
    if (value < range.low || value > range.high) {
      fail(name, number(value), range_text(range) + (*unit ? std::string(" ") + unit : ""));
    }
  }
  [[noreturn]] void fail(const char* name, const std::string& value, const std::string& rule) {
    throw Error(where_(full(name)) + ": option " + full(name) + " is " + value + "; it must be " +
                rule);
  }
  const Where& where_;
};

class Printer : public PathVisitor {
 public:
  void field(const char* name, int& value, Range<int> range, const char* unit,
             const char* doc) override {
    line(name, std::to_string(value), std::string(doc) + describe(range_text(range), unit));
  }
  void field(const char* name, double& value, Range<double> range, const char* unit,
             const char* doc) override {
    line(name, number(value), std::string(doc) + describe(range_text(range), unit));
  }
  void field(const char* name, bool& value, const char* doc) override {
    line(name, value ? "true" : "false", doc);
  }
  void field(const char* name, std::string& value, const char* doc) override {
    line(name, quoted(value), doc);
  }
  void field(const char* name, std::vector<double>& value, Range<int> sizes, const char* unit,
             const char* doc) override {
    std::string text = "[";
    for (std::size_t i = 0; i < value.size(); ++i) text += (i ? ", " : "") + number(value[i]);
    line(name, text + "]", std::string(doc) + describe(range_text(sizes) + " numbers", unit));
  }
  void field(const char* name, std::vector<std::string>& value, const char* doc) override {
    std::string text = "[";
    for (std::size_t i = 0; i < value.size(); ++i) text += (i ? ", " : "") + quoted(value[i]);
    line(name, text + "]", doc);
  }
  std::string printed;

 protected:
  void choice_index(const char* name, int& index, const std::vector<const char*>& names,
                    const char* doc) override {
    std::string all;
    for (const char* each : names) all += (all.empty() ? "" : " | ") + std::string(each);
    line(name, index < 0 ? "" : names[static_cast<std::size_t>(index)],
         std::string(doc) + " (" + all + ")");
  }
  bool begin_group(const char* name) override {
    printed += std::string(2 * depth(), ' ') + name + ":\n";
    return PathVisitor::begin_group(name);
  }

 private:
  static std::string describe(const std::string& range, const char* unit) {
    return " (" + range + (*unit ? std::string(", ") + unit : "") + ")";
  }
  void line(const char* name, const std::string& value, const std::string& doc) {
    printed += std::string(2 * depth(), ' ') + name + ": " + value + "  # " + doc + "\n";
  }
};

// Hashes names and values; documentation and ranges may change without changing what the settings
// mean.
class Hasher : public PathVisitor {
 public:
  void field(const char* name, int& value, Range<int>, const char*, const char*) override {
    add(name, std::to_string(value));
  }
  void field(const char* name, double& value, Range<double>, const char*, const char*) override {
    add(name, number(value));
  }
  void field(const char* name, bool& value, const char*) override {
    add(name, value ? "true" : "false");
  }
  void field(const char* name, std::string& value, const char*) override { add(name, value); }
  void field(const char* name, std::vector<double>& value, Range<int>, const char*,
             const char*) override {
    add(name, std::to_string(value.size()));
    for (const double each : value) hash.add(number(each));
  }
  void field(const char* name, std::vector<std::string>& value, const char*) override {
    add(name, std::to_string(value.size()));
    for (const auto& each : value) hash.add(each);
  }
  Hash64 hash;

 protected:
  void choice_index(const char* name, int& index, const std::vector<const char*>& names,
                    const char*) override {
    add(name, index < 0 ? "" : names[static_cast<std::size_t>(index)]);
  }

 private:
  void add(const char* name, const std::string& value) {
    hash.add(full(name));
    hash.add(value);
  }
};

void check_fields_at(void (*visit)(void*, OptionVisitor&), void* options, const Where& where) {
  RangeChecker checker(where);
  visit(options, checker);
}

void check_fields(void (*visit)(void*, OptionVisitor&), void* options, std::string_view where) {
  check_fields_at(visit, options, [&](const std::string&) { return std::string(where); });
}

std::uint64_t hash_fields(void (*visit)(void*, OptionVisitor&), void* options) {
  Hasher hasher;
  visit(options, hasher);
  return hasher.hash.value();
}

std::string print_fields(void (*visit)(void*, OptionVisitor&), void* options) {
  Printer printer;
  visit(options, printer);
  return printer.printed;
}

}  // namespace weft::internal
