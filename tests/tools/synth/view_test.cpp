#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "synth/annotate.hpp"
#include "tools/synth/procedural.hpp"

namespace weft::synth {
namespace {

/// Straight down from 0.8 m over the sack, even light from all sides, plain cloth.
ViewRecipe plain_recipe() {
  ViewRecipe v;
  v.camera = {640, 480, 525.0, 525.0, 319.5, 239.5};
  v.pose.origin = Vec3(0.0f, 0.0f, 0.8f);
  v.table.family = "grey";
  v.table.base = Vec3::Constant(0.3f);
  v.table.floor = Vec3::Constant(0.1f);
  v.lighting.sky_base = Vec3::Ones();
  v.placements.resize(1);
  Fabric f;
  f.family = "plain";
  f.base = Vec3(0.5f, 0.4f, 0.3f);
  f.second = f.third = f.trim = f.thread = f.button = f.label = f.label_text = f.cord = f.metal =
      f.inside = f.base;
  v.fabrics = {f};
  return v;
}

struct Rendered {
  Garment garment;
  ViewRecipe recipe;
  std::vector<const Garment*> list;
  std::unique_ptr<ViewScene> scene;
  IdealImages images;

  explicit Rendered(const ViewRecipe& r, Simulation s = test::procedural_sack())
      : garment(prepare_garment(std::move(s))), recipe(r), list{&garment} {
    scene = std::make_unique<ViewScene>(list, recipe);
    images = scene->render(1);
  }
  Rendered(const Rendered&) = delete;
};

TEST(ViewScene, DepthIsThatOfThePlanes) {
  const Rendered r(plain_recipe());
  EXPECT_NEAR(r.images.depth_m.at<float>(10, 10), 0.8f, 1e-5f);
  EXPECT_EQ(r.images.object.at<std::uint8_t>(10, 10), 0);
  // Front at z = 6 mm, seen away from every feature.
  EXPECT_EQ(r.images.object.at<std::uint8_t>(240, 400), 1);
  EXPECT_NEAR(r.images.depth_m.at<float>(240, 400), 0.794f, 2e-5f);
  // The pocket stands off 0.9 mm: pattern (-0.1, 0.085) is world (-0.1, -0.14).
  const int u = 319 - static_cast<int>(0.1 * 525 / 0.794),
            v = 239 + static_cast<int>(0.14 * 525 / 0.794);
  EXPECT_NEAR(r.images.depth_m.at<float>(v, u), 0.7931f, 1e-4f);
  EXPECT_NE(r.images.parts.at<int>(v, u) & 2, 0);
}

TEST(ViewScene, MirroringFlipsEverything) {
  ViewRecipe recipe = plain_recipe();
  const Rendered plain(recipe);
  recipe.mirrored = true;
  const Rendered mirrored(recipe);
  for (const auto& [y, x] : {std::pair(100, 200), std::pair(330, 250), std::pair(240, 600)}) {
    EXPECT_EQ(plain.images.radiance.at<cv::Vec3f>(y, x),
              mirrored.images.radiance.at<cv::Vec3f>(y, 639 - x));
    EXPECT_EQ(plain.images.parts.at<int>(y, x), mirrored.images.parts.at<int>(y, 639 - x));
    EXPECT_EQ(plain.images.depth_m.at<float>(y, x), mirrored.images.depth_m.at<float>(y, 639 - x));
  }
}

TEST(ViewScene, ContactShadowsLieAlongEdgesOnly) {
  ViewRecipe recipe = plain_recipe();
  recipe.pose.forward = Vec3(0.2f, 0.0f, -1.0f).normalized();  // slopes are no dents
  recipe.pose.right =
      recipe.pose.right - recipe.pose.right.dot(recipe.pose.forward) * recipe.pose.forward;
  recipe.pose.right.normalize();
  recipe.pose.down = recipe.pose.forward.cross(recipe.pose.right);
  recipe.pose.origin = -0.8f * recipe.pose.forward;
  const Rendered without(recipe);
  recipe.contact = 1.0f;
  const Rendered with(recipe);
  const auto ratio = [&](int y, int x) {
    return with.images.radiance.at<cv::Vec3f>(y, x)[1] /
           without.images.radiance.at<cv::Vec3f>(y, x)[1];
  };
  int edge = 639;  // the rightmost pixel of cloth in a row
  while (edge > 0 && with.images.object.at<std::uint8_t>(240, edge) == 0) --edge;
  ASSERT_GT(edge, 320);
  ASSERT_LT(edge, 600);
  EXPECT_LT(ratio(240, edge + 1), 0.9f);
  EXPECT_LT(ratio(240, edge + 1), ratio(240, edge + 4));
  EXPECT_GT(ratio(240, edge), 0.98f);
  EXPECT_GT(ratio(240, edge + 20), 0.99f);
  EXPECT_EQ(with.images.depth_m.at<float>(240, edge + 1),
            without.images.depth_m.at<float>(240, edge + 1));
}

TEST(Fabric, MostInsidesAreLikeTheOutside) {
  const auto sack = test::procedural_sack();
  int alike = 0;
  for (int seed = 0; seed < 200; ++seed) {
    Random random(static_cast<std::uint64_t>(seed));
    const Fabric fabric = draw_fabric(random, false, Vec3::Constant(0.3f), sack);
    const Vec3 ratio = fabric.inside.cwiseQuotient(fabric.base);
    alike += ratio.minCoeff() > 0.75f && ratio.maxCoeff() < 1.15f;
    EXPECT_LE(fabric.wrinkle_mm, 70.0f * fabric.wrinkle_scale_m) << "steeper than cloth wrinkles";
  }
  EXPECT_GT(alike, 110);
  EXPECT_LT(alike, 180);
}

TEST(Fabric, WearWrinklesClothAndSparesStiffPieces) {
  const auto sack = test::procedural_sack();
  const Panel body{"front", "front", 0}, collar{"collar_left", "front", 1};
  int folded = 0, spared = 0;
  for (int seed = 0; seed < 40; ++seed) {
    Random random(static_cast<std::uint64_t>(seed)), again(static_cast<std::uint64_t>(seed));
    Fabric fabric = draw_fabric(random, false, Vec3::Constant(0.3f), sack);
    Fabric same = draw_fabric(again, false, Vec3::Constant(0.3f), sack);
    draw_wear(random, fabric);
    draw_wear(again, same);
    EXPECT_EQ(fabric.ease(Material::kFabric, body), 1.0f);
    EXPECT_EQ(fabric.ease(Material::kFabric, collar), fabric.stiff_share);
    EXPECT_EQ(fabric.ease(Material::kPlacket, body), fabric.stiff_share);
    float highest = 0.0f;
    for (int i = 0; i < 400; ++i) {
      const Vec2 p(0.01f * static_cast<float>(i % 20), 0.02f * static_cast<float>(i / 20));
      const float h = fabric.relief_mm(0, p, 1.0f);
      EXPECT_EQ(h, same.relief_mm(0, p, 1.0f));
      highest = std::max(highest, h);
    }
    EXPECT_LE(highest, 1.7f * fabric.wrinkle_mm + fabric.fold_mm + fabric.crease_mm + 1.0f);
    folded += fabric.fold_mm > 0.0f && highest > 0.3f * fabric.fold_mm;
    spared += fabric.stiff_share < 0.3f;
  }
  EXPECT_GT(folded, 20);
  EXPECT_GT(spared, 20);
}

TEST(ViewScene, EvenLightGivesTheAlbedoWithoutNoise) {
  const Rendered r(plain_recipe());
  // Far from the cloth the table sees the whole sky: radiance = albedo x sky radiance.
  for (int x = 10; x < 60; ++x) {
    const auto& p = r.images.radiance.at<cv::Vec3f>(10, x);
    for (int c = 0; c < 3; ++c) EXPECT_NEAR(p[c], 0.3f, 0.3f * 0.03f);
    EXPECT_NEAR(p[0], r.images.radiance.at<cv::Vec3f>(10, x + 1)[0], 1e-4f);
  }
  for (int x = 390; x < 430; ++x) {
    const auto& p = r.images.radiance.at<cv::Vec3f>(240, x);
    EXPECT_NEAR(p[0] / p[2], 0.5f / 0.3f, 0.02f);
    EXPECT_NEAR(p[0], r.images.radiance.at<cv::Vec3f>(240, x + 1)[0], 2e-3f);
  }
}

TEST(ViewScene, ClothShadesTheTableBesideIt) {
  ViewRecipe recipe = plain_recipe();
  recipe.lighting.sky_base = Vec3::Constant(0.05f);
  recipe.lighting.points = {{Vec3(-1.0f, 0.0f, 0.35f), Vec3::Ones()}};
  Simulation high = test::procedural_sack();
  for (auto& p : high.pose) p.z() += 0.1f;
  const Rendered r(recipe, high);
  const float lit = r.images.radiance.at<cv::Vec3f>(240, 150)[0];
  const float shaded = r.images.radiance.at<cv::Vec3f>(240, 480)[0];
  EXPECT_GT(lit, 5.0f * shaded);
}

TEST(ViewScene, ProjectorLeavesAShadow) {
  ViewRecipe recipe = plain_recipe();
  Simulation high = test::procedural_sack();
  for (auto& p : high.pose) p.z() += 0.2f;
  recipe.depth.projector_sign = -1.0f;
  const Rendered r(recipe, high);
  // Cloth 0.2 m over the table, projector 75 mm to the left: shadow right of it, 25 mm wide there.
  int left = 0, right = 0;
  for (int x = 0; x < 640; ++x) {
    if (r.images.shadow.at<std::uint8_t>(240, x) == 0) continue;
    if (r.images.object.at<std::uint8_t>(240, x) != 0) continue;
    (x < 320 ? left : right) += 1;
  }
  EXPECT_EQ(left, 0);
  EXPECT_NEAR(right, 0.075 * 525 / 0.6 - 0.075 * 525 / 0.8, 5.0);
}

TEST(Annotate, PolygonsHoldTheirPixelsAndNoMore) {
  const Rendered r(plain_recipe());
  const Annotation a = annotate(*r.scene, r.images, r.recipe, r.garment.simulation, 0);
  ASSERT_EQ(a.polygons.size(), 2u);
  // The patch: pattern x -0.15..-0.05, y 0.05..0.12 at z = 6.9 mm.
  float low_x = 1e9f, high_x = 0, low_y = 1e9f, high_y = 0;
  for (const auto& p : a.polygons[1].points) {
    low_x = std::min(low_x, p.x);
    high_x = std::max(high_x, p.x);
    low_y = std::min(low_y, p.y);
    high_y = std::max(high_y, p.y);
  }
  const double scale = 525.0 / 0.794;
  EXPECT_NEAR(low_x, 319.5 - 0.15 * scale - 2.5, 1.5);
  EXPECT_NEAR(high_x, 319.5 - 0.05 * scale + 2.5, 1.5);
  EXPECT_NEAR(low_y, 239.5 + (0.225 - 0.12) * scale - 2.5, 1.5);
  EXPECT_NEAR(high_y, 239.5 + (0.225 - 0.05) * scale + 2.5, 1.5);
  EXPECT_FALSE(a.polygons[1].ignore);
  EXPECT_NEAR(a.polygons[1].visible_share, 1.0, 0.02);
  EXPECT_EQ(a.polygons[0].part, "t-shirt collar");
  EXPECT_NEAR(a.polygons[0].visible_share, 1.0, 0.05);  // half of front and back
  EXPECT_EQ(a.labels.at<std::uint8_t>(240, 400), 64);
  EXPECT_EQ(a.labels.at<std::uint8_t>(10, 10), 0);
}

TEST(Annotate, IgnoresWhatIsCutOffOrTooSmall) {
  ViewRecipe recipe = plain_recipe();
  recipe.pose.origin = Vec3(0.0f, -0.45f, 0.8f);  // the collar, at y = 0.225, leaves the frame
  {
    const Rendered r(recipe);
    const Annotation a = annotate(*r.scene, r.images, recipe, r.garment.simulation, 0);
    EXPECT_GT(a.records[0].cut_off_share, 0.9);
    for (const auto& p : a.polygons) EXPECT_EQ(p.ignore, p.part == "t-shirt collar");
  }
  recipe.pose.origin = Vec3(0.0f, 0.0f, 6.0f);
  recipe.mirrored = true;
  const Rendered r(recipe);
  const Annotation a = annotate(*r.scene, r.images, recipe, r.garment.simulation, 0);
  ASSERT_EQ(a.records.size(), 2u);
  EXPECT_EQ(a.records[1].instance, "right");  // left and right change places in a mirror
  EXPECT_TRUE(a.records[1].ignore || !a.records[1].annotated);
}

TEST(Annotate, ToldByTheFace) {
  ViewRecipe recipe = plain_recipe();
  Simulation s = test::procedural_sack();
  for (auto& f : s.faces) std::swap(f[1], f[2]);  // inside out
  const Rendered r(recipe, s);
  const Annotation a = annotate(*r.scene, r.images, recipe, r.garment.simulation, 0);
  EXPECT_EQ(a.labels.at<std::uint8_t>(240, 400), 64 + 128);
  EXPECT_GT(a.records[1].inside_share, 0.99);
  EXPECT_TRUE(a.records[1].ignore);   // a sleeve from its inside
  EXPECT_FALSE(a.records[0].ignore);  // a collar
}

}  // namespace
}  // namespace weft::synth
