#include "bovw/describe.hpp"

#include <algorithm>
#include <numeric>

#include "base/error.hpp"
#include "base/hash.hpp"

namespace weft::bovw {

Described describe_frame(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                         const rgbd::Plane* table, const DescribeOptions& options,
                         const descriptor::DenseDescriptor& descriptor, int threads) {
  Described described;
  described.view = rgbd::make_view(frame, mask, table, options.view);
  const auto images = rgbd::render_view(frame, mask, described.view);
  const auto grid =
      descriptor::make_grid(described.view.width, described.view.height, options.grid);
  described.field = descriptor.describe(frame, described.view, images, grid, threads);
  return described;
}

WordGrid quantise(const Described& described, const std::string& descriptor_name,
                  const Vocabulary& vocabulary, int threads) {
  const auto& field = described.field;
  if (vocabulary.descriptor() != descriptor_name || vocabulary.dimension() != field.dimension) {
    throw Error("the vocabulary is of " + vocabulary.descriptor() + " in " +
                std::to_string(vocabulary.dimension()) + " dimensions, the descriptors are " +
                descriptor_name + " in " + std::to_string(field.dimension));
  }
  WordGrid words;
  words.descriptor = descriptor_name;
  words.vocabulary_hash = vocabulary.hash();
  words.vocabulary_size = vocabulary.words();
  words.view = described.view;
  words.origin_x = field.grid.origin_x;
  words.origin_y = field.grid.origin_y;
  words.step_px = field.grid.step_px;
  words.columns = field.grid.columns;
  words.rows = field.grid.rows;
  words.cells.reserve(field.state.size());
  for (const auto state : field.state) {
    words.cells.push_back(state == descriptor::PointState::kOutsideMask ? WordGrid::kOutsideMask
                                                                        : WordGrid::kNoWord);
  }
  std::vector<std::int16_t> assigned(field.points.size());
  vocabulary.assign(field.values, assigned, threads);
  for (std::size_t i = 0; i < assigned.size(); ++i)
    words.cells[static_cast<std::size_t>(field.points[i])] = assigned[i];
  return words;
}

void check_settings(const Vocabulary& vocabulary, const DescribeOptions& options) {
  if (vocabulary.settings_hash() == options_hash(options)) return;
  throw Error("the vocabulary of " + vocabulary.descriptor() +
              " was trained with other settings; use those or train again. It has:\n" +
              vocabulary.settings_yaml() + "the settings are:\n" + options_to_yaml(options));
}

void sample_descriptors(const descriptor::DescriptorField& field, int count, Random& random,
                        std::vector<std::uint8_t>& samples) {
  std::vector<std::size_t> order(field.points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  if (static_cast<std::size_t>(std::max(count, 0)) < order.size()) {
    random.shuffle(order.begin(), order.end());
    order.resize(static_cast<std::size_t>(std::max(count, 0)));
    std::sort(order.begin(), order.end());
  }
  const auto size = static_cast<std::size_t>(field.dimension);
  for (const auto i : order) {
    const auto first = field.values.begin() + static_cast<std::ptrdiff_t>(i * size);
    samples.insert(samples.end(), first, first + static_cast<std::ptrdiff_t>(size));
  }
}

}  // namespace weft::bovw
