#include "detector/model.hpp"

#include <fstream>
#include <nlohmann/json.hpp>

#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/settings.hpp"

namespace weft::detector {
namespace {

bool same(const std::vector<HistogramBlock>& a, const std::vector<HistogramBlock>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const HistogramBlock& x, const HistogramBlock& y) {
                      return x.descriptor == y.descriptor && x.words == y.words &&
                             x.vocabulary_hash == y.vocabulary_hash;
                    });
}

}  // namespace

std::string vocabulary_file(const std::string& descriptor) {
  return "vocabulary-" + descriptor + ".blob";
}

ModelBundle ModelBundle::read(const std::string& folder) {
  ModelBundle bundle;
  bundle.score = ScoreModel::read(folder + "/" + kScoreFile);
  bundle.refine = RefineModel::read(folder + "/" + kRefineFile);
  bundle.prior = PriorModel::read(folder + "/" + kPriorFile);
  const auto mixed = [&](const std::string& file) {
    throw Error(folder + "/" + file + " was made with other vocabularies than " + kScoreFile +
                "; take all files of one training run");
  };
  if (!same(bundle.score.blocks, bundle.refine.blocks)) mixed(kRefineFile);
  if (!same(bundle.score.blocks, bundle.prior.blocks)) mixed(kPriorFile);
  Hash64 hash;
  for (const auto& block : bundle.score.blocks) {
    const auto file = vocabulary_file(block.descriptor);
    bundle.vocabularies.push_back(bovw::Vocabulary::read(folder + "/" + file));
    const auto& vocabulary = bundle.vocabularies.back();
    if (vocabulary.descriptor() != block.descriptor || vocabulary.words() != block.words ||
        vocabulary.hash() != block.vocabulary_hash) {
      mixed(file);
    }
    bovw::DescribeOptions options;
    Settings::from_text(vocabulary.settings_yaml(), folder + "/" + file).read(options);
    bovw::check_settings(vocabulary, options);
    bundle.describe.push_back(options);
    hash.add(vocabulary.hash());
  }
  hash.add(bundle.score.hash);
  hash.add(bundle.refine.hash);
  hash.add(bundle.prior.hash);
  bundle.hash = hash.value();

  const auto path = folder + "/" + kManifestFile;
  std::ifstream in(path);
  if (!in) throw Error("cannot read " + path + "; every model folder has one");
  const auto manifest = nlohmann::json::parse(in, nullptr, false);
  if (!manifest.is_object() || !manifest.contains("hash") || !manifest["hash"].is_string()) {
    throw Error(path + ": not a manifest: an object with the key 'hash' was expected");
  }
  if (manifest["hash"] != to_hex(bundle.hash)) {
    throw Error(path + ": the manifest belongs to models " + manifest["hash"].get<std::string>() +
                ", but the files here are " + to_hex(bundle.hash) +
                "; take all files of one training run");
  }
  return bundle;
}

}  // namespace weft::detector
