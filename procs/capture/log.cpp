#include "procs/capture/log.hpp"

#include "base/error.hpp"
#include "stage/log.hpp"
#include "weft/status_t.hpp"

namespace weft::capture_process {

LogResult write_log(stage::Source& source, const std::string& path, const LogOptions& options,
                    const std::function<void(const LogResult&)>& progress,
                    const std::stop_token& stop) {
  if (!(options.rate_hz > 0.0)) throw Error("a log needs a rate above 0 Hz");
  stage::SourceRunner runner(source, {options.camera, options.session, {}});
  stage::LogWriter log(path);
  LogResult result;
  while (options.count == 0 || result.frames < options.count) {
    const auto utime =
        options.start_utime +
        static_cast<std::int64_t>(static_cast<double>(result.frames) * 1e6 / options.rate_hz);
    const auto answer = runner.next(utime, stop);
    if (!answer) break;
    for (const auto& message : answer->messages) {
      log.write(answer->header.utime, message.channel, message.bytes);
      result.bytes += static_cast<std::int64_t>(message.bytes.size());
      ++result.messages;
    }
    if (answer->status_code == status_t::FAILED)
      result.errors.push_back(runner.counters().last_error);
    ++result.frames;
    if (progress) progress(result);
  }
  log.close();
  return result;
}

}  // namespace weft::capture_process
