#include "evaluation/part_report.hpp"

#include <cstdio>
#include <nlohmann/json.hpp>

namespace weft::evaluation {
namespace {

nlohmann::json number(const std::optional<double>& value) {
  return value ? nlohmann::json(*value) : nlohmann::json(nullptr);
}

std::string percent(const std::optional<double>& value) {
  if (!value) return "     -";
  char text[16];
  std::snprintf(text, sizeof text, "%6.1f", *value * 100.0);
  return text;
}

}  // namespace

std::string to_table(const Evaluation& evaluation) {
  std::string table =
      "part                   images  R@1 %  R@3 %  R@5 % chance oracle   AP % AP11 %\n";
  int sure = 0, sure_right = 0;
  for (const auto& s : evaluation.parts) {
    sure += s.sure;
    sure_right += s.sure_right;
    if (s.positives == 0 && s.sure == 0) continue;
    char head[64], tail[96];
    std::snprintf(head, sizeof head, "%-22s %6d", s.part.c_str(), s.positive_images);
    std::snprintf(tail, sizeof tail, "  %d polygons, %d of %d sure detections right", s.positives,
                  s.sure_right, s.sure);
    table += head;
    for (const auto& value : {s.recall_at_1, s.recall_at_3, s.recall_at_5, s.chance_at_1,
                              s.oracle_at_1, s.ap, s.ap11}) {
      table += " " + percent(value);
    }
    table += std::string(tail) + "\n";
  }
  table += "mean                         " + std::string(" ") +
           percent(evaluation.mean_recall_at_1) + std::string(28, ' ') + " " +
           percent(evaluation.map) + "\n";
  char line[96];
  std::snprintf(line, sizeof line, "%d of %d detections of probability %.2f or more are right\n",
                sure_right, sure, evaluation.threshold);
  table += line;
  return table;
}

nlohmann::json to_json(const Evaluation& evaluation) {
  nlohmann::json json;
  json["threshold"] = evaluation.threshold;
  json["map"] = number(evaluation.map);
  json["mean_recall_at_1"] = number(evaluation.mean_recall_at_1);
  for (const auto& s : evaluation.parts) {
    auto& part = json["parts"][s.part];
    part["positives"] = s.positives;
    part["positive_images"] = s.positive_images;
    part["images"] = s.images;
    part["detections"] = s.detections;
    part["sure"] = s.sure;
    part["sure_right"] = s.sure_right;
    part["recall_at_1"] = number(s.recall_at_1);
    part["recall_at_3"] = number(s.recall_at_3);
    part["recall_at_5"] = number(s.recall_at_5);
    part["chance_at_1"] = number(s.chance_at_1);
    part["oracle_at_1"] = number(s.oracle_at_1);
    part["ap"] = number(s.ap);
    part["ap11"] = number(s.ap11);
  }
  return json;
}

}  // namespace weft::evaluation
