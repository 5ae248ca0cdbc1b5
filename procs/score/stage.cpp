#include "procs/score/stage.hpp"

#include "base/options.hpp"
#include "detector/part_scorer.hpp"
#include "messages/candidates.hpp"
#include "messages/maps.hpp"
#include "messages/prior.hpp"
#include "messages/words.hpp"

namespace weft::score_process {
namespace {

struct StageOptions {
  std::string model = "../models/parts-sift/score.blob";
  std::vector<std::string> words = {"WORDS_SIFT"};
  int threads = 0;
  detector::ScoreOptions score;

  void visit(OptionVisitor& v) {
    v.field("model", model, "model file, relative to this file");
    v.field("words", words, "channels of the words, in the order of the model's descriptors");
    v.field("threads", threads, {0, 256}, "", "0: one for each core; the answer is the same");
    score.visit(v);
  }
  void validate() const {
    validate_fields(*this, "ScoreOptions");
    score.validate();
  }
};

class ScoreStage : public stage::Stage {
 public:
  ScoreStage(const StageOptions& options, detector::ScoreModel model)
      : options_(options), model_(std::move(model)) {
    interface_.name = "score";
    for (std::size_t i = 0; i < options_.words.size(); ++i)
      interface_.inputs.push_back(
          stage::port<words_t>(options_.words[i], model_.blocks[i].vocabulary_hash));
    interface_.inputs.push_back(stage::port<image_prior_t>("IMAGE_PRIOR"));
    interface_.outputs = {stage::port<part_candidates_t>("PART_CANDIDATES"),
                          stage::port<probability_map_t>("PROBABILITY_MAP")};
    // Neither the place of the model file nor the number of threads decides the answer.
    auto hashed = options_;
    hashed.model.clear();
    hashed.threads = 0;
    interface_.settings_hash = options_hash(hashed);
    interface_.model_hash = model_.hash;
  }

  const stage::Interface& interface() const override { return interface_; }

  void process(const stage::Inputs& inputs, stage::Outputs& outputs) override {
    const auto nothing = [&](const status_t& status) {
      outputs.nothing(static_cast<stage::Reason>(status.reason), status.text);
    };
    std::vector<bovw::WordGrid> grids;
    for (const auto& channel : options_.words) {
      const auto& message = inputs.get<words_t>(channel);
      if (message.status.code == status_t::NOTHING) return nothing(message.status);
      grids.push_back(messages::from_message(message));
    }
    const auto& prior_message = inputs.get<image_prior_t>("IMAGE_PRIOR");
    if (prior_message.status.code == status_t::NOTHING) return nothing(prior_message.status);
    const auto prior = messages::from_message(prior_message);
    std::vector<const bovw::WordGrid*> pointers;
    for (const auto& grid : grids) pointers.push_back(&grid);
    const auto scores = detector::score_parts(model_, pointers, prior.parts, prior.mode,
                                              options_.score, options_.threads);
    auto& candidates = outputs.at<part_candidates_t>("PART_CANDIDATES");
    messages::to_message(scores.candidates, model_.hash, candidates);
    messages::to_message(scores.maps, grids.front(),
                         outputs.at<probability_map_t>("PROBABILITY_MAP"));
    if (scores.maps.empty())
      return outputs.nothing(stage::Reason::kNotSearched, "the prior ruled every part out");
    if (scores.candidates.empty()) {
      // The map is an answer all the same.
      candidates.status.code = status_t::NOTHING;
      candidates.status.reason = static_cast<std::int16_t>(stage::Reason::kNothingFound);
      candidates.status.text = "no peak of a probability map is high enough";
    }
  }

 private:
  StageOptions options_;
  detector::ScoreModel model_;
  stage::Interface interface_;
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  StageOptions options;
  settings.read(options);
  auto model = detector::ScoreModel::read(settings.path(options.model));
  if (model.blocks.size() != options.words.size()) {
    throw Error(settings.name() + ": words: the model wants " +
                std::to_string(model.blocks.size()) + " channels");
  }
  return std::make_unique<ScoreStage>(options, std::move(model));
}

std::string settings_reference() { return options_to_yaml(StageOptions{}); }

}  // namespace weft::score_process
