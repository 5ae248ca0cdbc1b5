#pragma once

#include <cstdint>

namespace weft::mapping {

struct Colour {
  int red, green, blue;
};

inline constexpr Colour kPointColour{130, 130, 130};
inline constexpr Colour kPathColour{220, 30, 30};
inline constexpr Colour kGarmentColour{200, 0, 120};

/// One that differs from its neighbours'.
inline Colour plane_colour(std::int64_t id) {
  constexpr Colour kColours[] = {{31, 119, 180}, {44, 160, 44},  {255, 127, 14}, {148, 103, 189},
                                 {140, 86, 75},  {23, 190, 207}, {188, 189, 34}, {227, 119, 194}};
  return kColours[static_cast<std::size_t>(id) % 8];
}

}  // namespace weft::mapping
