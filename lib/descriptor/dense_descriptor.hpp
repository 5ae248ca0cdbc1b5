#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/options.hpp"
#include "base/simd.hpp"
#include "descriptor/finddd_options.hpp"
#include "descriptor/fpfh_options.hpp"
#include "descriptor/gdh_options.hpp"
#include "descriptor/hks_options.hpp"
#include "descriptor/sift_options.hpp"
#include "rgbd/view.hpp"

/// Descriptors of every point of a regular grid over a view.
namespace weft::descriptor {

struct GridOptions {
  int step_px = 6;
  int border_px = 6;

  void visit(OptionVisitor& v) {
    v.field(
        "step_px", step_px, {1, 64}, "px",
        "distance of grid points in the view; garment-parts.txt section 5.1 samples every 6 px");
    v.field(
        "border_px", border_px, {0, 256}, "px",
        "first grid point from the view's left and top edge; 6 gives 105 x 78 points at 640x480");
  }
  void validate() const { validate_fields(*this, "GridOptions"); }
};

/// Grid points stand on whole pixels. All descriptors of a frame share one grid, so that their
/// words can be combined cell by cell.
struct Grid {
  int origin_x = 0;  // view px of the first point
  int origin_y = 0;
  int step_px = 6;
  int columns = 0;
  int rows = 0;

  int x(int column) const { return origin_x + column * step_px; }
  int y(int row) const { return origin_y + row * step_px; }
  std::size_t cells() const {
    return static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows);
  }
};

/// floor((size - 1 - 2 border) / step) + 1 points along each side, none when the view is too small.
Grid make_grid(int width_px, int height_px, const GridOptions& options);

enum class PointState : std::uint8_t {
  kOutsideMask,
  kNothing,  // inside the mask, but nothing to describe: no contrast, a hole in the depth
  kDescribed,
};

/// The descriptors of a grid.
struct DescriptorField {
  Grid grid;
  int dimension = 0;
  std::vector<PointState> state;     // grid.cells(), row-major
  std::vector<std::int32_t> points;  // cell indices of the described points, ascending
  std::vector<std::uint8_t> values;  // points.size() * dimension
};

/// A descriptor of fixed length, 8 bit a value, for grid points inside the mask. Class A: the same
/// bits on every machine, SIMD path and thread count.
class DenseDescriptor {
 public:
  virtual ~DenseDescriptor() = default;
  /// "sift", "fpfh", ...
  virtual const std::string& name() const = 0;
  virtual int dimension() const = 0;
  /// What describe() looks at. A frame may come without the other.
  virtual bool uses_colour() const = 0;
  bool uses_depth() const { return !uses_colour(); }
  /// images are those of `view`, frame the sensor frame the view was rendered from (descriptors of
  /// depth need its cloud). threads < 1: one for each core. Throws Error when the images do not fit
  /// the view.
  virtual DescriptorField describe(const rgbd::RgbdFrame& frame, const rgbd::View& view,
                                   const rgbd::ViewImages& images, const Grid& grid,
                                   int threads) const = 0;
};

struct DescriptorOptions {
  enum class Kind { kSift, kGdh, kFinddd, kFpfh, kHks };
  Kind kind = Kind::kSift;
  SiftOptions sift;
  GdhOptions gdh;
  FindddOptions finddd;
  FpfhOptions fpfh;
  HksOptions hks;

  void visit(OptionVisitor& v) {
    v.choice("kind", kind,
             {{"sift", Kind::kSift},
              {"gdh", Kind::kGdh},
              {"finddd", Kind::kFinddd},
              {"fpfh", Kind::kFpfh},
              {"hks", Kind::kHks}},
             "which descriptor; its options are in the group of its name, the only one there is");
    // A group of another kind would decide nothing, but change the hash of the settings.
    if (kind == Kind::kSift) v.group("sift", sift);
    if (kind == Kind::kGdh) v.group("gdh", gdh);
    if (kind == Kind::kFinddd) v.group("finddd", finddd);
    if (kind == Kind::kFpfh) v.group("fpfh", fpfh);
    if (kind == Kind::kHks) v.group("hks", hks);
  }
  void validate() const {
    validate_fields(*this, "DescriptorOptions");
    if (kind == Kind::kSift) sift.validate();
    if (kind == Kind::kGdh) gdh.validate();
    if (kind == Kind::kFinddd) finddd.validate();
    if (kind == Kind::kFpfh) fpfh.validate();
    if (kind == Kind::kHks) hks.validate();
  }
};

/// path: which kernels run; only tests choose one.
std::unique_ptr<DenseDescriptor> make_descriptor(const DescriptorOptions& options,
                                                 SimdPath path = SimdPath::kAuto);

}  // namespace weft::descriptor
