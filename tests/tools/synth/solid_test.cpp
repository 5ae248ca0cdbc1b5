#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <map>

#include "synth/solid_mesh.hpp"

namespace weft::synth {
namespace {

std::size_t at(int i) { return static_cast<std::size_t>(i); }

/// Every edge is passed once in each direction.
bool is_closed(const SolidMesh& mesh) {
  std::map<std::pair<int, int>, int> count;
  for (const auto& f : mesh.faces) {
    for (int c = 0; c < 3; ++c) ++count[{f[at(c)], f[at((c + 1) % 3)]}];
  }
  for (const auto& [edge, n] : count) {
    const auto back = count.find({edge.second, edge.first});
    if (n != 1 || back == count.end() || back->second != 1) return false;
  }
  return !mesh.faces.empty();
}

/// Positive where faces are counter-clockwise seen from outside.
double volume(const SolidMesh& mesh) {
  double sum = 0.0;
  for (const auto& f : mesh.faces) {
    const Eigen::Vector3d a = mesh.position[at(f[0])].cast<double>(),
                          b = mesh.position[at(f[1])].cast<double>(),
                          c = mesh.position[at(f[2])].cast<double>();
    sum += a.dot(b.cross(c)) / 6.0;
  }
  return sum;
}

double area(const Surface& s) {
  double sum = 0.0;
  for (const auto& f : s.faces) {
    const Vec3 &a = s.position[at(f[0])], &b = s.position[at(f[1])], &c = s.position[at(f[2])];
    sum += 0.5 * static_cast<double>((b - a).cross(c - a).norm());
  }
  return sum;
}

Surface sheet(float z, float side = 0.1f) {
  Surface s;
  s.position = {{0, 0, z}, {side, 0, z}, {side, side, z}, {0, side, z}};
  s.faces = {{0, 1, 2}, {0, 2, 3}};
  return s;
}

TEST(Prism, TessellationCoversItsFacesOutwards) {
  const Prism box = make_box({0.3f, -0.2f}, {1.0f, 0.5f}, -0.3f, 0.1f, 0.6f, 0.8f);
  const Surface s = tessellate(box, 0.07f);
  EXPECT_NEAR(area(s), 2 * (0.5 + 0.4 + 0.2), 1e-4);
  const Surface round = tessellate(make_cylinder({0, 0}, 0.5f, 0.0f, 0.2f), 0.05f);
  EXPECT_NEAR(area(round), 2 * 0.7854 + 0.2 * 3.1416, 0.01);
  for (const auto* surface : {&s, &round}) {
    for (std::size_t i = 0; i < surface->faces.size(); ++i) {
      const auto& f = surface->faces[i];
      const Vec3& a = surface->position[at(f[0])];
      const Vec3 n = (surface->position[at(f[1])] - a).cross(surface->position[at(f[2])] - a);
      EXPECT_GT(n.dot(surface->normal[at(f[0])]), 0.99f * n.norm());
    }
  }
}

TEST(Prism, DistanceIsThatOfTheNearestPoint) {
  const Prism box = make_box({0, 0}, {1.0f, 0.5f}, 0.0f, 0.2f);
  EXPECT_NEAR(signed_distance(box, {0.0f, 0.0f, 0.1f}), -0.1f, 1e-6f);
  EXPECT_NEAR(signed_distance(box, {0.45f, 0.0f, 0.1f}), -0.05f, 1e-6f);
  EXPECT_NEAR(signed_distance(box, {0.8f, 0.65f, 0.1f}), 0.5f, 1e-6f);
  EXPECT_NEAR(signed_distance(box, {0.8f, 0.0f, 0.6f}), 0.5f, 1e-6f);
  EXPECT_TRUE(contains(box, {0.4f, 0.2f}));
  EXPECT_FALSE(contains(box, {0.4f, 0.3f}));
}

TEST(SolidMesh, ThickenedSheetIsClosedAndHasItsVolume) {
  const SolidMesh mesh = thicken(sheet(0.02f), 0.0045f, 0.004f);
  EXPECT_TRUE(is_closed(mesh));
  // A slab with half-round edges: 0.1^2 2r + 4 0.1 pi r^2 / 2 + 4/3 pi r^3.
  const double r = 0.0045;
  EXPECT_NEAR(volume(mesh), 0.01 * 2 * r + 0.2 * 3.1416 * r * r + 4.19 * r * r * r, 7e-6);
  for (const auto& p : mesh.position) {
    EXPECT_NEAR(std::abs(p.z() - 0.02f), 0.0f, 0.0052f);
  }
}

TEST(SolidMesh, LayersBecomeOneSolidAndHollowsAreFilled) {
  Surface two = sheet(0.0f);
  const Surface upper = sheet(0.006f);
  two.position.insert(two.position.end(), upper.position.begin(), upper.position.end());
  two.faces.push_back({4, 5, 6});
  two.faces.push_back({4, 6, 7});
  const SolidMesh mesh = thicken(two, 0.0036f, 0.004f);
  EXPECT_TRUE(is_closed(mesh));
  for (const auto& p : mesh.position) {  // nothing is left between the layers
    const bool beside = p.x() < 0.0f || p.y() < 0.0f || p.x() > 0.1f || p.y() > 0.1f;
    if (beside) continue;
    EXPECT_GT(std::abs(p.z() - 0.003f), 0.002f);
  }
  // A closed box of sheet: filled, not a shell.
  const Surface box = tessellate(make_box({0, 0}, {0.06f, 0.06f}, 0.0f, 0.06f), 0.02f);
  EXPECT_GT(volume(thicken(box, 0.0045f, 0.004f)), 0.06 * 0.06 * 0.06);
}

TEST(SolidMesh, UnionOfOverlappingBoxes) {
  const SolidMesh mesh = unite(
      {make_box({0, 0}, {0.4f, 0.4f}, 0.0f, 0.1f), make_box({0, 0}, {0.1f, 0.1f}, -0.3f, 0.05f)},
      0.01f);
  EXPECT_TRUE(is_closed(mesh));
  EXPECT_NEAR(volume(mesh), 0.016 + 0.003, 0.001);
}

}  // namespace
}  // namespace weft::synth
