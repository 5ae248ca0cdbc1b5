#include "stage/channels.hpp"

#include <set>

namespace weft::stage {
namespace {
constexpr std::size_t kMaxChannelName = 63;  // LCM_MAX_CHANNEL_NAME_LENGTH
}

std::string wire_channel(const ChannelMap& map, const std::string& channel) {
  const auto found = map.find(channel);
  return found == map.end() ? channel : found->second;
}

void add_mapping(ChannelMap& map, const std::string& text) {
  const auto equals = text.find('=');
  if (equals == std::string::npos || equals == 0 || equals + 1 == text.size())
    throw Error("'" + text + "' is no channel mapping; write CHANNEL=OTHER");
  map[text.substr(0, equals)] = text.substr(equals + 1);
}

void check_channels(const ChannelMap& map, const Interface& interface, const std::string& prefix) {
  std::set<std::string> own;
  std::set<std::string> wire;
  std::string known;
  for (const auto* ports : {&interface.inputs, &interface.outputs}) {
    for (const Port& port : *ports) {
      if (!own.insert(port.channel).second)
        throw Error("stage " + interface.name + " declares channel " + port.channel + " twice");
      const std::string name = wire_channel(map, port.channel);
      const std::size_t most = kMaxChannelName - (prefix.empty() ? 0 : prefix.size() + 1) -
                               (port.frames_back > 0 ? std::string(kNoneSuffix).size() : 0);
      if (name.empty() || name.size() > most) {
        throw Error("channel name '" + name + "' of stage " + interface.name + " must have 1 to " +
                    std::to_string(most) + " characters");
      }
      if (!wire.insert(name).second) {
        throw Error("two channels of stage " + interface.name + " are both mapped to " + name +
                    "; give each a name of its own");
      }
      known += (known.empty() ? "" : ", ") + port.channel;
    }
  }
  for (const auto& [channel, other] : map) {
    if (!own.contains(channel)) {
      throw Error("stage " + interface.name + " has no channel " + channel + " to map to " + other +
                  "; it has " + known);
    }
  }
}

}  // namespace weft::stage
