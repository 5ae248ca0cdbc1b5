#include "tools/weft/compare_truth.hpp"

#include "base/error.hpp"
#include "dataset/augment.hpp"
#include "evaluate/judge.hpp"

namespace weft {
namespace {

using Images = std::map<std::pair<std::string, int>, evaluation::JudgedImage>;

/// By name and how many of this name came before.
Images judge(const std::string& log, const std::string& channel, const dataset::Dataset& data,
             std::size_t& failed) {
  evaluate::Selection all;
  all.several = true;
  int without_answer = 0;
  auto list = evaluate::judge_log(
      log, channel, data, all, without_answer, [](int, int) {}, [](const std::string&) {}, {});
  failed = static_cast<std::size_t>(without_answer);
  Images images;
  std::map<std::string, int> seen;
  for (auto& image : list) {
    const int number = seen[image.name]++;
    images.emplace(std::pair{image.name, number}, std::move(image));
  }
  return images;
}

}  // namespace

TruthComparison compare_with_truth(const std::string& log_a, const std::string& channel_a,
                                   const std::string& log_b, const std::string& channel_b,
                                   const std::string& dataset, double threshold) {
  const auto data = dataset::open_dataset(dataset);
  TruthComparison result;
  auto in_a = judge(log_a, channel_a, *data, result.failed_a);
  auto in_b = judge(log_b, channel_b, *data, result.failed_b);
  std::vector<evaluation::JudgedImage> a, b;
  for (auto& [key, image] : in_a) {
    const auto other = in_b.find(key);
    if (other == in_b.end()) continue;
    const auto alone_a = evaluation::evaluate_parts({image}, threshold);
    const auto alone_b = evaluation::evaluate_parts({other->second}, threshold);
    for (std::size_t i = 0; i < alone_a.parts.size(); ++i) {
      const auto& one = alone_a.parts[i].recall_at_1;
      const auto& two = alone_b.parts[i].recall_at_1;
      if (one && two && *one != *two)
        result.changes.push_back({image.name, alone_a.parts[i].part, *two > *one});
    }
    result.polygons[image.name] = image.truth;
    a.push_back(std::move(image));
    b.push_back(std::move(other->second));
  }
  if (a.empty())
    throw Error(dataset + ": none of its scenes is in both runs; the frames' sources name them");
  result.images = a.size();
  result.a = evaluation::evaluate_parts(a, threshold);
  result.b = evaluation::evaluate_parts(b, threshold);
  return result;
}

}  // namespace weft
