#pragma once

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "stage/in_process.hpp"

/// One stage under its real runner: messages of a frame in, what it published out.
namespace weft::test {

class OneStage {
 public:
  explicit OneStage(std::shared_ptr<stage::Stage> stage) {
    set_.add(std::move(stage));
    set_.observe([this](const std::string& channel, const std::vector<std::uint8_t>& bytes) {
      published_[channel] = bytes;
    });
  }
  template <class Message>
  void send(const std::string& channel, Message message, std::int64_t seq) {
    message.header = {};  // generated types leave their numbers undefined
    message.header.camera = "camera";
    message.header.seq = seq;
    std::vector<std::uint8_t> bytes(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
    set_.inject(channel, std::move(bytes));
  }
  void run() { set_.run(); }
  /// The latest message on a channel.
  template <class Message>
  Message received(const std::string& channel) {
    Message message{};
    const auto found = published_.find(channel);
    if (found == published_.end()) {
      ADD_FAILURE() << "nothing on " << channel;
      return message;
    }
    const int size = static_cast<int>(found->second.size());
    EXPECT_EQ(message.decode(found->second.data(), 0, size), size);
    return message;
  }

 private:
  stage::InProcess set_;
  std::map<std::string, std::vector<std::uint8_t>> published_;
};

}  // namespace weft::test
