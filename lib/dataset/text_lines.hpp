#pragma once

#include <charconv>
#include <cmath>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.hpp"

/// Small text files of data sets, split into words.
namespace weft::dataset {

inline std::string read_text(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw Error(path + ": cannot be opened as a file");
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

struct TextLine {
  std::string where;  // "file:line"
  std::vector<std::string_view> words;
};

/// The lines that hold anything but blanks and do not begin with #. `text` must outlive the result.
inline std::vector<TextLine> split_lines(std::string_view text, const std::string& where) {
  constexpr std::string_view kBlank = " \t\r\v\f,";
  std::vector<TextLine> lines;
  int number = 0;
  while (!text.empty()) {
    const auto end = text.find('\n');
    std::string_view rest = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    ++number;
    TextLine line{where + ":" + std::to_string(number), {}};
    for (;;) {
      const auto begin = rest.find_first_not_of(kBlank);
      if (begin == std::string_view::npos) break;
      rest.remove_prefix(begin);
      line.words.push_back(rest.substr(0, rest.find_first_of(kBlank)));
      rest.remove_prefix(line.words.back().size());
    }
    if (!line.words.empty() && line.words[0][0] != '#') lines.push_back(std::move(line));
  }
  return lines;
}

/// Throws Error naming `where` unless the whole word is one finite number.
inline double parse_number(std::string_view word, const std::string& where) {
  double value = 0.0;
  if (word.size() > 1 && word[0] == '+') word.remove_prefix(1);
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(value))
    throw Error(where + ": '" + std::string(word.substr(0, 40)) + "' is no finite number");
  return value;
}

}  // namespace weft::dataset
