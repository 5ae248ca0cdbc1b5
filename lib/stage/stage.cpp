#include "stage/stage.hpp"

namespace weft::stage {
namespace {

using Messages = std::vector<std::pair<const Port*, std::shared_ptr<void>>>;

void* find_message(const Messages& messages, const std::string& channel, std::int64_t fingerprint) {
  for (const auto& [port, message] : messages) {
    if (port->channel != channel) continue;
    if (port->type.fingerprint != fingerprint) {
      throw Error("channel " + channel + " carries " + port->type.name +
                  "; the stage asked for another type");
    }
    return message.get();
  }
  throw Error("the stage asked for channel " + channel + ", which its interface does not declare");
}

}  // namespace

const void* Inputs::find(const std::string& channel, std::int64_t fingerprint) const {
  return find_message(messages_, channel, fingerprint);
}

void* Outputs::find(const std::string& channel, std::int64_t fingerprint) {
  return find_message(messages_, channel, fingerprint);
}

void Outputs::nothing(Reason reason, const std::string& text) {
  for (const auto& [port, message] : messages_) {
    weft::status_t& status = port->type.status(message.get());
    if (status.code != weft::status_t::OK) continue;
    status.code = weft::status_t::NOTHING;
    status.reason = static_cast<std::int16_t>(reason);
    status.text = text;
  }
}

}  // namespace weft::stage
