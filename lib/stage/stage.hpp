#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <type_traits>
#include <vector>

#include "base/error.hpp"
#include "weft/header_t.hpp"
#include "weft/status_t.hpp"

/// What a stage is: typed inputs and outputs by channel, and one function from the inputs of a
/// frame to its outputs. The runtime (Runner) joins the inputs by frame, answers for the stage when
/// it cannot answer itself, and keeps the contract: see docs/stage-contract.md.
namespace weft::stage {

/// No message is larger: more does not fit a stock kernel's socket buffer (212,992 bytes).
constexpr std::size_t kMaxMessageBytes = 160'000;
/// Of one frame; 40 MB.
constexpr int kMaxParts = 256;
/// Largest k of a feedback edge.
constexpr int kMaxFramesBack = 100;
/// Characters of a camera's or a coordinate frame's name.
constexpr std::size_t kMaxNameLength = 128;

/// Reason codes of status_t. Never renumber.
enum class Reason : std::int16_t {
  kNone = 0,
  kInternalError = 1,   // the stage threw
  kInvalidInput = 2,    // decodable, but impossible content
  kUpstreamFailed = 3,  // an input's own status was FAILED, DROPPED or MISSING_INPUT
  kDeadline = 4,        // an input did not arrive in time
  kLate = 5,            // dropped by a stage that was behind
  kTooLarge = 6,        // the answer does not fit a message
  kSourceError = 7,     // the source could not read this frame
  kNoGarment = 20,      // the mask is empty
  kNoTable = 21,        // no table plane was found
  kNoWords = 22,        // no grid point carries a word
  kNothingFound = 23,   // searched, nothing above the threshold
  kNotSearched = 24,    // the image-level prior ruled every part out
  kNoPlane = 25,        // neither plane nor cylinder in the depth image
  kNotTracked = 26,     // where the camera is is not known
  kNoKeyFrame = 27,     // the frame does not become part of the map
  kNothingNew = 28,     // the reader has the whole map already
};

/// Impossible content of a message that decoded: the runtime counts it and answers FAILED.
class InvalidInput : public Error {
 public:
  using Error::Error;
};

/// A message type with its functions erased, so that the runtime is no template. Every message type
/// has the fields header and status first.
struct MessageType {
  std::string name;
  std::int64_t fingerprint = 0;
  /// nullptr when the bytes do not decode completely.
  std::function<std::shared_ptr<void>(const std::uint8_t* data, int size)> decode;
  std::function<std::vector<std::uint8_t>(const void* message)> encode;
  std::function<std::shared_ptr<void>()> make;
  weft::header_t& (*header)(void* message) = nullptr;
  weft::status_t& (*status)(void* message) = nullptr;
  /// Large messages travel as numbered parts; null for types that do not.
  int (*part_index)(const void* message) = nullptr;
  int (*part_count)(const void* message) = nullptr;
  /// Puts the parts, complete and in order, together as one message.
  std::shared_ptr<void> (*join)(const std::vector<std::shared_ptr<void>>& parts) = nullptr;
  /// Cuts a message into parts that encode to at most max_bytes each.
  std::vector<std::shared_ptr<void>> (*split)(const void* message, std::size_t max_bytes) = nullptr;
};

template <class Message>
concept Partitioned = requires(const Message& m) {
  m.part_index;
  m.part_count;
  m.data;
};

template <class Message>
MessageType message_type() {
  MessageType type;
  type.name = Message::getTypeName();
  type.fingerprint = static_cast<std::int64_t>(Message::getHash());
  type.decode = [](const std::uint8_t* data, int size) -> std::shared_ptr<void> {
    auto message = std::make_shared<Message>();
    return message->decode(data, 0, size) == size ? message : nullptr;
  };
  type.encode = [](const void* message) {
    const auto& m = *static_cast<const Message*>(message);
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(m.getEncodedSize()));
    if (m.encode(bytes.data(), 0, static_cast<int>(bytes.size())) < 0)
      throw Error("cannot encode a message");
    return bytes;
  };
  type.make = [] { return std::static_pointer_cast<void>(std::make_shared<Message>()); };
  type.header = [](void* message) -> weft::header_t& {
    return static_cast<Message*>(message)->header;
  };
  type.status = [](void* message) -> weft::status_t& {
    return static_cast<Message*>(message)->status;
  };
  if constexpr (Partitioned<Message>) {
    type.make = []() -> std::shared_ptr<void> {
      auto message = std::make_shared<Message>();
      message->part_count = 1;
      return message;
    };
    type.part_index = [](const void* m) {
      return static_cast<int>(static_cast<const Message*>(m)->part_index);
    };
    type.part_count = [](const void* m) {
      return static_cast<int>(static_cast<const Message*>(m)->part_count);
    };
    type.join = [](const std::vector<std::shared_ptr<void>>& parts) -> std::shared_ptr<void> {
      auto whole = std::make_shared<Message>(*std::static_pointer_cast<Message>(parts.front()));
      for (std::size_t i = 1; i < parts.size(); ++i) {
        const auto& data = std::static_pointer_cast<Message>(parts[i])->data;
        whole->data.insert(whole->data.end(), data.begin(), data.end());
      }
      whole->part_index = 0;
      whole->part_count = 1;
      whole->data_size = static_cast<std::int32_t>(whole->data.size());
      return whole;
    };
    type.split = [](const void* message, std::size_t max_bytes) {
      const auto& whole = *static_cast<const Message*>(message);
      Message part = whole;
      part.data.clear();
      part.data_size = 0;
      const auto overhead = static_cast<std::size_t>(part.getEncodedSize());
      if (overhead >= max_bytes) throw Error("a message does not fit even without its data");
      const std::size_t step = max_bytes - overhead;
      const std::size_t size = whole.data.size();
      part.part_count = static_cast<std::int32_t>(size == 0 ? 1 : (size + step - 1) / step);
      std::vector<std::shared_ptr<void>> parts;
      for (std::size_t begin = 0; begin == 0 || begin < size; begin += step) {
        const auto first = whole.data.begin() + static_cast<std::ptrdiff_t>(begin);
        part.part_index = static_cast<std::int32_t>(parts.size());
        part.data.assign(first, first + static_cast<std::ptrdiff_t>(std::min(step, size - begin)));
        part.data_size = static_cast<std::int32_t>(part.data.size());
        parts.push_back(std::make_shared<Message>(part));
      }
      return parts;
    };
  }
  return type;
}

