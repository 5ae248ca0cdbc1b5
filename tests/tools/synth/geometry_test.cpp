#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <opencv2/core/mat.hpp>

#include "base/random.hpp"
#include "support/files.hpp"
#include "synth/pattern_maps.hpp"
#include "synth/ray_scene.hpp"
#include "tools/synth/procedural.hpp"

namespace weft::synth {
namespace {

Surface surface_of(const Simulation& s) {
  Surface out;
  out.position = s.pose;
  out.pattern = s.pattern;
  out.faces = s.faces;
  out.panel_of_face = s.panel_of_face;
  compute_normals(out);
  return out;
}

TEST(Maths, SineAndPowerAgreeWithTheLibrary) {
  for (double x = -12.0; x < 12.0; x += 0.037) {
    EXPECT_NEAR(sine(x), std::sin(x), 1e-12) << x;
    EXPECT_NEAR(cosine(x), std::cos(x), 1e-12) << x;
  }
  for (double x = 0.01; x < 3.0; x += 0.1) {
    EXPECT_NEAR(power(x, 2.2), std::pow(x, 2.2), 1e-12);
  }
  EXPECT_EQ(power(0.0, 0.4), 0.0);
}

TEST(Maths, NoiseIsSmoothAndFillsItsRange) {
  float low = 1.0f, high = 0.0f, steepest = 0.0f;
  for (int i = 0; i < 20'000; ++i) {
    const float x = 0.013f * static_cast<float>(i) - 100.0f, y = 0.007f * static_cast<float>(i);
    const float v = noise(x, y, 5);
    low = std::min(low, v);
    high = std::max(high, v);
    steepest = std::max(steepest, std::abs(noise(x + 0.001f, y, 5) - v) / 0.001f);
  }
  EXPECT_GE(low, 0.0f);
  EXPECT_LT(low, 0.1f);
  EXPECT_LE(high, 1.0f);
  EXPECT_GT(high, 0.9f);
  EXPECT_LT(steepest, 1.7f);  // a smooth step of 1 rises by 1.5 at most
}

TEST(SimulationFile, ComesBackAsWritten) {
  const test::TemporaryFolder folder;
  const Simulation s = test::procedural_sack("one", 0.003f);
  write_simulation(folder / "one.wsim", s);
  const Simulation r = read_simulation(folder / "one.wsim");
  EXPECT_EQ(r.name, "one");
  EXPECT_EQ(r.garment, s.garment);
  EXPECT_EQ(r.faces, s.faces);
  EXPECT_EQ(r.panel_of_face, s.panel_of_face);
  ASSERT_EQ(r.pose.size(), s.pose.size());
  for (std::size_t i = 0; i < s.pose.size(); ++i) EXPECT_EQ(r.pose[i], s.pose[i]);
  ASSERT_EQ(r.parts.size(), 2u);
  EXPECT_TRUE(r.parts[0].regions[1].is_line);
  EXPECT_EQ(r.parts[0].regions[1].panel, 1);
  EXPECT_EQ(r.parts[1].regions[0].points, s.parts[1].regions[0].points);
  ASSERT_EQ(r.features.size(), s.features.size());
  EXPECT_TRUE(r.features.back().inside);
}

TEST(SimulationFile, NamesWhatIsWrong) {
  const test::TemporaryFolder folder;
  Simulation s = test::procedural_sack();
  const std::string path = folder / "bad.wsim";
  const auto error = [&] { return test::error_of([&] { read_simulation(path); }); };
  EXPECT_NE(error().find("cannot be opened"), std::string::npos);
  write_simulation(path, s);
  const std::string bytes = test::read_bytes(path);
  test::write_bytes(path, bytes.substr(0, bytes.size() - 10));
  EXPECT_NE(error().find("array panel ends early"), std::string::npos) << error();
  test::write_bytes(path, "{\"format\": \"weft-sim\", \"version\": 2}\n");
  EXPECT_NE(error().find("version"), std::string::npos) << error();
  test::write_bytes(path, "nothing\n");
  EXPECT_NE(error().find("JSON"), std::string::npos) << error();
  s.faces[7][1] = static_cast<int>(s.pose.size());
  write_simulation(path, s);
  EXPECT_NE(error().find("face 7"), std::string::npos) << error();
  s = test::procedural_sack();
  s.pose[3].z() = std::nanf("");
  write_simulation(path, s);
  EXPECT_NE(error().find("vertex 3"), std::string::npos) << error();
}

TEST(Surface, SubdivisionKeepsTopologyAndFlatness) {
  const Surface in = surface_of(test::procedural_sack());
  std::vector<std::array<int, 2>> parents;
  const Surface out = subdivide(in, parents);
  EXPECT_EQ(out.faces.size(), 4 * in.faces.size());
  EXPECT_EQ(out.position.size(), in.position.size() + parents.size());
  // Euler: a sack is a disc.
  const auto edges = (3 * out.faces.size() + 2 * 2 * 24) / 2;
  EXPECT_EQ(out.position.size() + out.faces.size(), edges + 1);
  double area_in = 0.0, area_out = 0.0;
  const auto area = [](const Surface& s, double& sum) {
    for (const auto& f : s.faces) {
      const auto p = [&](int k) {
        return s.position[static_cast<std::size_t>(f[static_cast<std::size_t>(k)])];
      };
      sum += 0.5 * static_cast<double>((p(1) - p(0)).cross(p(2) - p(0)).norm());
    }
  };
  area(in, area_in);
  area(out, area_out);
  EXPECT_NEAR(area_out, area_in, 0.04 * area_in);  // seams are rounded
  for (std::size_t i = 0; i < out.position.size(); ++i) {
    const Vec2& p = out.pattern[i];
    if (std::abs(p.x()) < 0.14f && p.y() > 0.04f && out.normal[i].z() > 0.5f) {
      EXPECT_NEAR(out.position[i].z(), 0.006f, 1e-6f);
      EXPECT_NEAR(out.position[i].x(), p.x(), 1e-5f);
      EXPECT_NEAR(out.normal[i].z(), 1.0f, 1e-5f);
    }
  }
}

TEST(Surface, SmoothingTakesRipplesAndLeavesShape) {
  Simulation s = test::procedural_sack();
  for (std::size_t i = 0; i < s.pose.size(); ++i) {
    s.pose[i].z() += (i % 2 == 0 ? 0.001f : -0.001f) + 0.02f * std::sin(12.0f * s.pose[i].x());
  }
  Surface surface = surface_of(s);
  smooth(surface, 2, 0);
  double before = 0.0, after = 0.0, shape = 0.0;
  for (std::size_t i = 0; i < s.pose.size(); ++i) {
    const Vec2& p = s.pattern[i];
    if (std::abs(p.x()) > 0.12f || p.y() < 0.06f || p.y() > 0.4f) continue;
    if (surface.normal[i].z() < 0.0f) continue;
    const float ideal = 0.006f + 0.02f * std::sin(12.0f * s.pose[i].x());
    before += std::abs(static_cast<double>(s.pose[i].z() - ideal));
    after += std::abs(static_cast<double>(surface.position[i].z() - ideal));
    shape = std::max(shape, std::abs(static_cast<double>(surface.position[i].x() - s.pose[i].x())));
  }
  EXPECT_LT(after, 0.35 * before);
  EXPECT_LT(shape, 0.002);
}

TEST(Surface, SmoothingTakesScallopsFromSeams) {
  Simulation s = test::procedural_sack();
  const auto at_side = [&](std::size_t i) {
    return s.pattern[i].x() > 0.179f && s.pattern[i].y() > 0.03f && s.pattern[i].y() < 0.42f;
  };
  for (std::size_t i = 0; i < s.pose.size(); ++i) {
    if (at_side(i)) s.pose[i].x() += cvRound(s.pattern[i].y() / 0.015f) % 2 == 0 ? 0.002f : -0.002f;
  }
  Surface surface = surface_of(s);
  smooth(surface, 2, 8);
  for (std::size_t i = 0; i < s.pose.size(); ++i) {
    if (at_side(i)) {
      EXPECT_NEAR(surface.position[i].x(), 0.18f, 0.0007f);
    }
    const Vec2& p = s.pattern[i];
    if (std::abs(p.x()) < 0.12f && p.y() > 0.06f && p.y() < 0.4f) {
      EXPECT_LT((surface.position[i] - s.pose[i]).norm(), 0.002f);
    }
  }
}

TEST(RayScene, FindsWhatBruteForceFinds) {
  const Surface s = surface_of(test::procedural_sack("sack", 0.01f));
  RayScene scene;
  scene.add(s);
  scene.commit();
  Random r(3);
  int hits = 0;
  for (int k = 0; k < 400; ++k) {
    const Vec3 origin(static_cast<float>(r.uniform(-0.3, 0.3)),
                      static_cast<float>(r.uniform(-0.3, 0.3)), 0.5f);
    const Vec3 target(static_cast<float>(r.uniform(-0.2, 0.2)),
                      static_cast<float>(r.uniform(-0.25, 0.25)), 0.0f);
    const Vec3 d = target - origin;
    double best = 1e30;
    for (const auto& f : s.faces) {  // Moeller and Trumbore 1997
      const auto p = [&](std::size_t i) {
        return s.position[static_cast<std::size_t>(f[i])].cast<double>().eval();
      };
      const Eigen::Vector3d a = p(0), e1 = p(1) - a, e2 = p(2) - a, dd = d.cast<double>();
      const Eigen::Vector3d q = dd.cross(e2);
      const double det = e1.dot(q);
      if (std::abs(det) < 1e-14) continue;
      const Eigen::Vector3d t = origin.cast<double>() - a;
      const double u = t.dot(q) / det;
      const Eigen::Vector3d w = t.cross(e1);
      const double v = dd.dot(w) / det, z = e2.dot(w) / det;
      if (u >= 0 && v >= 0 && u + v <= 1 && z > 0) best = std::min(best, z);
    }
    const RayHit hit = scene.intersect(origin, d);
    ASSERT_EQ(hit.object >= 0, best < 1e30) << k;
    EXPECT_EQ(scene.occluded(origin, d, 0.0f, 2.0f), best < 2.0);
    if (hit.object < 0) continue;
    ++hits;
    EXPECT_NEAR(hit.distance, best, 1e-5);
    const auto& f = s.faces[static_cast<std::size_t>(hit.face)];
    const Vec3 there = (1.0f - hit.u - hit.v) * s.position[static_cast<std::size_t>(f[0])] +
                       hit.u * s.position[static_cast<std::size_t>(f[1])] +
                       hit.v * s.position[static_cast<std::size_t>(f[2])];
    EXPECT_LT((there - (origin + hit.distance * d)).norm(), 1e-5f);
  }
  EXPECT_GT(hits, 100);
}

TEST(PanelMaps, PartsAgreeWithGeometry) {
  const Simulation s = test::procedural_sack();
  const auto maps = make_panel_maps(s);
  ASSERT_EQ(maps.size(), 2u);
  Random r(4);
  for (int k = 0; k < 3000; ++k) {
    const Vec2 p(static_cast<float>(r.uniform(-0.18, 0.18)),
                 static_cast<float>(r.uniform(0.0, 0.45)));
    const float to_top = 0.45f - p.y();
    const bool on_patch = p.x() > -0.15f && p.x() < -0.05f && p.y() > 0.05f && p.y() < 0.12f;
    for (int panel = 0; panel < 2; ++panel) {
      const PanelMap& map = maps[static_cast<std::size_t>(panel)];
      const int bits = map.parts.at<int>(map.texel(p));
      if (std::abs(to_top - 0.05f) > 0.001f) {
        EXPECT_EQ((bits & 1) != 0, to_top < 0.05f) << p.x() << " " << p.y();
      }
      const Vec2 border = (p - Vec2(-0.1f, 0.085f)).cwiseAbs() - Vec2(0.05f, 0.035f);
      if (border.cwiseAbs().minCoeff() > 0.001f) {
        EXPECT_EQ((bits & 2) != 0, panel == 0 && on_patch) << p.x() << " " << p.y();
      }
    }
  }
}

TEST(PanelMaps, FeaturesStandOffAndKnowTheirFace) {
  const auto maps = make_panel_maps(test::procedural_sack());
  const PanelMap& front = maps[0];
  const auto outside = [&](float x, float y) {
    return static_cast<Material>(front.outside.at<std::uint8_t>(front.texel(Vec2(x, y))));
  };
  EXPECT_EQ(outside(-0.1f, 0.08f), Material::kPocket);
  EXPECT_EQ(outside(0.1f, 0.2f), Material::kFabric);
  EXPECT_EQ(outside(0.1f, 0.445f), Material::kRib);
  EXPECT_EQ(outside(0.004f, 0.35f), Material::kButton);
  EXPECT_NE(outside(0.0f, 0.41f), Material::kLabel);
  const auto label = front.inside.at<std::uint8_t>(front.texel(Vec2(0.019f, 0.401f)));
  EXPECT_EQ(static_cast<Material>(label), Material::kLabel);
  EXPECT_NEAR(front.height_at(Vec2(0.1f, 0.2f)), 0.0f, 1e-4f);
  EXPECT_NEAR(front.height_at(Vec2(-0.1f, 0.08f)), 0.9f, 0.05f);
  EXPECT_LT(front.height_at(Vec2(0.05f, 0.4f + 0.003f)), -0.1f);  // groove of the stitch
}

TEST(PanelMaps, BoxBlurIsTheMeanOfTheBox) {
  cv::Mat image(9, 11, CV_32FC1), blurred;
  Random r(5);
  for (int y = 0; y < 9; ++y) {
    for (int x = 0; x < 11; ++x) image.at<float>(y, x) = static_cast<float>(r.uniform());
  }
  blurred = image.clone();
  box_blur(blurred, 2, 1);
  for (int y = 0; y < 9; ++y) {
    for (int x = 0; x < 11; ++x) {
      double sum = 0.0;
      for (int j = -2; j <= 2; ++j) {
        for (int i = -2; i <= 2; ++i) {
          sum += static_cast<double>(
              image.at<float>(std::clamp(y + j, 0, 8), std::clamp(x + i, 0, 10)));
        }
      }
      EXPECT_NEAR(blurred.at<float>(y, x), sum / 25.0, 1e-6);
    }
  }
}

}  // namespace
}  // namespace weft::synth
