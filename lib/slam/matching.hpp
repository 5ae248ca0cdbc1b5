#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "slam/features.hpp"

/// Which feature is which: by place and looks, or by looks alone.
namespace weft::slam {

/// The features of a picture by where they are.
class FeatureGrid {
 public:
  /// The features must outlive it. width, height: of the picture, px; what lies beyond is in the
  /// cells at its border.
  FeatureGrid(std::span<const Feature> features, int width, int height);

  std::span<const Feature> features() const { return features_; }

  /// Calls use(index) for every feature within radius_px of (u, v) in both coordinates, in an order
  /// that is the same each time.
  template <class Use>
  void near(double u_px, double v_px, double radius_px, Use use) const {
    const int left = cell(u_px - radius_px, columns_), right = cell(u_px + radius_px, columns_);
    const int top = cell(v_px - radius_px, rows_), bottom = cell(v_px + radius_px, rows_);
    for (int y = top; y <= bottom; ++y) {
      const std::size_t row = static_cast<std::size_t>(y * columns_);
      const int begin = first_[row + static_cast<std::size_t>(left)];
      const int end = first_[row + static_cast<std::size_t>(right) + 1];
      for (int k = begin; k < end; ++k) {
        const int index = order_[static_cast<std::size_t>(k)];
        const Feature& feature = features_[static_cast<std::size_t>(index)];
        if (std::abs(feature.u_px - u_px) <= radius_px &&
            std::abs(feature.v_px - v_px) <= radius_px)
          use(index);
      }
    }
  }

 private:
  static constexpr double kCell_px = 20.0;
  static int cell(double at_px, int count) {
    if (!(at_px > 0.0)) return 0;
    return at_px >= kCell_px * count ? count - 1 : static_cast<int>(at_px / kCell_px);
  }

  std::span<const Feature> features_;
  int columns_, rows_;
  std::vector<int> first_;  // of each cell, row by row, in order_; one more at the end
  std::vector<int> order_;
};

/// Something that should be seen: where, how large and what it looks like.
struct Sought {
  float u_px = 0.0f, v_px = 0.0f;
  float radius_px = 0.0f;
  int min_level = 0, max_level = 0;  // of the features that may be it
  float angle_deg = -1.0f;           // of its patch where it was seen before; negative: not known
  Descriptor descriptor{};
};

struct Match {
  int sought = 0;   // or the feature of the first picture
  int feature = 0;  // or that of the second
  int distance = 0;
};

/// For each sought thing the feature that looks most like it among those where it should be: at
/// most max_distance bits apart and, where the second best is of the same level, below `ratio` of
/// that one's distance. A feature is used once: by the one it is most like, of equals the first
/// sought. By sought, ascending. taken: features that are not looked at (1 each), or empty.
std::vector<Match> match_by_place(std::span<const Sought> sought, const FeatureGrid& grid,
                                  int max_distance, double ratio,
                                  std::span<const std::uint8_t> taken = {});

/// Features of two pictures that look alike wherever they are, all against all: each the other's
/// best, at most max_distance apart and below `ratio` of the second best's distance for the first
/// picture's feature. By the first picture's feature, ascending.
std::vector<Match> match_by_looks(std::span<const Feature> a, std::span<const Feature> b,
                                  int max_distance, double ratio);

/// Leaves those matches out whose patches turned otherwise than most: of 30 bins of the angle
/// between them the three fullest stay, the second and third if they hold a tenth of the first
/// (ORB-SLAM). turn_deg: for each match, any angle.
void keep_common_turn(std::vector<Match>& matches, std::span<const float> turn_deg);

}  // namespace weft::slam
