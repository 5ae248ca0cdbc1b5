#include "dataset/augment.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"

namespace weft::dataset {
namespace {

/// Sine and cosine, exact for eighths of a turn, so that those give the same bits everywhere.
std::pair<double, double> sin_cos(double angle_deg) {
  double turn = std::fmod(angle_deg, 360.0);
  if (turn < 0.0) turn += 360.0;
  const double eighth = turn / 45.0;
  if (eighth == std::floor(eighth)) {
    const double d = std::sqrt(0.5);
    constexpr int kEighths = 8;
    const std::array<double, kEighths> sines = {0, d, 1, d, 0, -d, -1, -d};
    const int i = static_cast<int>(eighth) % kEighths;
    return {sines[i], sines[(i + 2) % kEighths]};
  }
  const double radians = turn * 3.14159265358979323846 / 180.0;
  return {std::sin(radians), std::cos(radians)};
}

class AugmentedDataset : public Dataset {
 public:
  AugmentedDataset(std::unique_ptr<Dataset> dataset, const AugmentOptions& options)
      : dataset_(std::move(dataset)) {
    for (std::size_t scene = 0; scene < dataset_->names().size(); ++scene) {
      for (const bool mirror : {false, true}) {
        if (mirror && !options.mirror) continue;
        for (int i = 0; i < options.rotations; ++i) {
          const Augmentation augmentation{360.0 * i / options.rotations, mirror};
          views_.push_back({scene, augmentation});
          names_.push_back(dataset_->names()[scene] + augmentation.suffix());
        }
      }
    }
  }
  const std::vector<std::string>& names() const override { return names_; }
  Scene read(std::size_t index) const override {
    const auto& [scene, augmentation] = views_.at(index);
    return augment(dataset_->read(scene), augmentation);
  }

 private:
  std::unique_ptr<Dataset> dataset_;
  std::vector<std::pair<std::size_t, Augmentation>> views_;
  std::vector<std::string> names_;
};

}  // namespace

std::string Augmentation::suffix() const {
  if (identity()) return "";
  char digits[32];
  const auto end = std::to_chars(digits, digits + sizeof digits, angle_deg).ptr;
  return "@r" + std::string(digits, end) + (mirror ? "m" : "");
}

std::pair<std::string, Augmentation> parse_augmented_name(const std::string& name) {
  const std::size_t at = name.rfind("@r");
  Augmentation augmentation;
  if (at == std::string::npos) return {name, augmentation};
  std::string digits = name.substr(at + 2);
  augmentation.mirror = !digits.empty() && digits.back() == 'm';
  if (augmentation.mirror) digits.pop_back();
  const char* const end = digits.data() + digits.size();
  const auto result = std::from_chars(digits.data(), end, augmentation.angle_deg);
  if (result.ec != std::errc() || result.ptr != end || !(std::abs(augmentation.angle_deg) <= 360.0))
    throw Error("scene name " + name +
                ": after @r a rotation in degrees is expected, then m when " + "mirrored");
  return {name.substr(0, at), augmentation};
}

Scene augment(const Scene& scene, const Augmentation& augmentation) {
  if (augmentation.identity()) return scene;
  Scene result = scene;
  result.name += augmentation.suffix();
  rgbd::RgbdFrame& frame = result.frame;
  frame.source = result.name;
  const rgbd::CameraModel from = scene.frame.camera;

  // Pixels of the result from pixels of the scene: mirror, square pixels, turn about the centre.
  const auto [sine, cosine] = sin_cos(augmentation.angle_deg);
  const double focal = from.fx == from.fy ? from.fx : std::sqrt(from.fx * from.fy);
  const double sx = (augmentation.mirror ? -1.0 : 1.0) * focal / from.fx, sy = focal / from.fy;
  const cv::Matx22d turn(cosine * sx, -sine * sy, sine * sx, cosine * sy);
  const cv::Vec2d from_centre((from.width - 1) / 2.0, (from.height - 1) / 2.0);
  const auto extent = [](double a, double b) {
    // Just under a whole number is that number: sqrt(0.5)^2 is not quite 0.5.
    return std::max(1, static_cast<int>(std::ceil(std::abs(a) + std::abs(b) - 1e-6)));
  };
  rgbd::CameraModel& to = frame.camera;
  to.width = extent(turn(0, 0) * from.width, turn(0, 1) * from.height);
  to.height = extent(turn(1, 0) * from.width, turn(1, 1) * from.height);
  const cv::Vec2d to_centre((to.width - 1) / 2.0, (to.height - 1) / 2.0);
  const auto map = [&](double x, double y) {
    return turn * (cv::Vec2d(x, y) - from_centre) + to_centre;
  };
  to.fx = to.fy = focal;
  const cv::Vec2d principal_point = map(from.cx, from.cy);
  to.cx = principal_point[0];
  to.cy = principal_point[1];

  const cv::Matx22d back = turn.inv();
  const cv::Vec2d shift = from_centre - back * to_centre;
  const cv::Matx23d from_to(back(0, 0), back(0, 1), shift[0], back(1, 0), back(1, 1), shift[1]);
  const auto warp = [&](const cv::Mat& image, int interpolation, int border) {
    cv::Mat warped;
    if (!image.empty())
      cv::warpAffine(image, warped, from_to, {to.width, to.height},
                     interpolation | cv::WARP_INVERSE_MAP, border);
    return warped;
  };
  frame.colour = warp(scene.frame.colour, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  frame.depth = warp(scene.frame.depth, cv::INTER_NEAREST, cv::BORDER_CONSTANT);
  frame.mask = warp(scene.frame.mask, cv::INTER_NEAREST, cv::BORDER_CONSTANT);

  const auto move = [&](std::vector<cv::Point2f>& points) {
    for (cv::Point2f& p : points) {
      const cv::Vec2d moved = map(p.x, p.y);
      p = {static_cast<float>(moved[0]), static_cast<float>(moved[1])};
    }
  };
  move(result.outline);
  for (PartPolygon& polygon : result.polygons) move(polygon.points);
  return result;
}

std::unique_ptr<Dataset> augment(std::unique_ptr<Dataset> dataset, const AugmentOptions& options) {
  options.validate();
  return std::make_unique<AugmentedDataset>(std::move(dataset), options);
}

Scene read_scene(const Dataset& dataset, const std::string& name) {
  const auto& names = dataset.names();
  // A set whose own names look like augmented ones comes first.
  auto found = std::find(names.begin(), names.end(), name);
  if (found != names.end()) return dataset.read(static_cast<std::size_t>(found - names.begin()));
  const auto [base, augmentation] = parse_augmented_name(name);
  found = std::find(names.begin(), names.end(), base);
  if (found == names.end()) throw Error("the data set has no scene named " + base);
  return augment(dataset.read(static_cast<std::size_t>(found - names.begin())), augmentation);
}

}  // namespace weft::dataset
