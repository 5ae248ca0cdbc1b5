#include "train/vocabulary.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/settings.hpp"
#include "base/text_file.hpp"
#include "dataset/readers.hpp"

namespace weft::train {
namespace fs = std::filesystem;

std::vector<std::string> colour_pictures(const std::string& folder) {
  std::error_code error;
  fs::recursive_directory_iterator files(folder, error);
  if (error) throw Error(folder + ": cannot be opened as a folder");
  std::vector<std::string> out;
  for (const auto& entry : files) {
    const auto kind = entry.path().extension();
    const auto parent = entry.path().parent_path().filename();
    if ((kind == ".png" || kind == ".jpg") &&
        (parent == "rgb" || parent == "images" || parent == "png")) {
      out.push_back(entry.path().string());
    }
  }
  if (out.empty()) {
    throw Error(folder +
                ": no .png or .jpg pictures in folders named rgb, images or png; `weft synth "
                "sequences` makes such a set");
  }
  std::sort(out.begin(), out.end());
  return out;
}

void train_vocabulary(const std::vector<std::string>& folders, const std::string& out,
                      const VocabularyTraining& training,
                      const std::function<void(int done, int total)>& report) {
  training.validate();
  std::vector<std::string> files;
  nlohmann::ordered_json sets = nlohmann::ordered_json::array();
  for (const auto& folder : folders) {
    const auto all = colour_pictures(folder);
    for (std::size_t i = 0; i < all.size(); i += static_cast<std::size_t>(training.every)) {
      files.push_back(all[i]);
    }
    // How the set was made, where it says so.
    sets.push_back(nlohmann::ordered_json::parse(read_text_file(fs::path(folder) / "dataset.json"),
                                                 nullptr, false));
    if (sets.back().is_discarded()) sets.back() = nullptr;
  }
  const slam::FeatureExtractor extractor(training.features);
  std::vector<std::vector<slam::Descriptor>> pictures;
  std::size_t descriptors = 0;
  Hash64 hash;
  for (std::size_t i = 0; i < files.size(); ++i) {
    rgbd::RgbdFrame frame;
    frame.source = files[i];
    frame.colour = dataset::read_colour_image(files[i]);
    frame.camera.width = frame.colour.cols;
    frame.camera.height = frame.colour.rows;
    frame.depth = cv::Mat::zeros(frame.colour.size(), CV_16UC1);
    pictures.emplace_back();
    for (const auto& feature : extractor.extract(frame)) {
      pictures.back().push_back(feature.descriptor);
    }
    descriptors += pictures.back().size();
    for (int v = 0; v < frame.colour.rows; ++v) {
      hash.add(frame.colour.ptr(v), static_cast<std::size_t>(frame.colour.cols) * 3);
    }
    report(static_cast<int>(i + 1), static_cast<int>(files.size()));
  }
  const auto vocabulary = slam::BinaryVocabulary::train(pictures, training.vocabulary);
  fs::create_directories(out);
  const fs::path folder(out);
  vocabulary.write((folder / "vocabulary.blob").string());
  write_text_file(folder / "training.yaml", options_to_yaml(training));
  nlohmann::ordered_json manifest;
  manifest["format"] = "weft-models";
  manifest["version"] = 1;
  manifest["hash"] = to_hex(vocabulary.hash());
  manifest["files"] = {{"vocabulary.blob", fs::file_size(folder / "vocabulary.blob")}};
  manifest["data"] = {{"hash", to_hex(hash.value())},
                      {"pictures", pictures.size()},
                      {"descriptors", descriptors},
                      {"sets", sets}};
  manifest["words"] = vocabulary.words();
  manifest["seeds"] = {{"vocabulary", training.vocabulary.seed}};
  manifest["settings_hash"] = to_hex(options_hash(training));
  manifest["settings"] = "training.yaml";
  write_text_file(folder / "manifest.json", manifest.dump(1) + "\n");
}

int run_train_vocabulary(int argc, char** argv) {
  CLI::App app{"Trains the vocabulary by which the map finds places again.",
               "weft train vocabulary"};
  std::vector<std::string> folders, assignments;
  std::string out, settings_file, kind = "orb";
  bool print = false;
  app.add_option("--pictures", folders,
                 "folders of pictures (weft synth sequences makes one); several may be given");
  app.add_option("--out", out, "folder for the vocabulary");
  app.add_option("--kind", kind, "of the descriptors")->check(CLI::IsMember({"orb"}));
  app.add_option("--settings", settings_file, "YAML file; see --print-settings");
  app.add_option("--set", assignments, "key=value over the settings, e.g. vocabulary.levels=3");
  app.add_flag("--print-settings", print, "print all settings with their defaults and stop");
  try {
    app.parse(argc, argv);
    if (print) {
      std::fputs(options_to_yaml(VocabularyTraining{}).c_str(), stdout);
      return 0;
    }
    if (folders.empty() || out.empty()) throw CLI::RequiredError("--pictures and --out");
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    auto settings = settings_file.empty() ? Settings::empty("command line")
                                          : Settings::from_file(settings_file);
    for (const auto& assignment : assignments) settings.set(assignment);
    VocabularyTraining training;
    settings.read(training);
    train_vocabulary(folders, out, training, [](int done, int total) {
      if (done % 20 == 0 || done == total) std::fprintf(stderr, "pictures %5d / %d\n", done, total);
    });
    std::fprintf(stderr, "vocabulary in %s\n", out.c_str());
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "weft train vocabulary: %s\n", error.what());
    return 1;
  }
}

}  // namespace weft::train
