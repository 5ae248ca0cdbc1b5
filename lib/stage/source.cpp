#include "stage/source.hpp"

namespace weft::stage {

using weft::status_t;

SourceRunner::SourceRunner(Source& source, SourceRunnerOptions options)
    : source_(source), options_(std::move(options)) {
  const Interface& interface = source_.interface();
  check_channels(options_.channels, interface);
  if (!interface.inputs.empty()) throw Error("source " + interface.name + " declares inputs");
  if (options_.camera.empty() || options_.camera.size() > kMaxNameLength) {
    throw Error("the camera's name '" + options_.camera + "' must have 1 to " +
                std::to_string(kMaxNameLength) + " characters");
  }
}

std::optional<Answer> SourceRunner::next(std::int64_t now_us, const std::stop_token& stop) {
  const Interface& interface = source_.interface();
  weft::header_t header;
  header.utime = now_us;
  header.camera = options_.camera;
  header.session = options_.session;
  header.seq = seq_;
  header.coordinate_frame = "camera";
  const auto make = [&] {
    std::vector<std::pair<const Port*, std::shared_ptr<void>>> messages;
    for (const Port& port : interface.outputs) {
      auto message = port.type.make();
      port.type.header(message.get()) = header;
      messages.emplace_back(&port, std::move(message));
    }
    return messages;
  };
  auto messages = make();
  const auto fail = [&](const Port& port, void* message, Reason reason, const std::string& text) {
    status_t& status = port.type.status(message);
    status.code = status_t::FAILED;
    status.reason = static_cast<std::int16_t>(reason);
    status.text = text;
    counters_.last_error = header.camera + "/" + std::to_string(header.session) + "/" +
                           std::to_string(header.seq) + ": " + text;
  };
  try {
    Outputs outputs(messages);
    if (!source_.next(outputs, stop)) return std::nullopt;
  } catch (const std::exception& e) {
    messages = make();
    for (const auto& [port, message] : messages)
      fail(*port, message.get(), Reason::kSourceError, e.what());
  }
  ++seq_;

  Answer answer;
  for (const auto& [port, message] : messages) {
    const MessageType& type = port->type;
    auto whole = message;
    weft::header_t& own = type.header(whole.get());
    own.camera = header.camera;
    own.session = header.session;
    own.seq = header.seq;
    std::vector<std::shared_ptr<void>> parts{whole};
    auto bytes = type.encode(whole.get());
    if (bytes.size() > kMaxMessageBytes) {
      if (type.split) parts = type.split(whole.get(), kMaxMessageBytes);
      if (!type.split || parts.size() > static_cast<std::size_t>(kMaxParts)) {
        whole = type.make();
        type.header(whole.get()) = own;
        fail(*port, whole.get(), Reason::kTooLarge,
             "the frame takes " + std::to_string(bytes.size()) + " bytes, more than " +
                 (type.split ? std::to_string(kMaxParts) + " messages hold" : "a message holds"));
        parts = {whole};
      }
    }
    const std::string channel = wire_channel(options_.channels, port->channel);
    for (const auto& part : parts) answer.messages.push_back({channel, type.encode(part.get())});
    if (answer.header.camera.empty()) {
      answer.header = type.header(whole.get());
      answer.status_code = type.status(whole.get()).code;
    }
  }
  ++counters_.frames_in;
  counters_.count_answer(answer.status_code);
  return answer;
}

}  // namespace weft::stage
