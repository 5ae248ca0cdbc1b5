#include "bovw/vocabulary.hpp"

#include "base/blob.hpp"
#include "base/error.hpp"
#include "base/hash.hpp"
#include "base/parallel.hpp"

namespace weft::bovw {
namespace {

constexpr std::uint32_t kVersion = 1;

}  // namespace

Vocabulary::Vocabulary(std::string descriptor, int dimension, std::vector<std::uint8_t> centres,
                       std::uint64_t settings_hash, std::string settings_yaml)
    : descriptor_(std::move(descriptor)),
      dimension_(dimension),
      words_(dimension > 0 ? static_cast<int>(centres.size()) / dimension : 0),
      centres_(std::move(centres)),
      settings_hash_(settings_hash),
      settings_yaml_(std::move(settings_yaml)),
      hash_(0),
      nearest_(check()) {
  Hash64 hash;
  hash.add(descriptor_);
  hash.add(settings_hash_);
  hash.add(static_cast<std::uint64_t>(dimension_));
  hash.add(centres_.data(), centres_.size());
  hash_ = hash.value();
}

Nearest Vocabulary::check() const {
  if (descriptor_.empty()) throw Error("a vocabulary needs the name of its descriptor");
  if (dimension_ < 1 || dimension_ > 4096 || words_ < 1 || words_ > 32767 ||
      centres_.size() != static_cast<std::size_t>(words_) * static_cast<std::size_t>(dimension_)) {
    throw Error("vocabulary of " + descriptor_ + ": " + std::to_string(centres_.size()) +
                " values in " + std::to_string(dimension_) +
                " dimensions; expected 1 to 32767 words of 1 to 4096 dimensions");
  }
  return Nearest(centres_, dimension_);
}

Vocabulary Vocabulary::read(const std::string& path) {
  const auto blob = BlobReader::from_file(path, "vocabulary", kVersion);
  const auto dimension = static_cast<int>(blob.integer("dimension", 1, 4096));
  const auto words = static_cast<int>(blob.integer("words", 1, 32767));
  auto centres = blob.values<std::uint8_t>(
      "centres", static_cast<std::size_t>(words) * static_cast<std::size_t>(dimension));
  try {
    return Vocabulary(blob.text("descriptor"), dimension, std::move(centres),
                      static_cast<std::uint64_t>(blob.values<std::int64_t>("settings_hash", 1)[0]),
                      blob.text("settings"));
  } catch (const Error& e) {
    throw Error(path + ": " + e.what());
  }
}

void Vocabulary::write(const std::string& path) const {
  BlobWriter blob("vocabulary", kVersion);
  blob.add("descriptor", descriptor_);
  blob.add("settings", settings_yaml_);
  blob.add_number("settings_hash", static_cast<std::int64_t>(settings_hash_));
  blob.add_number("dimension", static_cast<std::int64_t>(dimension_));
  blob.add_number("words", static_cast<std::int64_t>(words_));
  blob.add("centres", centres_);
  blob.write(path);
}

void Vocabulary::assign(std::span<const std::uint8_t> descriptors, std::span<std::int16_t> words,
                        int threads) const {
  const auto dimension = static_cast<std::size_t>(dimension_);
  if (descriptors.size() != words.size() * dimension) {
    throw Error("vocabulary of " + descriptor_ + ": " + std::to_string(descriptors.size()) +
                " descriptor values are not " + std::to_string(words.size()) + " descriptors of " +
                std::to_string(dimension_));
  }
  std::vector<std::int32_t> found(words.size());
  parallel_for(static_cast<int>(words.size()), threads, [&](int begin, int end) {
    const auto first = static_cast<std::size_t>(begin);
    const auto size = static_cast<std::size_t>(end - begin);
    nearest_.find(descriptors.subspan(first * dimension, size * dimension),
                  std::span(found).subspan(first, size), {});
  });
  for (std::size_t i = 0; i < words.size(); ++i) words[i] = static_cast<std::int16_t>(found[i]);
}

}  // namespace weft::bovw
