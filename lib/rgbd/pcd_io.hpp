#pragma once

#include <string>

#include "rgbd/cloud.hpp"

/// PCD v0.7 files (Point Cloud Library). In a library of its own, weft_pcd: PCL's brings half a
/// hundred shared libraries along.
namespace weft::rgbd {

enum class PcdEncoding { kAscii, kBinary, kBinaryCompressed };

/// Reads x, y, z (float) and, when there, rgb or rgba; other fields are skipped. The whole header
/// is checked against the file before anything is allocated by it. A point with a NaN is missing,
/// one with an infinite coordinate is an error. Throws Error naming the file and the reason.
Cloud read_pcd(const std::string& path);
/// The same for a file's bytes; `path` names them in errors.
Cloud parse_pcd(const std::string& bytes, const std::string& path);

/// Writes FIELDS x y z rgb (x y z without colour) as PCL does: rgb packed into a float (binary) or
/// as a number (ASCII). Throws
/// Error when the file cannot be written.
void write_pcd(const std::string& path, const Cloud& cloud, PcdEncoding encoding);

}  // namespace weft::rgbd
