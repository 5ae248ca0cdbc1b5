#include "tools/weft/keys.hpp"

#include <poll.h>
#include <unistd.h>

namespace weft {

Keys::Keys() : terminal_(isatty(STDIN_FILENO) != 0) {
  if (!terminal_) return;
  tcgetattr(STDIN_FILENO, &before_);
  termios raw = before_;
  raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
  tcsetattr(STDIN_FILENO, TCSANOW, &raw);
}

Keys::~Keys() {
  if (terminal_) tcsetattr(STDIN_FILENO, TCSANOW, &before_);
}

char Keys::next() {
  if (ended_) return kEnd;
  pollfd in{STDIN_FILENO, POLLIN, 0};
  if (poll(&in, 1, 0) <= 0) return 0;
  char text = 0;
  if (read(STDIN_FILENO, &text, 1) <= 0) {
    ended_ = true;
    return kEnd;
  }
  if (text != '\033') return text;
  char rest[2] = {};
  if (poll(&in, 1, 10) <= 0 || read(STDIN_FILENO, rest, 2) != 2 || rest[0] != '[') return text;
  return rest[1] == 'A' ? 'k' : rest[1] == 'B' ? 'j' : text;
}

}  // namespace weft
