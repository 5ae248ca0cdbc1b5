#include "stage/lcm_url.hpp"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <lcm/lcm-cpp.hpp>
#include <sstream>

#include "base/error.hpp"

namespace weft::stage {
namespace {

int number(const std::string& url, const std::string& what, const std::string& text, int low,
           int high) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < low || value > high) {
    throw Error("LCM URL '" + url + "': " + what + " is '" + text + "' but must be a number from " +
                std::to_string(low) + " to " + std::to_string(high));
  }
  return value;
}

}  // namespace

LcmUrl LcmUrl::parse(const std::string& given) {
  std::string url = given;
  if (url.empty()) {
    const char* fallback = std::getenv("LCM_DEFAULT_URL");
    if (fallback) url = fallback;
  }
  LcmUrl result;
  if (url.empty()) return result;
  const auto scheme = url.find("://");
  if (scheme == std::string::npos || scheme == 0) {
    throw Error("LCM URL '" + url +
                "' has no provider; write for example udpm://239.255.76.67:7667?ttl=0");
  }
  result.provider = url.substr(0, scheme);
  if (!result.is_udpm()) {
    result.text = url;
    return result;
  }
  const auto question = url.find('?', scheme);
  const std::string target = url.substr(
      scheme + 3, question == std::string::npos ? std::string::npos : question - scheme - 3);
  if (!target.empty()) {
    const auto colon = target.find(':');
    if (colon != 0) result.group = target.substr(0, colon);
    if (colon != std::string::npos)
      result.port = number(url, "the port", target.substr(colon + 1), 1, 65535);
  }
  in_addr address{};
  if (inet_pton(AF_INET, result.group.c_str(), &address) != 1 ||
      (ntohl(address.s_addr) >> 28) != 0xe) {
    throw Error("LCM URL '" + url + "': the group '" + result.group +
                "' is no multicast address (224.0.0.0 to 239.255.255.255)");
  }
  if (question == std::string::npos) return result;
  std::istringstream options(url.substr(question + 1));
  for (std::string option; std::getline(options, option, '&');) {
    const auto equals = option.find('=');
    const std::string key = option.substr(0, equals);
    const std::string value = equals == std::string::npos ? "" : option.substr(equals + 1);
    if (key == "ttl") {
      result.ttl = number(url, "ttl", value, 0, 255);
    } else if (key == "recv_buf_size") {
      result.recv_buf_size = number(url, "recv_buf_size", value, 4096, 1 << 30);
    } else {
      throw Error("LCM URL '" + url + "': unknown option '" + option +
                  "'; known are ttl and recv_buf_size");
    }
  }
  return result;
}

std::string LcmUrl::to_string() const {
  if (!is_udpm()) return text;
  return "udpm://" + group + ":" + std::to_string(port) + "?ttl=" + std::to_string(ttl) +
         "&recv_buf_size=" + std::to_string(recv_buf_size);
}

int receive_buffer_limit() {
  // Asking the kernel instead of reading /proc/sys/net/core/rmem_max works in every network
  // namespace. It answers with twice what it grants, the other half being for bookkeeping.
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) throw Error("cannot open an IPv4 socket; LCM needs IPv4 networking");
  const int ask = 1 << 30;
  int granted = 0;
  socklen_t size = sizeof granted;
  setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &ask, sizeof ask);
  getsockopt(fd, SOL_SOCKET, SO_RCVBUF, &granted, &size);
  close(fd);
  return granted / 2;
}

std::string receive_buffer_warning(const LcmUrl& url, int limit) {
  if (!url.is_udpm() || limit >= url.recv_buf_size) return {};
  const std::string setting = "net.core.rmem_max=" + std::to_string(url.recv_buf_size);
  return "the kernel limits receive buffers to " + std::to_string(limit) +
         " bytes: messages may get lost in bursts (lost frames are counted in STAGE_STATUS). "
         "Remedy: "
         "sudo sysctl -w " +
         setting + "; to keep it: echo " + setting + " | sudo tee /etc/sysctl.d/60-weft.conf";
}

std::unique_ptr<lcm::LCM> connect(const LcmUrl& wanted) {
  LcmUrl url = wanted;
  if (url.is_udpm()) url.recv_buf_size = std::min(url.recv_buf_size, receive_buffer_limit());
  auto lcm = std::make_unique<lcm::LCM>(url.to_string());
  if (!lcm->good()) {
    if (!url.is_udpm())
      throw Error("LCM URL '" + url.to_string() +
                  "' cannot be opened; check the path and provider");
    throw Error("LCM cannot use " + url.to_string() +
                ": this machine has no route for multicast. Remedy: sudo ip link set lo up "
                "multicast on && sudo ip route add 224.0.0.0/4 dev lo");
  }
  // Starts LCM's receive thread, which tests that a message of its own comes back.
  if (url.is_udpm() && lcm->getFileno() < 0) {
    throw Error("LCM sends to " + url.to_string() +
                " but receives nothing back. Check the route (ip route get " + url.group +
                "), that its interface has multicast on (ip link), and the firewall; for this "
                "machine alone: sudo ip route replace 224.0.0.0/4 dev lo");
  }
  return lcm;
}

std::string channel_regex(const std::string& channel) {
  std::string regex;
  for (const char c : channel) {
    if (std::string_view(".[]()*+?{}|^$\\").find(c) != std::string_view::npos) regex += '\\';
    regex += c;
  }
  return regex;
}

}  // namespace weft::stage
