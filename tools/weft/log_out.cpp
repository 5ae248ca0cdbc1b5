#include "tools/weft/log_out.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <filesystem>

#include "base/error.hpp"

namespace weft {
namespace {

namespace fs = std::filesystem;

std::string checked(const std::string& path, const std::vector<std::string>& inputs) {
  for (const auto& input : inputs) {
    std::error_code ignored;
    if (fs::equivalent(path, input, ignored))
      throw Error(path + ": is the log that is read; a log is never changed, give another --out");
  }
  if (const auto folder = fs::path(path).parent_path(); !folder.empty())
    fs::create_directories(folder);
  return path + ".part-" + std::to_string(getpid());
}

}  // namespace

LogOut::LogOut(const std::string& path, const std::vector<std::string>& inputs)
    : path_(path), part_(checked(path, inputs)), writer_(part_) {}

LogOut::~LogOut() {
  if (!committed_) unlink(part_.c_str());
}

void LogOut::write(std::int64_t timestamp_us, const std::string& channel,
                   const std::vector<std::uint8_t>& data) {
  writer_.write(timestamp_us, channel, data);
  ++events_;
}

void LogOut::commit() {
  writer_.close();
  const int file = open(part_.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0 || fsync(file) != 0) {
    if (file >= 0) close(file);
    throw Error(part_ + ": cannot be put on the disk");
  }
  close(file);
  fs::rename(part_, path_);
  committed_ = true;
}

}  // namespace weft
