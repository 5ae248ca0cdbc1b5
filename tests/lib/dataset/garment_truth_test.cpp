#include "dataset/garment_truth.hpp"

#include <gtest/gtest.h>

#include "base/error.hpp"

namespace weft::dataset {
namespace {

const std::string kGood =
    R"({"garments": [{"garment": "polo", "position_m": [1, 2, -3.5], "state": "flat", "parts": [)"
    R"({"part": "polo sleeves", "instance": "left", "position_m": [0, 0.5, 1], "seen_share": 0.4}]}]})";

TEST(GarmentTruth, IsRead) {
  const auto truth = parse_garment_truth(kGood, "x");
  ASSERT_EQ(truth.size(), 1u);
  EXPECT_EQ(truth[0].garment, "polo");
  EXPECT_EQ(truth[0].position_world, Eigen::Vector3d(1, 2, -3.5));
  ASSERT_EQ(truth[0].parts.size(), 1u);
  EXPECT_EQ(truth[0].parts[0].part, "polo sleeves");
  EXPECT_EQ(truth[0].parts[0].instance, "left");
  EXPECT_EQ(truth[0].parts[0].position_world, Eigen::Vector3d(0, 0.5, 1));
  EXPECT_EQ(truth[0].parts[0].seen_share, 0.4);
  EXPECT_TRUE(parse_garment_truth(R"({"garments": []})", "x").empty());
}

TEST(GarmentTruth, MistakesAreNamed) {
  const auto refuses = [](const std::string& from, const std::string& to, const std::string& says) {
    std::string text = kGood;
    text.replace(text.find(from), from.size(), to);
    try {
      parse_garment_truth(text, "room/garments.json");
      ADD_FAILURE() << "no error for " << to;
    } catch (const Error& error) {
      const std::string what = error.what();
      EXPECT_EQ(what.rfind("room/garments.json", 0), 0u) << what;
      EXPECT_NE(what.find(says), std::string::npos) << what;
    }
  };
  refuses("]}]}", "", "not valid JSON");
  refuses("\"garments\"", "\"trousers\"", "a list \"garments\" is missing");
  refuses("[1, 2, -3.5]", "[1, 2]", "garment 0: \"position_m\" must be");
  refuses("[1, 2, -3.5]", "[1, 2, 1e9]", "garment 0: \"position_m\" must be");
  refuses("\"polo\"", "7", "garment 0: \"garment\" must be a text");
  refuses("\"left\"", "null", "garment 0, part 0: \"instance\" must be a text");
  refuses("0.4", "1.4", "part 0: \"seen_share\" must be");
  refuses("\"parts\"", "\"pieces\"", "garment 0: a list \"parts\" is missing");
}

}  // namespace
}  // namespace weft::dataset
