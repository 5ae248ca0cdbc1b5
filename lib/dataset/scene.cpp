#include "dataset/scene.hpp"

#include <filesystem>

#include "base/error.hpp"
#include "dataset/iri.hpp"
#include "dataset/readers.hpp"

namespace weft::dataset {
namespace {

namespace fs = std::filesystem;

class OneScan : public Dataset {
 public:
  OneScan(std::string colour_or_pcd, std::string depth, DatasetOptions options)
      : first_(std::move(colour_or_pcd)), depth_(std::move(depth)), options_(std::move(options)) {
    names_ = {scan_name(first_)};
  }
  const std::vector<std::string>& names() const override { return names_; }
  Scene read(std::size_t index) const override {
    const std::string& name = names_.at(index);
    return depth_.empty() ? read_cloud(first_, options_)
                          : read_pair(name, first_, depth_, options_);
  }

 private:
  std::string first_, depth_;
  DatasetOptions options_;
  std::vector<std::string> names_;
};

}  // namespace

void DatasetOptions::validate() const {
  validate_fields(*this, "DatasetOptions");
  if (registration_offset_px.size() == 1)
    throw Error("DatasetOptions: registration_offset_px needs x and y, or nothing");
}

std::unique_ptr<Dataset> open_dataset(const std::string& folder, const DatasetOptions& options) {
  options.validate();
  if (!fs::is_directory(folder)) throw Error(folder + ": is not a folder");
  if (is_iri(folder)) return open_iri(folder);
  if (auto set = open_ctu(folder)) return set;
  if (auto set = open_pairs(folder, options)) return set;
  if (auto set = open_clouds(folder, options)) return set;
  throw Error(
      folder +
      ": no scans found. Looked for the IRI layout (png/, pcd/, annotations/), cloA*.yaml "
      "(CTU), pairs (*_rgb.png + *_depth.png, *.color.jpg + *.depth.png, rgb/ + depth/) and "
      "organised clouds (*.pcd)");
}

std::unique_ptr<Dataset> open_scan(const std::string& colour_or_pcd, const std::string& depth,
                                   const DatasetOptions& options) {
  options.validate();
  return std::make_unique<OneScan>(colour_or_pcd, depth, options);
}

}  // namespace weft::dataset
