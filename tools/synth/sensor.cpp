#include "synth/sensor.hpp"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "base/error.hpp"

namespace weft::synth {
namespace {

/// Separable Gaussian of a CV_32FC3 image, in place; no OpenCV filter, whose float sums differ
/// between processors.
void gaussian_blur(cv::Mat& image, double sigma) {
  const int radius = std::max(1, static_cast<int>(sigma * 3.0 + 0.5));
  std::vector<float> kernel;
  double sum = 0.0;
  for (int i = -radius; i <= radius; ++i) {
    kernel.push_back(static_cast<float>(det::exp(-0.5 * i * i / (sigma * sigma))));
    sum += static_cast<double>(kernel.back());
  }
  for (auto& k : kernel) k /= static_cast<float>(sum);
  cv::Mat other(image.size(), image.type());
  const auto pass = [&](const cv::Mat& from, cv::Mat& to, int dx, int dy) {
    for (int y = 0; y < from.rows; ++y) {
      for (int x = 0; x < from.cols; ++x) {
        cv::Vec3f value(0, 0, 0);
        for (int i = -radius; i <= radius; ++i) {
          const int xx = std::clamp(x + i * dx, 0, from.cols - 1);
          const int yy = std::clamp(y + i * dy, 0, from.rows - 1);
          value += from.at<cv::Vec3f>(yy, xx) * kernel[static_cast<std::size_t>(i + radius)];
        }
        to.at<cv::Vec3f>(y, x) = value;
      }
    }
  };
  pass(image, other, 1, 0);
  pass(other, image, 0, 1);
}

float vec_luminance(const cv::Vec3f& v) { return luminance(Vec3(v[0], v[1], v[2])); }

/// The luminance that `share` of the pixels stay below.
double bright_level(const cv::Mat& image, double share) {
  std::vector<float> levels;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) levels.push_back(vec_luminance(image.at<cv::Vec3f>(y, x)));
  }
  const auto at = levels.begin() + static_cast<std::ptrdiff_t>(share * (image.total() - 1.0));
  std::nth_element(levels.begin(), at, levels.end());
  return static_cast<double>(*at);
}

}  // namespace

cv::Mat sense_colour(const cv::Mat& radiance, const ColourSensor& s, std::uint64_t seed) {
  Random random(seed);
  cv::Mat image = radiance.clone();
  const float cx = 0.5f * static_cast<float>(image.cols),
              cy = 0.5f * static_cast<float>(image.rows);
  double mean = 0.0;
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const float dx = (static_cast<float>(x) - cx) / cx, dy = (static_cast<float>(y) - cy) / cx;
      auto& v = image.at<cv::Vec3f>(y, x);
      v *= 1.0f - s.vignetting * std::min(1.0f, 0.64f * (dx * dx + dy * dy));
      mean += std::min(vec_luminance(v), 3.0f);
    }
  }
  mean /= static_cast<double>(image.total());
  gaussian_blur(image, s.blur_px);

  // Tone curve: gamma, then a little S around the middle.
  constexpr int kSteps = 4096;
  std::vector<float> curve(kSteps + 1);
  for (int i = 0; i <= kSteps; ++i) {
    const auto t = static_cast<float>(power(static_cast<double>(i) / kSteps, 1.0 / s.gamma));
    const float bent = t * t * (3.0f - 2.0f * t);
    curve[static_cast<std::size_t>(i)] =
        s.black_level + (255.0f - s.black_level) * (t + s.contrast * (bent - t));
  }
  const double bright = std::max(bright_level(image, 0.97), 1e-6);
  const auto gain = static_cast<float>(
      std::min(s.mean_level / std::max(mean, 1e-6), static_cast<double>(s.bright_level) / bright));
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      auto& v = image.at<cv::Vec3f>(y, x);
      const float grey = vec_luminance(v);
      for (int c = 0; c < 3; ++c) {
        const float exposed = (grey + s.saturation * (v[c] - grey)) * gain * s.balance[c];
        const float step = clamp01(exposed) * kSteps;
        const int i = std::min(static_cast<int>(step), kSteps - 1);
        const float a = curve[static_cast<std::size_t>(i)],
                    b = curve[static_cast<std::size_t>(i) + 1];
        v[c] = a + (b - a) * (step - static_cast<float>(i));
      }
    }
  }
  if (s.sharpening > 0.0f) {
    cv::Mat soft = image.clone();
    gaussian_blur(soft, 1.0);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        auto& v = image.at<cv::Vec3f>(y, x);
        v += (v - soft.at<cv::Vec3f>(y, x)) * s.sharpening;
      }
    }
  }

  // Shot noise grows with the signal; demosaicing averages about half of it away.
  const auto noisy = [&](float value) {
    const float sigma = s.noise_grey * (s.mosaic ? 1.35f : 1.0f) * (0.75f + 0.5f * value / 255.0f);
    return cv::saturate_cast<std::uint8_t>(value + sigma * static_cast<float>(random.normal()));
  };
  cv::Mat colour;
  if (s.mosaic) {
    cv::Mat raw(image.size(), CV_8UC1);
    for (int y = 0; y < raw.rows; ++y) {
      for (int x = 0; x < raw.cols; ++x) {  // R G / G B
        raw.at<std::uint8_t>(y, x) = noisy(image.at<cv::Vec3f>(y, x)[(y & 1) + (x & 1)]);
      }
    }
    cv::cvtColor(raw, colour, cv::COLOR_BayerBG2BGR);
  } else {
    colour = cv::Mat(image.size(), CV_8UC3);
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const auto& v = image.at<cv::Vec3f>(y, x);
        for (int c = 0; c < 3; ++c) colour.at<cv::Vec3b>(y, x)[c] = noisy(v[2 - c]);
      }
    }
  }
  if (s.jpeg_quality == 0) return colour;
  std::vector<std::uint8_t> bytes;
  if (!cv::imencode(".jpg", colour, bytes, {cv::IMWRITE_JPEG_QUALITY, s.jpeg_quality})) {
    throw Error("JPEG: cannot encode; is OpenCV built with it?");
  }
  return cv::imdecode(bytes, cv::IMREAD_COLOR);
}

