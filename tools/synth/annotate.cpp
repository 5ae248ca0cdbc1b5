#include "synth/annotate.hpp"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace weft::synth {
namespace {

constexpr double kJoin_m = 0.05;  // pieces closer than this belong together
constexpr float kGrow_px = 2.5f;
constexpr int kMinPiece_px = 6;  // slivers at silhouettes do not count
constexpr int kGrid_px = 6;      // of dense descriptors
constexpr int kMinGridPoints = 9;

/// Visible pixels of the largest group of pieces; the mask is changed to hold just them.
int keep_largest_group(cv::Mat& mask, double join_px) {
  cv::Mat pieces, stats, centroids;
  int count = cv::connectedComponentsWithStats(mask, pieces, stats, centroids, 8, CV_32S);
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      const int piece = pieces.at<int>(y, x);
      if (piece > 0 && stats.at<int>(piece, cv::CC_STAT_AREA) < kMinPiece_px) {
        mask.at<std::uint8_t>(y, x) = 0;
      }
    }
  }
  const int radius = std::max(1, cvRound(0.5 * join_px));
  cv::Mat grown, groups;
  cv::dilate(mask, grown,
             cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * radius + 1, 2 * radius + 1}));
  count = cv::connectedComponents(grown, groups, 8, CV_32S);
  std::vector<int> size(static_cast<std::size_t>(count), 0);
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      if (mask.at<std::uint8_t>(y, x) != 0) ++size[static_cast<std::size_t>(groups.at<int>(y, x))];
    }
  }
  const auto best = std::max_element(size.begin(), size.end()) - size.begin();
  mask.setTo(0, groups != static_cast<double>(best));
  return size[static_cast<std::size_t>(best)];
}

std::vector<cv::Point2f> grown_hull(const cv::Mat& mask) {
  std::vector<cv::Point> pixels;
  cv::findNonZero(mask, pixels);
  std::vector<cv::Point> hull;
  cv::convexHull(pixels, hull);
  std::vector<cv::Point> around;  // in 1/64 px, so that the hull is that of integers
  for (const auto& p : hull) {
    for (int i = 0; i < 16; ++i) {
      const double angle = 2 * kPi * i / 16;
      const double x = p.x + static_cast<double>(kGrow_px) * cosine(angle);
      const double y = p.y + static_cast<double>(kGrow_px) * sine(angle);
      around.emplace_back(cvRound(64.0 * std::clamp(x, 0.0, mask.cols - 1.0)),
                          cvRound(64.0 * std::clamp(y, 0.0, mask.rows - 1.0)));
    }
  }
  std::vector<cv::Point> outer;
  cv::convexHull(around, outer);
  std::vector<cv::Point2f> out;
  for (const auto& p : outer) {
    out.emplace_back(static_cast<float>(p.x) / 64.0f, static_cast<float>(p.y) / 64.0f);
  }
  return out;
}

}  // namespace

Annotation annotate(const ViewScene& scene, const IdealImages& images, const ViewRecipe& recipe,
                    const Simulation& simulation, std::size_t object) {
  Annotation out;
  const auto own = static_cast<std::uint8_t>(object + 1);
  out.labels = cv::Mat(images.object.size(), CV_8UC1, cv::Scalar(0));
  for (int y = 0; y < out.labels.rows; ++y) {
    for (int x = 0; x < out.labels.cols; ++x) {
      if (images.object.at<std::uint8_t>(y, x) != own) continue;
      const auto bits = static_cast<std::uint32_t>(images.parts.at<int>(y, x));
      const int label = bits == 0 ? 64 : 1 + __builtin_ctz(bits);
      out.labels.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>(label + (images.inside.at<std::uint8_t>(y, x) != 0 ? 128 : 0));
    }
  }
  const auto visibility = scene.part_visibility(object);
  for (std::size_t i = 0; i < simulation.parts.size(); ++i) {
    const auto& part = simulation.parts[i];
    const auto& seen = visibility[i];
    bool front = false, back = false;
    for (const auto& r : part.regions) {
      (simulation.panels[static_cast<std::size_t>(r.panel)].side == "front" ? front : back) = true;
    }
    PartRecord record;
    record.part = part.part;
    record.instance = part.instance;
    if (recipe.mirrored && part.instance == "left") record.instance = "right";
    if (recipe.mirrored && part.instance == "right") record.instance = "left";
    const double area = seen.seen_outside + seen.seen_inside;
    const double shown = seen.total * (front && back ? 0.5 : 1.0);  // by a flat garment
    record.visible_share = shown > 0.0 ? std::min(1.0, area / shown) : 0.0;
    record.inside_share = area > 0.0 ? seen.seen_inside / area : 0.0;
    record.cut_off_share = area + seen.seen_beyond_frame > 0.0
                               ? seen.seen_beyond_frame / (area + seen.seen_beyond_frame)
                               : 1.0;

    cv::Mat mask(images.object.size(), CV_8UC1, cv::Scalar(0));
    double depth_sum = 0.0;
    int count = 0;
    for (int y = 0; y < mask.rows; ++y) {
      for (int x = 0; x < mask.cols; ++x) {
        if (images.object.at<std::uint8_t>(y, x) != own) continue;
        if ((images.parts.at<int>(y, x) >> i & 1) == 0) continue;
        mask.at<std::uint8_t>(y, x) = 255;
        depth_sum += static_cast<double>(images.depth_m.at<float>(y, x));
        ++count;
      }
    }
    record.pixels = count;
    const int kept =
        count == 0 ? 0 : keep_largest_group(mask, kJoin_m * recipe.camera.fx * count / depth_sum);
    if (kept > 0) {
      const bool may_show_inside = part.part.find("collar") != std::string::npos ||
                                   part.part.find("hips") != std::string::npos;
      record.annotated = true;
      record.ignore = record.visible_share < 0.25 || kept < kMinGridPoints * kGrid_px * kGrid_px ||
                      (record.inside_share > 0.95 && !may_show_inside) ||
                      record.cut_off_share > 0.5;
      out.polygons.push_back(
          {record.part, record.instance, grown_hull(mask), record.ignore, record.visible_share});
    }
    out.records.push_back(record);
  }
  return out;
}

}  // namespace weft::synth
