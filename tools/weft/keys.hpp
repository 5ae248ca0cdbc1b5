#pragma once

#include <termios.h>

namespace weft {

/// Keys one by one, unseen, where the standard input is a terminal; elsewhere the characters of the
/// standard input. The terminal is as before when this ends.
class Keys {
 public:
  Keys();
  ~Keys();
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;
  /// The next key, 'k' and 'j' for the arrows up and down; 0 when there is none now; kEnd when
  /// there will be none any more.
  static constexpr char kEnd = '\004';
  char next();

 private:
  termios before_{};
  bool terminal_ = false;
  bool ended_ = false;
};

}  // namespace weft