cv::Mat sense_depth(const IdealImages& images, const DepthSensor& s,
                    const std::vector<Fabric>& fabrics, std::uint64_t seed) {
  Random random(seed + 1);
  const auto noise_seed = static_cast<std::uint32_t>(random.bits());
  const int width = images.depth_m.cols, height = images.depth_m.rows;
  const float fb = s.focal_px * s.baseline_m;
  cv::Mat disparity(height, width, CV_32FC1);
  const int shift_x = static_cast<int>(s.shift_x_px + 64.5f) - 64;
  const int shift_y = static_cast<int>(s.shift_y_px + 64.5f) - 64;
  const auto source = [&](int x, int y) {
    return cv::Point(std::clamp(x + shift_x, 0, width - 1), std::clamp(y + shift_y, 0, height - 1));
  };
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      disparity.at<float>(y, x) = fb / images.depth_m.at<float>(source(x, y));
    }
  }
  const auto centred = [](float v) { return 2.0f * v - 1.0f; };
  cv::Mat out(height, width, CV_16UC1, cv::Scalar(0));
  for (int y = s.border_px[1]; y < height - s.border_px[3]; ++y) {
    for (int x = s.border_px[0]; x < width - s.border_px[2]; ++x) {
      const float own = disparity.at<float>(y, x);
      const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
      const cv::Point p = source(x, y);
      const float fine = static_cast<float>(random.normal());
      if (images.shadow.at<std::uint8_t>(p) != 0) continue;
      const float cosine_view = images.cosine.at<float>(p);
      if (cosine_view <
          s.steep_loss * (0.4f + 1.2f * noise(fx / 4.0f, fy / 4.0f, noise_seed + 2))) {
        continue;
      }
      const int object = images.object.at<std::uint8_t>(p);
      if (object > 0) {
        const float loss = fabrics[static_cast<std::size_t>(object - 1)].infrared_loss;
        if (loss > 0.0f &&
            fractal_noise(fx / 9.0f, fy / 9.0f, 3, noise_seed + 3) < 0.22f + 0.4f * loss) {
          continue;
        }
      }
      // The sensor matches windows of dots: small relief is averaged, edges are ragged.
      float sum = 0.0f, lowest = own, highest = own;
      int count = 0;
      for (int j = std::max(0, y - s.window_px); j <= std::min(height - 1, y + s.window_px); ++j) {
        for (int i = std::max(0, x - s.window_px); i <= std::min(width - 1, x + s.window_px); ++i) {
          const float d = disparity.at<float>(j, i);
          if (std::abs(j - y) <= 2 && std::abs(i - x) <= 2) {
            lowest = std::min(lowest, d);
            highest = std::max(highest, d);
          }
          if (std::abs(d - own) > 1.2f) continue;
          sum += d;
          ++count;
        }
      }
      const float ragged = noise(fx / 3.0f, fy / 3.0f, noise_seed + 1);
      if (highest - lowest > 1.0f && ragged < s.edge_loss) continue;
      const float slope = std::min(3.0f, 1.0f / std::max(0.2f, cosine_view) - 1.0f);
      float d = sum / static_cast<float>(count);
      d += s.noise_px * fine * (1.0f + 2.0f * slope);
      // Value noise has a standard deviation of about 0.38.
      d += s.blotch_px * (1.0f + slope) / 0.38f *
           centred(noise(fx / s.blotch_size_px, fy / s.blotch_size_px, noise_seed + 4));
      const int band = floor_int(fx / s.band_width_px + 0.5f);
      d += s.band_px * centred(hash01(band, 0, noise_seed + 6));
      const float u = fx / static_cast<float>(width) * 2.0f - 1.0f;
      const float v = fy / static_cast<float>(height) * 2.0f - 1.0f;
      const float warp = s.warp_m * (s.warp[0] * u + s.warp[1] * v + s.warp[2] * u * u +
                                     s.warp[3] * u * v + s.warp[4] * v * v);
      d = fb / (fb / std::max(d, 1e-3f) + warp);
      d = s.step_px * static_cast<float>(floor_int(d / s.step_px + 0.5f));
      if (d <= 0.0f) continue;
      const float mm = 1000.0f * fb / d;
      if (mm < 10000.0f) out.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(mm + 0.5f);
    }
  }
  // Drivers close small holes with the farther side.
  for (int y = 0; y < height && s.fill_px > 0; ++y) {
    auto* row = out.ptr<std::uint16_t>(y);
    for (int x = 0; x < width;) {
      int end = x;
      while (end < width && row[end] == 0) ++end;
      if (end > x && x > 0 && end < width && end - x <= s.fill_px) {
        std::fill(row + x, row + end, std::max(row[x - 1], row[end]));
      }
      x = end + 1;
    }
  }
  return out;
}

}  // namespace weft::synth
