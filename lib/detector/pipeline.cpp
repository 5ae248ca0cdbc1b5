#include "detector/pipeline.hpp"

namespace weft::detector {

Detector::Detector(ModelBundle bundle, const DetectorOptions& options)
    : bundle_(std::move(bundle)), options_(options), refiner_(bundle_.refine, options.refine) {
  options_.validate();
  for (const auto& describe : bundle_.describe) {
    descriptors_.push_back(descriptor::make_descriptor(describe.descriptor));
  }
}

DetectorResult Detector::detect(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                                const rgbd::Plane* table, int threads) const {
  std::vector<bovw::WordGrid> grids;
  for (std::size_t i = 0; i < descriptors_.size(); ++i) {
    const auto described =
        bovw::describe_frame(frame, mask, table, bundle_.describe[i], *descriptors_[i], threads);
    grids.push_back(
        bovw::quantise(described, descriptors_[i]->name(), bundle_.vocabularies[i], threads));
  }
  return detect_words(std::move(grids), threads);
}

DetectorResult Detector::detect_words(std::vector<bovw::WordGrid> grids, int threads) const {
  DetectorResult result;
  result.grids = std::move(grids);
  std::vector<const bovw::WordGrid*> pointers;
  for (const auto& grid : result.grids) pointers.push_back(&grid);
  result.priors = evaluate_prior(bundle_.prior, pointers, options_.prior);
  result.scores =
      score_parts(bundle_.score, pointers, result.priors, options_.prior, options_.score, threads);
  result.detections = refiner_.refine(pointers, result.scores.candidates, threads);
  return result;
}

}  // namespace weft::detector
