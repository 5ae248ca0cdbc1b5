#include "procs/refine/stage.hpp"

#include "base/options.hpp"
#include "detector/refiner.hpp"
#include "messages/candidates.hpp"
#include "messages/detections.hpp"
#include "messages/words.hpp"

namespace weft::refine_process {
namespace {

struct RefineOptions {
  std::string model = "../models/parts-sift/refine.blob";
  std::vector<std::string> words = {"WORDS_SIFT"};
  double min_probability = 0.0;
  int threads = 0;
  detector::RefinerOptions refiner;

  void visit(OptionVisitor& v) {
    v.field("model", model, "model file, relative to this file");
    v.field("words", words, "channels of the words, in the order of the model's descriptors");
    v.field("min_probability", min_probability, {0.0, 1.0}, "",
            "weaker detections are not published; 0 publishes all, as an evaluation wants");
    v.field("threads", threads, {0, 256}, "", "0: one for each core; the answer is the same");
    v.group("refiner", refiner);
  }
  void validate() const {
    validate_fields(*this, "RefineOptions");
    refiner.validate();
  }
};

class RefineStage : public stage::Stage {
 public:
  RefineStage(const RefineOptions& options, detector::RefineModel model)
      : options_(options), refiner_(std::move(model), options.refiner) {
    interface_.name = "refine";
    for (std::size_t i = 0; i < options_.words.size(); ++i)
      interface_.inputs.push_back(
          stage::port<words_t>(options_.words[i], refiner_.model().blocks[i].vocabulary_hash));
    interface_.inputs.push_back(stage::port<part_candidates_t>("PART_CANDIDATES"));
    interface_.outputs = {stage::port<part_detections_t>("PART_DETECTIONS")};
    // Neither the place of the model file nor the number of threads decides the answer.
    auto hashed = options_;
    hashed.model.clear();
    hashed.threads = 0;
    interface_.settings_hash = options_hash(hashed);
    interface_.model_hash = refiner_.model().hash;
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
    const auto& candidates_message = inputs.get<part_candidates_t>("PART_CANDIDATES");
    if (candidates_message.status.code == status_t::NOTHING) {
      return nothing(candidates_message.status);
    }
    const auto candidates = messages::from_message(candidates_message);
    std::vector<const bovw::WordGrid*> pointers;
    for (const auto& grid : grids) pointers.push_back(&grid);
    auto detections = refiner_.refine(pointers, candidates, options_.threads);
    std::erase_if(detections, [&](const detector::Detection& d) {
      return d.probability < options_.min_probability;
    });
    messages::to_message(grids.front().view, detections, refiner_.model().hash,
                         outputs.at<part_detections_t>("PART_DETECTIONS"));
    if (detections.empty()) {
      outputs.nothing(stage::Reason::kNothingFound, "no candidate is likely enough");
    }
  }

 private:
  RefineOptions options_;
  detector::Refiner refiner_;
  stage::Interface interface_;
};

}  // namespace

std::unique_ptr<stage::Stage> make_stage(const Settings& settings) {
  RefineOptions options;
  settings.read(options);
  auto model = detector::RefineModel::read(settings.path(options.model));
  if (model.blocks.size() != options.words.size()) {
    throw Error(settings.name() + ": words: the model wants " +
                std::to_string(model.blocks.size()) + " channels");
  }
  return std::make_unique<RefineStage>(options, std::move(model));
}

std::string settings_reference() { return options_to_yaml(RefineOptions{}); }

}  // namespace weft::refine_process
