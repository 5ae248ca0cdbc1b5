#include "messages/prior.hpp"

#include <algorithm>

#include "stage/stage.hpp"

namespace weft::messages {

using detector::PriorMode;

void to_message(const std::vector<detector::PartPrior>& parts, PriorMode mode,
                std::uint64_t model_hash, image_prior_t& message) {
  message.model_hash = static_cast<std::int64_t>(model_hash);
  message.mode = mode == PriorMode::kHard   ? image_prior_t::HARD
                 : mode == PriorMode::kSoft ? image_prior_t::SOFT
                                            : image_prior_t::OFF;
  message.parts.clear();
  for (const auto& part : parts) {
    part_prior_t m;
    m.part = part.part;
    m.probability = part.probability;
    m.threshold = part.threshold;
    m.searched = part.searched;
    message.parts.push_back(std::move(m));
  }
  message.part_count = static_cast<std::int32_t>(message.parts.size());
}

PriorContent from_message(const image_prior_t& message) {
  const auto fail = [](const std::string& what) {
    throw stage::InvalidInput("IMAGE_PRIOR: " + what);
  };
  PriorContent content;
  switch (message.mode) {
    case image_prior_t::OFF:
      content.mode = PriorMode::kOff;
      break;
    case image_prior_t::SOFT:
      content.mode = PriorMode::kSoft;
      break;
    case image_prior_t::HARD:
      content.mode = PriorMode::kHard;
      break;
    default:
      fail("unknown mode " + std::to_string(message.mode));
  }
  for (const auto& m : message.parts) {
    if (std::find(detector::kParts.begin(), detector::kParts.end(), m.part) ==
        detector::kParts.end()) {
      fail("unknown part '" + m.part.substr(0, 64) + "'");
    }
    if (std::any_of(content.parts.begin(), content.parts.end(),
                    [&](const detector::PartPrior& p) { return p.part == m.part; })) {
      fail(m.part + " is named twice");
    }
    if (!(m.probability >= 0.0 && m.probability <= 1.0 && m.threshold >= 0.0 &&
          m.threshold <= 1.0)) {
      fail(m.part + ": probability and threshold must be in 0 to 1");
    }
    content.parts.push_back({m.part, m.probability, m.threshold, m.searched != 0});
  }
  return content;
}

}  // namespace weft::messages
