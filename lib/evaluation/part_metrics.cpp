#include "evaluation/part_metrics.hpp"

#include <algorithm>
#include <cmath>

namespace weft::evaluation {
namespace {

using dataset::PartPolygon;
using detector::Detection;

struct Ranked {
  int image;
  const Detection* detection;
};

bool on_segment(const cv::Point2f& a, const cv::Point2f& b, double x, double y) {
  const double dx = static_cast<double>(b.x) - a.x, dy = static_cast<double>(b.y) - a.y;
  if (dx * (y - a.y) != dy * (x - a.x)) return false;
  return std::min(a.x, b.x) <= x && x <= std::max(a.x, b.x) && std::min(a.y, b.y) <= y &&
         y <= std::max(a.y, b.y);
}

std::vector<const PartPolygon*> polygons_of(const JudgedImage& image, const std::string& part,
                                            bool ignore) {
  std::vector<const PartPolygon*> found;
  for (const auto& polygon : image.truth) {
    if (polygon.part == part && polygon.ignore == ignore) found.push_back(&polygon);
  }
  return found;
}

bool inside_any(const std::vector<const PartPolygon*>& polygons, double x, double y) {
  return std::any_of(polygons.begin(), polygons.end(),
                     [&](const PartPolygon* p) { return inside(p->points, x, y); });
}

std::optional<double> chance(const cv::Mat& mask, const std::vector<const PartPolygon*>& targets,
                             const std::vector<const PartPolygon*>& ignored) {
  int counted = 0, hits = 0;
  for (int y = 0; y < mask.rows; ++y) {
    const auto* row = mask.ptr<std::uint8_t>(y);
    for (int x = 0; x < mask.cols; ++x) {
      if (row[x] == 0) continue;
      const bool hit = inside_any(targets, x, y);
      if (!hit && inside_any(ignored, x, y)) continue;
      ++counted;
      hits += hit;
    }
  }
  if (counted == 0) return std::nullopt;
  return static_cast<double>(hits) / counted;
}

bool box_centre_hits(const PartPolygon& polygon, const std::vector<const PartPolygon*>& targets) {
  if (polygon.points.empty()) return false;
  float left = polygon.points[0].x, right = left, top = polygon.points[0].y, bottom = top;
  for (const auto& p : polygon.points) {
    left = std::min(left, p.x);
    right = std::max(right, p.x);
    top = std::min(top, p.y);
    bottom = std::max(bottom, p.y);
  }
  return inside_any(targets, 0.5 * (static_cast<double>(left) + right),
                    0.5 * (static_cast<double>(top) + bottom));
}

PartScore score_part(const std::vector<JudgedImage>& images, const std::string& part,
                     double threshold) {
  PartScore score;
  score.part = part;
  score.images = static_cast<int>(images.size());
  std::vector<Ranked> ranked;
  std::vector<std::vector<const PartPolygon*>> targets;
  int found_at[3] = {0, 0, 0};
  constexpr int kRanks[3] = {1, 3, 5};
  int oracle_hits = 0, chance_images = 0;
  double chance_sum = 0.0;
  const auto better = [](const Ranked& a, const Ranked& b) {
    return a.detection->probability > b.detection->probability;
  };
  for (std::size_t i = 0; i < images.size(); ++i) {
    const auto& image = images[i];
    targets.push_back(polygons_of(image, part, false));
    const auto ignored = polygons_of(image, part, true);
    const auto begin = static_cast<std::ptrdiff_t>(ranked.size());
    for (const auto& d : image.detections) {
      if (d.part != part) continue;
      const double x = d.centre_sensor_px.x(), y = d.centre_sensor_px.y();
      const bool right = inside_any(targets.back(), x, y);
      if (!right && inside_any(ignored, x, y)) continue;
      ranked.push_back({static_cast<int>(i), &d});
      if (d.probability < threshold) continue;
      ++score.sure;
      score.sure_right += right;
    }
    std::stable_sort(ranked.begin() + begin, ranked.end(), better);
    if (targets.back().empty()) continue;

    ++score.positive_images;
    score.positives += static_cast<int>(targets.back().size());
    for (auto r = ranked.begin() + begin; r != ranked.end(); ++r) {
      const auto& centre = r->detection->centre_sensor_px;
      if (!inside_any(targets.back(), centre.x(), centre.y())) continue;
      const auto rank = r - (ranked.begin() + begin) + 1;
      for (int k = 0; k < 3; ++k) found_at[k] += rank <= kRanks[k];
      break;
    }
    for (const auto* polygon : targets.back()) {
      oracle_hits += box_centre_hits(*polygon, targets.back());
    }
    if (const auto c = chance(image.mask, targets.back(), ignored)) {
      chance_sum += *c;
      ++chance_images;
    }
  }
  score.detections = static_cast<int>(ranked.size());
  if (score.positives == 0) return score;

  const double n = score.positive_images;
  score.recall_at_1 = found_at[0] / n;
  score.recall_at_3 = found_at[1] / n;
  score.recall_at_5 = found_at[2] / n;
  score.oracle_at_1 = static_cast<double>(oracle_hits) / score.positives;
  if (chance_images > 0) score.chance_at_1 = chance_sum / chance_images;

  std::stable_sort(ranked.begin(), ranked.end(), better);
  std::vector<bool> hits;
  for (const auto& r : ranked) {
    auto& open = targets[static_cast<std::size_t>(r.image)];
    const auto& centre = r.detection->centre_sensor_px;
    const auto hit = std::find_if(open.begin(), open.end(), [&](const PartPolygon* p) {
      return inside(p->points, centre.x(), centre.y());
    });
    hits.push_back(hit != open.end());
    if (hit != open.end()) open.erase(hit);
  }
  const auto ap = average_precision(hits, score.positives);
  score.ap = ap.all_points;
  score.ap11 = ap.eleven_points;
  return score;
}

}  // namespace

bool inside(const std::vector<cv::Point2f>& polygon, double x, double y) {
  bool odd = false;
  for (std::size_t i = 0, j = polygon.size() - 1; i < polygon.size(); j = i++) {
    const auto& a = polygon[i];
    const auto& b = polygon[j];
    if (on_segment(a, b, x, y)) return true;
    if ((a.y > y) != (b.y > y) &&
        x < (static_cast<double>(b.x) - a.x) * (y - a.y) / (static_cast<double>(b.y) - a.y) + a.x) {
      odd = !odd;
    }
  }
  return odd;
}

AveragePrecision average_precision(const std::vector<bool>& hits, int positives) {
  AveragePrecision result;
  if (positives <= 0) return result;
  std::vector<double> recall, precision;
  int right = 0;
  for (std::size_t i = 0; i < hits.size(); ++i) {
    right += hits[i];
    recall.push_back(static_cast<double>(right) / positives);
    precision.push_back(static_cast<double>(right) / static_cast<double>(i + 1));
  }
  for (std::size_t i = precision.size(); i-- > 1;) {
    precision[i - 1] = std::max(precision[i - 1], precision[i]);
  }
  double before = 0.0;
  for (std::size_t i = 0; i < recall.size(); ++i) {
    result.all_points += (recall[i] - before) * precision[i];
    before = recall[i];
  }
  for (int step = 0; step <= 10; ++step) {
    // recall >= step / 10 in integers: 10 right >= step positives
    const auto reached = std::find_if(recall.begin(), recall.end(), [&](double r) {
      return std::lround(r * positives) * 10 >= static_cast<long>(step) * positives;
    });
    if (reached != recall.end()) {
      result.eleven_points += precision[static_cast<std::size_t>(reached - recall.begin())];
    }
  }
  result.eleven_points /= 11.0;
  return result;
}

Evaluation evaluate_parts(const std::vector<JudgedImage>& images, double threshold) {
  Evaluation evaluation;
  evaluation.threshold = threshold;
  double ap = 0.0, recall = 0.0;
  int parts = 0;
  for (const char* part : detector::kParts) {
    evaluation.parts.push_back(score_part(images, part, threshold));
    const auto& score = evaluation.parts.back();
    if (score.positives == 0) continue;
    ap += *score.ap;
    recall += *score.recall_at_1;
    ++parts;
  }
  if (parts > 0) {
    evaluation.map = ap / parts;
    evaluation.mean_recall_at_1 = recall / parts;
  }
  return evaluation;
}

}  // namespace weft::evaluation
