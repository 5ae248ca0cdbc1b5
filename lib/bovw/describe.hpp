#pragma once

#include <cstdint>
#include <vector>

#include "base/options.hpp"
#include "base/random.hpp"
#include "bovw/vocabulary.hpp"
#include "bovw/word_grid.hpp"
#include "descriptor/dense_descriptor.hpp"
#include "rgbd/view.hpp"

namespace weft::bovw {

/// Everything that decides a frame's descriptors. A vocabulary keeps the hash of those it was
/// trained with.
struct DescribeOptions {
  rgbd::ViewOptions view;
  descriptor::GridOptions grid;
  descriptor::DescriptorOptions descriptor;

  void visit(OptionVisitor& v) {
    v.group("view", view);
    v.group("grid", grid);
    v.group("descriptor", descriptor);
  }
  void validate() const {
    view.validate();
    grid.validate();
    descriptor.validate();
  }
};

struct Described {
  rgbd::View view;
  descriptor::DescriptorField field;
};

/// Makes the view, renders it and describes the grid points inside the mask. mask: CV_8UC1 of the
/// frame's size; table: null when there is none. Throws Error where make_view does.
Described describe_frame(const rgbd::RgbdFrame& frame, const cv::Mat& mask,
                         const rgbd::Plane* table, const DescribeOptions& options,
                         const descriptor::DenseDescriptor& descriptor, int threads);

/// Words of a described frame. Throws Error when the vocabulary is of another descriptor.
WordGrid quantise(const Described& described, const std::string& descriptor_name,
                  const Vocabulary& vocabulary, int threads);

/// Throws Error when the vocabulary was trained with other options than these, showing its own.
void check_settings(const Vocabulary& vocabulary, const DescribeOptions& options);

/// Appends up to `count` descriptors of the field, drawn without replacement, in ascending order of
/// cells.
void sample_descriptors(const descriptor::DescriptorField& field, int count, Random& random,
                        std::vector<std::uint8_t>& samples);

}  // namespace weft::bovw