struct Port {
  std::string channel;  // as the stage knows it; a process set may map it to another
  MessageType type;
  /// 0: the message of frame n itself. k: an input that is the message of frame n - k of the same
  /// camera and session, so that stages can read each other's outputs without a circle to wait in.
  int frames_back = 0;
  /// Of an input: model_hash of the stage that must make its messages, as words must come from the
  /// vocabulary that a model was trained with. 0: any.
  std::uint64_t maker_model_hash = 0;
};

template <class Message>
Port port(std::string channel, std::uint64_t maker_model_hash = 0) {
  return {std::move(channel), message_type<Message>(), 0, maker_model_hash};
}

/// An input over a feedback edge; read with Inputs::feedback. frames_back: 1 to kMaxFramesBack.
template <class Message>
Port feedback_port(std::string channel, int frames_back) {
  if (frames_back < 1 || frames_back > kMaxFramesBack) {
    throw Error("feedback on channel " + channel + " is " + std::to_string(frames_back) +
                " frames back; expected 1 to " + std::to_string(kMaxFramesBack));
  }
  return {std::move(channel), message_type<Message>(), frames_back, 0};
}

/// What the runtime must know about a stage before it runs.
struct Interface {
  std::string name;           // of the stage; a process set may rename the instance
  std::vector<Port> inputs;   // all but feedback are needed for an answer
  std::vector<Port> outputs;  // each is answered for each frame
  std::uint64_t settings_hash = 0;
  std::uint64_t model_hash = 0;
  bool stateful = false;  // frames must be processed in order of seq
};

/// The complete inputs of one frame, by channel as the stage knows it. Their status is OK or
/// NOTHING. Of a feedback edge there may be no message.
class Inputs {
 public:
  Inputs(const weft::header_t& header,
         std::vector<std::pair<const Port*, std::shared_ptr<void>>> messages)
      : header_(header), messages_(std::move(messages)) {}
  const weft::header_t& header() const { return header_; }
  template <class Message>
  const Message& get(const std::string& channel) const {
    const auto* message = feedback<Message>(channel);
    if (!message) throw Error("there is no message on channel " + channel + " for this frame");
    return *message;
  }
  /// Null when there is none: see docs/stage-contract.md. Its header tells of which frame it is.
  template <class Message>
  const Message* feedback(const std::string& channel) const {
    return static_cast<const Message*>(
        find(channel, static_cast<std::int64_t>(Message::getHash())));
  }

 private:
  const void* find(const std::string& channel, std::int64_t fingerprint) const;
  const weft::header_t& header_;
  std::vector<std::pair<const Port*, std::shared_ptr<void>>> messages_;
};

/// The answers of one frame: made by the runtime with the frame's header and status OK, filled in
/// by the stage.
class Outputs {
 public:
  explicit Outputs(std::vector<std::pair<const Port*, std::shared_ptr<void>>> messages)
      : messages_(std::move(messages)) {}
  template <class Message>
  Message& at(const std::string& channel) {
    return *static_cast<Message*>(find(channel, static_cast<std::int64_t>(Message::getHash())));
  }
  /// Sets the status of every output whose status is still OK.
  void nothing(Reason reason, const std::string& text);

 private:
  void* find(const std::string& channel, std::int64_t fingerprint);
  std::vector<std::pair<const Port*, std::shared_ptr<void>>> messages_;
};

class Stage {
 public:
  virtual ~Stage() = default;
  virtual const Interface& interface() const = 0;
  /// Answers one frame. A pure function of the inputs (and, when stateful, of those before): no
  /// clock, no I/O, no unseeded random. Throws InvalidInput for impossible content and Error for
  /// what it cannot do; the runtime then answers FAILED on every output.
  virtual void process(const Inputs& inputs, Outputs& outputs) = 0;
};

}  // namespace weft::stage
