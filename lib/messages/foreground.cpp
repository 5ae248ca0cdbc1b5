#include "messages/foreground.hpp"

#include <algorithm>

#include "messages/view.hpp"
#include "stage/stage.hpp"

namespace weft::messages {

using foreground::Foreground;

void to_message(const Foreground& foreground, foreground_t& message) {
  const cv::Mat& mask = foreground.mask;
  if (mask.type() != CV_8UC1 || !mask.isContinuous())
    throw Error("a foreground mask must be 8 bit and continuous");
  message.source = foreground.source == Foreground::Source::kDataset ? foreground_t::SOURCE_DATASET
                                                                     : foreground_t::SOURCE_LIVE;
  message.has_table = foreground.table ? 1 : 0;
  message.table = to_message(foreground.table.value_or(rgbd::Plane{}));
  message.width = mask.cols;
  message.height = mask.rows;
  message.garment_px = 0;
  message.runs.clear();
  const std::uint8_t* at = mask.data;
  const std::uint8_t* end = at + mask.total();
  for (bool garment = false; at != end; garment = !garment) {
    const std::uint8_t* next =
        std::find_if(at, end, [&](std::uint8_t m) { return (m != 0) != garment; });
    const auto run = static_cast<std::int32_t>(next - at);
    message.runs.push_back(run);
    if (garment) message.garment_px += run;
    at = next;
  }
  message.run_count = static_cast<std::int32_t>(message.runs.size());
}

Foreground from_message(const foreground_t& message) {
  const std::string where = "FOREGROUND";
  if (message.source != foreground_t::SOURCE_LIVE && message.source != foreground_t::SOURCE_DATASET)
    throw stage::InvalidInput(where + ": unknown source " + std::to_string(message.source));
  if (message.width < 1 || message.width > 8192 || message.height < 1 || message.height > 8192)
    throw stage::InvalidInput(where + ": a mask of " + std::to_string(message.width) + " x " +
                              std::to_string(message.height) + " px");
  Foreground foreground;
  foreground.source = message.source == foreground_t::SOURCE_DATASET ? Foreground::Source::kDataset
                                                                     : Foreground::Source::kLive;
  if (message.has_table) foreground.table = from_message(message.table, where + ": table");
  const std::int64_t pixels = std::int64_t{message.width} * message.height;
  std::int64_t sum = 0, garment_px = 0;
  for (std::size_t i = 0; i < message.runs.size(); ++i) {
    // Only the first run may be empty: an alternation says the same in one way only.
    if (message.runs[i] < (i == 0 ? 0 : 1) || message.runs[i] > pixels - sum)
      throw stage::InvalidInput(where + ": run " + std::to_string(i) + " of the mask has length " +
                                std::to_string(message.runs[i]));
    sum += message.runs[i];
    if (i % 2) garment_px += message.runs[i];
  }
  if (sum != pixels || garment_px != message.garment_px)
    throw stage::InvalidInput(where + ": the mask's runs add up to " + std::to_string(sum) +
                              " px with " + std::to_string(garment_px) + " garment px");
  foreground.mask.create(message.height, message.width, CV_8UC1);
  std::uint8_t* out = foreground.mask.data;
  for (std::size_t i = 0; i < message.runs.size(); ++i)
    out = std::fill_n(out, message.runs[i], static_cast<std::uint8_t>(i % 2 ? 255 : 0));
  return foreground;
}

}  // namespace weft::messages
