#include "synth/arrange.hpp"

#include <algorithm>
#include <cmath>
#include <set>

namespace weft::synth {
namespace {

constexpr float kCell_m = 0.008f;
constexpr int kSide = 320, kApartCells = 3, kTries = 60;

using Cell = std::pair<int, int>;

/// Cells that a turned garment covers, about its own origin, grown by half a cell.
std::vector<Cell> footprint(const Simulation& s, const Placement& turn) {
  std::set<Cell> cells;
  constexpr int kSteps = 5;
  for (const auto& f : s.faces) {
    const Vec3 &a = s.pose[static_cast<std::size_t>(f[0])],
               &b = s.pose[static_cast<std::size_t>(f[1])],
               &c = s.pose[static_cast<std::size_t>(f[2])];
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; i + j <= kSteps; ++j) {
        const float u = static_cast<float>(i) / kSteps, v = static_cast<float>(j) / kSteps;
        const Vec2 p = turn.apply(a + u * (b - a) + v * (c - a)).head<2>() / kCell_m;
        cells.insert({floor_int(p.x()), floor_int(p.y())});
      }
    }
  }
  return {cells.begin(), cells.end()};
}

class Desk {
 public:
  explicit Desk(const Prism& top) : top_(top), taken_(kSide * kSide, 0) {}

  /// gap: cells to the next garment.
  bool is_free(const std::vector<Cell>& cells, const Cell& at, int gap) const {
    for (const auto& [x, y] : cells) {
      const int column = x + at.first, row = y + at.second;
      const Vec2 p((static_cast<float>(column) + 0.5f) * kCell_m,
                   (static_cast<float>(row) + 0.5f) * kCell_m);
      if (!contains(top_, p)) return false;
      if (is_taken(column, row)) return false;
      if (gap > 0) {
        for (const auto& [dx, dy] : {Cell(gap, 0), Cell(-gap, 0), Cell(0, gap), Cell(0, -gap)}) {
          if (is_taken(column + dx, row + dy)) return false;
        }
      }
    }
    return true;
  }
  bool overlaps(const std::vector<Cell>& cells, const Cell& at) const {
    return std::any_of(cells.begin(), cells.end(), [&](const Cell& c) {
      return is_taken(c.first + at.first, c.second + at.second);
    });
  }
  void take(const std::vector<Cell>& cells, const Cell& at) {
    for (const auto& [x, y] : cells) {
      const int column = x + at.first + kSide / 2, row = y + at.second + kSide / 2;
      taken_[static_cast<std::size_t>(row * kSide + column)] = 1;
    }
  }

 private:
  bool is_taken(int x, int y) const {
    x += kSide / 2;
    y += kSide / 2;
    return x >= 0 && y >= 0 && x < kSide && y < kSide &&
           taken_[static_cast<std::size_t>(y * kSide + x)] != 0;
  }

  const Prism& top_;
  std::vector<char> taken_;
};

std::optional<Cell> find_place(Random& r, const Desk& desk, const std::vector<Cell>& cells,
                               const Prism& top, bool to_others) {
  Vec2 low = top.outline[0], high = low;
  for (const auto& p : top.outline) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Vec2 reach = 0.5f * (high - low) / kCell_m;
  for (int k = 0; k < kTries; ++k) {
    const Cell at(static_cast<int>(r.uniform(-1.0, 1.0) * static_cast<double>(reach.x())),
                  static_cast<int>(r.uniform(-1.0, 1.0) * static_cast<double>(reach.y())));
    if (!desk.is_free(cells, at, to_others ? 0 : kApartCells)) continue;
    if (!to_others) return at;
    // On a straight way towards the others, up to the step before they would overlap.
    const Cell goal(static_cast<int>(0.2 * r.uniform(-1.0, 1.0) * static_cast<double>(reach.x())),
                    static_cast<int>(0.2 * r.uniform(-1.0, 1.0) * static_cast<double>(reach.y())));
    Cell last = at;
    for (int step = 1; step <= 100; ++step) {
      const Cell next(at.first + (goal.first - at.first) * step / 100,
                      at.second + (goal.second - at.second) * step / 100);
      if (desk.overlaps(cells, next)) {
        if (desk.is_free(cells, last, 0)) return last;
        break;
      }
      last = next;
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::vector<Placement>> arrange(Random& r,
                                              const std::vector<const Simulation*>& garments,
                                              const Prism& top, Neighbours neighbours) {
  Desk desk(top);
  std::vector<Placement> out;
  for (std::size_t i = 0; i < garments.size(); ++i) {
    Placement placement;
    const double angle = r.uniform(0.0, 2 * kPi);
    placement.sine = static_cast<float>(sine(angle));
    placement.cosine = static_cast<float>(cosine(angle));
    const auto cells = footprint(*garments[i], placement);
    const auto at = find_place(r, desk, cells, top, i > 0 && neighbours == Neighbours::kTouching);
    if (!at) return std::nullopt;
    desk.take(cells, *at);
    placement.offset =
        Vec2(static_cast<float>(at->first) * kCell_m, static_cast<float>(at->second) * kCell_m);
    out.push_back(placement);
  }
  return out;
}

std::vector<Fabric> draw_fabrics(Random& r, const std::vector<const Simulation*>& garments,
                                 const Vec3& desk_colour, bool same, bool different) {
  const auto shown = [](float v) { return power(static_cast<double>(v), 1.0 / 2.2); };
  const auto apart = [&](const Fabric& a, const Fabric& b) {
    double sum = 0.0;
    for (int c = 0; c < 3; ++c) {
      const double d = shown(a.base[c]) - shown(b.base[c]);
      sum += d * d;
    }
    return std::sqrt(sum);
  };
  std::vector<Fabric> out;
  for (std::size_t i = 0; i < garments.size(); ++i) {
    if (same && i > 0) {
      out.push_back(out[0]);
      out.back().seed += static_cast<std::uint32_t>(i);
      continue;
    }
    for (int k = 0;; ++k) {
      Fabric f = draw_fabric(r, false, desk_colour, *garments[i]);
      const bool fits = !different || std::all_of(out.begin(), out.end(), [&](const auto& other) {
        return apart(f, other) > 0.3;
      });
      if (!fits && k < 30) continue;
      out.push_back(std::move(f));
      break;
    }
  }
  return out;
}

}  // namespace weft::synth
