#include "synth/set_summary.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <sstream>
#include <vector>

#include "base/error.hpp"
#include "base/text_file.hpp"
#include "dataset/iri.hpp"
#include "synth/statistics.hpp"

namespace weft::synth {
namespace fs = std::filesystem;
namespace {

constexpr const char* kTypes[] = {"polo",  "jeans",   "tshirt", "dress",
                                  "shirt", "sweater", "towel",  "blanket"};
constexpr const char* kStates[] = {"flat", "wrinkled", "folded", "crumpled"};
constexpr const char* kSplits[] = {"train", "test-seen", "test-held-out"};

std::vector<nlohmann::json> read_lines(const fs::path& file) {
  std::vector<nlohmann::json> out;
  std::istringstream in(read_text_file(file));
  for (std::string line; std::getline(in, line);) {
    out.push_back(nlohmann::json::parse(line, nullptr, false));
    if (!out.back().is_object())
      throw Error(fmt::format("{}:{}: not a JSON object", file.string(), out.size()));
  }
  return out;
}

dataset::IriAnnotation read_annotation(const std::string& folder, const std::string& name) {
  const fs::path file = fs::path(folder) / "annotations" / (name + ".txt");
  return dataset::parse_iri_annotation(read_text_file(file), file.string());
}

std::string reasons(const std::map<std::string, int>& counts) {
  std::string out;
  int all = 0;
  for (const auto& [reason, count] : counts) {
    out += fmt::format("{}{} {}", out.empty() ? "" : ", ", reason, count);
    all += count;
  }
  return all == 0 ? "none" : fmt::format("{} ({})", all, out);
}

}  // namespace

std::string summarise(const std::string& folder) {
  const auto entries = read_lines(fs::path(folder) / "manifest.jsonl");
  std::map<std::string, std::map<std::string, int>> scenes;  // by type; states and splits
  std::map<std::string, std::map<std::string, PartCount>> parts;
  std::set<std::string> simulations;
  std::map<std::string, int> views;
  int doubles = 0, easy = 0;
  for (const auto& entry : entries) {
    const std::string split = entry.at("split"), garment = entry.at("garment");
    for (const std::string& key : {std::string(entry.at("state")), split, std::string("all")}) {
      ++scenes[garment][key];
      ++scenes["all"][key];
    }
    simulations.insert(entry.at("simulation"));
    doubles += entry.at("second").is_null() ? 0 : 1;
    easy += entry.at("easy") ? 1 : 0;
    for (const std::string reason : entry.at("rejected_views")) ++views[reason];
    dataset::Scene scene;
    scene.polygons = read_annotation(folder, entry.at("name")).polygons;
    std::map<std::string, PartCount> own;
    count_parts(scene, own);
    for (const auto& [part, count] : own) {
      for (const std::string& key : {split, std::string("all")}) {
        auto& sum = parts[part][key];
        sum.usable += count.usable;
        sum.ignored += count.ignored;
        sum.centred += count.centred;
      }
    }
  }
  std::string out = fmt::format("{} scenes of {} simulations, {} with two garments, {} easy\n\n",
                                entries.size(), simulations.size(), doubles, easy);
  out += fmt::format("{:<8}", "scenes");
  for (const auto* state : kStates) out += fmt::format(" {:>8}", state);
  for (const auto* split : kSplits) out += fmt::format(" {:>13}", split);
  out += fmt::format(" {:>6}\n", "all");
  const auto row = [&](const std::string& type) {
    if (!scenes.contains(type)) return;
    auto& counts = scenes.at(type);
    out += fmt::format("{:<8}", type);
    for (const auto* state : kStates) out += fmt::format(" {:>8}", counts[state]);
    for (const auto* split : kSplits) out += fmt::format(" {:>13}", counts[split]);
    out += fmt::format(" {:>6}\n", counts["all"]);
  };
  for (const auto* type : kTypes) row(type);
  row("all");

  out += fmt::format("\n{:<22}", "usable annotations");
  for (const auto* split : kSplits) out += fmt::format(" {:>13}", split);
  out += fmt::format(" {:>6} {:>8} {:>10}\n", "all", "ignored", "oracle R@1");
  for (auto& [part, counts] : parts) {
    const auto& all = counts["all"];
    out += fmt::format("{:<22}", part);
    for (const auto* split : kSplits) out += fmt::format(" {:>13}", counts[split].usable);
    out += fmt::format(" {:>6} {:>8} ", all.usable, all.ignored);
    out += all.usable > 0
               ? fmt::format("{:>10.3f}\n", static_cast<double>(all.centred) / all.usable)
               : fmt::format("{:>10}\n", "-");
  }

  std::map<std::string, int> poses;
  int given_up = 0;
  if (fs::is_directory(fs::path(folder) / "simulations")) {
    for (const auto& entry : fs::directory_iterator(fs::path(folder) / "simulations")) {
      const std::string file = entry.path().string();
      const auto end = file.rfind(".rejects.jsonl");
      if (end == std::string::npos) continue;
      for (const auto& reject : read_lines(file)) ++poses[reject.at("reason")];
      given_up += fs::exists(file.substr(0, end) + ".wsim") ? 0 : 1;
    }
    out += fmt::format("\nrejected poses: {}; garments given up: {}", reasons(poses), given_up);
  }
  return out + fmt::format("\nrejected views: {}\n", reasons(views));
}

void write_contact_sheet(const std::string& folder) {
  constexpr int kWidth = 320, kHeight = 240, kMargin = 22;
  std::map<std::pair<std::string, std::string>, std::string> shown;  // the first single one
  std::set<std::string> present;
  for (const auto& entry : read_lines(fs::path(folder) / "manifest.jsonl")) {
    present.insert(entry.at("garment"));
    if (entry.at("second").is_null())
      shown.emplace(std::pair(entry.at("garment"), entry.at("state")), entry.at("name"));
  }
  std::vector<std::string> types;
  for (const auto* type : kTypes) {
    if (present.contains(type)) types.emplace_back(type);
  }
  const int columns = static_cast<int>(std::size(kStates)), rows = static_cast<int>(types.size());
  cv::Mat sheet(kMargin + rows * kHeight, columns * kWidth, CV_8UC3, cv::Scalar::all(255));
  for (int column = 0; column < columns; ++column) {
    const auto at = static_cast<std::size_t>(column);
    cv::putText(sheet, kStates[at], {column * kWidth + 6, 16}, cv::FONT_HERSHEY_SIMPLEX, 0.5,
                {0, 0, 0});
    for (int row = 0; row < rows; ++row) {
      const std::string& type = types[static_cast<std::size_t>(row)];
      const auto scene = shown.find({type, kStates[at]});
      if (scene == shown.end()) continue;
      const std::string file = (fs::path(folder) / "png" / (scene->second + ".png")).string();
      cv::Mat picture = cv::imread(file, cv::IMREAD_COLOR), small;
      if (picture.empty()) throw Error(file + ": cannot be read");
      for (const auto& p : read_annotation(folder, scene->second).polygons) {
        std::vector<cv::Point> points;
        for (const auto& q : p.points) points.emplace_back(cvRound(q.x), cvRound(q.y));
        cv::polylines(picture, points, true,
                      p.ignore ? cv::Scalar(128, 128, 128) : cv::Scalar(0, 255, 0), 2);
      }
      cv::putText(picture, scene->second, {6, 20}, cv::FONT_HERSHEY_SIMPLEX, 0.6, {0, 0, 255}, 2);
      cv::resize(picture, small, {kWidth, kHeight}, 0, 0, cv::INTER_AREA);
      small.copyTo(sheet(cv::Rect(column * kWidth, kMargin + row * kHeight, kWidth, kHeight)));
    }
  }
  std::vector<std::uint8_t> bytes;
  cv::imencode(".png", sheet, bytes);
  write_text_file(fs::path(folder) / "contact-sheet.png", std::string(bytes.begin(), bytes.end()));
}

}  // namespace weft::synth
