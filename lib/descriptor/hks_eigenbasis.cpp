#include "descriptor/hks_eigenbasis.hpp"

#include <Spectra/MatOp/SparseSymShiftSolve.h>
#include <Spectra/SymEigsShiftSolver.h>
#include <Eigen/Eigenvalues>
#include <Eigen/SparseCore>

#include <algorithm>
#include <cmath>
#include <string>

#include "base/error.hpp"

namespace weft::descriptor {
namespace {

constexpr double kShift = -1e-4;  // 1/mm^2; a flat patch's first eigenvalue is 1e-3

}  // namespace

std::vector<HeatMode> smallest_modes(const SurfaceMesh& mesh, cv::Rect patch, cv::Point centre,
                                     int count) {
  const auto component = mesh.component(patch, centre);
  std::vector<int> numbers(component.size(), -1);
  int size = 0;
  for (std::size_t i = 0; i < component.size(); ++i)
    if (component[i]) numbers[i] = size++;
  const auto number = [&](int x, int y) {
    return numbers[static_cast<std::size_t>((y - patch.y) * patch.width + x - patch.x)];
  };
  Eigen::VectorXd mass = Eigen::VectorXd::Zero(size);
  std::vector<Eigen::Triplet<double>> entries;
  const auto edge = [&](int i, int j, double weight) {
    entries.emplace_back(i, i, weight);
    entries.emplace_back(j, j, weight);
    entries.emplace_back(i, j, -weight);
    entries.emplace_back(j, i, -weight);
  };
  for (int y = patch.y; y + 1 < patch.y + patch.height; ++y) {
    for (int x = patch.x; x + 1 < patch.x + patch.width; ++x) {
      const auto at = mesh.index(x, y);
      const int a = number(x, y), b = number(x + 1, y), c = number(x, y + 1),
                d = number(x + 1, y + 1);
      const double upper = mesh.plane(SurfaceMesh::kUpperMass)[at];
      const double lower = mesh.plane(SurfaceMesh::kLowerMass)[at];
      if (b < 0 || c < 0) continue;
      if (upper > 0 && a >= 0) {
        for (const int i : {a, b, c}) mass[i] += upper;
        edge(a, b, mesh.plane(SurfaceMesh::kTop)[at]);
        edge(a, c, mesh.plane(SurfaceMesh::kLeft)[at]);
      }
      if (lower > 0 && d >= 0) {
        for (const int i : {d, b, c}) mass[i] += lower;
        edge(d, c, mesh.plane(SurfaceMesh::kBottom)[at]);
        edge(d, b, mesh.plane(SurfaceMesh::kRight)[at]);
      }
      edge(b, c, mesh.plane(SurfaceMesh::kDiagonal)[at]);
    }
  }
  for (auto& entry : entries) {
    const double scale = std::sqrt(mass[entry.row()] * mass[entry.col()]);
    entry = {entry.row(), entry.col(), entry.value() / scale};
  }
  Eigen::SparseMatrix<double> laplacian(size, size);
  laplacian.setFromTriplets(entries.begin(), entries.end());
  const int at_centre = number(centre.x, centre.y);
  std::vector<HeatMode> modes;
  const auto collect = [&](const auto& values, const auto& vectors) {
    for (Eigen::Index i = 0; i < values.size(); ++i) {
      modes.push_back({std::max(0.0, values[i]), vectors(at_centre, i) * vectors(at_centre, i)});
    }
  };
  if (size <= 2 * count) {
    const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver{Eigen::MatrixXd(laplacian)};
    const Eigen::Index kept = std::min(size, count);
    collect(Eigen::VectorXd(solver.eigenvalues().head(kept)),
            Eigen::MatrixXd(solver.eigenvectors().leftCols(kept)));
    return modes;
  }
  Spectra::SparseSymShiftSolve<double> inverse(laplacian);
  Spectra::SymEigsShiftSolver<Spectra::SparseSymShiftSolve<double>> solver(inverse, count,
                                                                           2 * count, kShift);
  solver.init();
  solver.compute(Spectra::SortRule::LargestMagn, 1000, 1e-10);
  if (solver.info() != Spectra::CompInfo::Successful) {
    throw Error("HKS: " + std::to_string(count) +
                " eigenpairs of a patch did not converge; ask for fewer or use method: moments");
  }
  collect(Eigen::VectorXd(solver.eigenvalues()), Eigen::MatrixXd(solver.eigenvectors()));
  return modes;
}

}  // namespace weft::descriptor
