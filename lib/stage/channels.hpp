#pragma once

#include <map>
#include <string>

#include "stage/stage.hpp"

namespace weft::stage {

/// From a channel as the stage knows it to the channel on the wire: {"PART_DETECTIONS",
/// "PART_DETECTIONS@chi2fast"}. What is not in the map keeps its name.
using ChannelMap = std::map<std::string, std::string>;

/// A header_t on CHANNEL + this, sent by the player of a lock-step replay to the readers of a
/// feedback edge: that frame has no message on CHANNEL, and none will come.
inline constexpr const char* kNoneSuffix = ".none";

/// The channel on the wire.
std::string wire_channel(const ChannelMap& map, const std::string& channel);

/// "CHANNEL=OTHER" as on a command line; throws Error when it is not that.
void add_mapping(ChannelMap& map, const std::string& text);

/// Throws Error when the map names a channel the stage does not have, or makes two of its channels
/// one, or a name on the wire is empty or longer than LCM's 63 characters. prefix: of the LCM URL.
void check_channels(const ChannelMap& map, const Interface& interface,
                    const std::string& prefix = "");

}  // namespace weft::stage
