#include "stage/lcm_url.hpp"

#include <arpa/inet.h>
#include <dirent.h>
#include <linux/filter.h>
#include <linux/if_packet.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <fstream>
#include <lcm/lcm-cpp.hpp>
#include <set>
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

/// This process's IPv4 UDP sockets that are bound to a port.
std::set<int> bound_sockets(int port) {
  std::set<int> found;
  DIR* folder = opendir("/proc/self/fd");
  if (!folder) return found;
  while (const dirent* entry = readdir(folder)) {
    const int fd = std::atoi(entry->d_name);
    sockaddr_in address{};
    socklen_t size = sizeof address;
    int type = 0;
    socklen_t type_size = sizeof type;
    if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &type_size) == 0 && type == SOCK_DGRAM &&
        getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0 &&
        address.sin_family == AF_INET && ntohs(address.sin_port) == port)
      found.insert(fd);
  }
  closedir(folder);
  return found;
}

/// LCM binds to every interface and joins its group on the one that the route names: a TTL of 0
/// keeps messages in, but those of other hosts not out. This filter of the kernel does.
bool keep_other_hosts_out(int fd) {
  constexpr unsigned kLoopbackInterface = 1;  // in every network namespace
  sock_filter code[] = {
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<unsigned>(SKF_AD_OFF + SKF_AD_PKTTYPE)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, PACKET_LOOPBACK, 2, 0),  // sent from here, looped back
      BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<unsigned>(SKF_AD_OFF + SKF_AD_IFINDEX)),
      BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, kLoopbackInterface, 0, 1),
      BPF_STMT(BPF_RET | BPF_K, 0xffffffffu),
      BPF_STMT(BPF_RET | BPF_K, 0u),
  };
  const sock_fprog program{sizeof code / sizeof code[0], code};
  return setsockopt(fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0;
}

/// LCM tries the same and, where it fails, prints a page of advice for another kind of set.
bool has_route(const LcmUrl& url) {
  const int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(static_cast<std::uint16_t>(url.port));
  const bool found = fd >= 0 && inet_pton(AF_INET, url.group.c_str(), &to.sin_addr) == 1 &&
                     ::connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0;
  if (fd >= 0) close(fd);
  return found;
}

}  // namespace

std::string prefix_fault(const std::string& prefix) {
  constexpr std::size_t kLongest = 24;
  const bool plain = std::all_of(prefix.begin(), prefix.end(), [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  });
  if (plain && !prefix.empty() && prefix.size() <= kLongest) return {};
  return "the prefix '" + prefix + "' must be 1 to " + std::to_string(kLongest) +
         " letters, digits, _ or -";
}

std::string LcmUrl::wire(const std::string& channel) const {
  return prefix.empty() ? channel : prefix + "/" + channel;
}

std::string LcmUrl::local(const std::string& wire_channel) const {
  return prefix.empty() ? wire_channel : wire_channel.substr(prefix.size() + 1);
}

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
    } else if (key == "prefix") {
      if (const auto fault = prefix_fault(value); !fault.empty())
        throw Error("LCM URL '" + url + "': " + fault);
      result.prefix = value;
    } else {
      throw Error("LCM URL '" + url + "': unknown option '" + option +
                  "'; known are ttl, recv_buf_size and prefix");
    }
  }
  return result;
}

std::string LcmUrl::to_string() const {
  return to_lcm_string() + (prefix.empty() ? "" : "&prefix=" + prefix);
}

std::string LcmUrl::to_lcm_string() const {
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

FragmentMemory FragmentMemory::of_kernel() {
  const auto number_in = [](const char* file) {
    long long value = 0;
    std::ifstream(file) >> value;
    return value;
  };
  return {number_in("/proc/sys/net/ipv4/ipfrag_high_thresh"),
          number_in("/proc/sys/net/ipv4/ipfrag_time")};
}

std::string fragment_warning(const LcmUrl& url, const FragmentMemory& memory) {
  constexpr long long kLeast_bytes_per_s = 2'000'000;
  if (!url.is_udpm() || url.ttl == 0 || memory.bytes >= kLeast_bytes_per_s * memory.time_s)
    return {};
  const std::string settings = "net.ipv4.ipfrag_time=2 net.ipv4.ipfrag_high_thresh=67108864";
  return "the kernel keeps the pieces of messages that lost a packet for " +
         std::to_string(memory.time_s) + " s in " + std::to_string(memory.bytes) +
         " bytes: on a lossy network these are soon full, and this host hears nothing more of "
         "others. Remedy: sudo sysctl -w " +
         settings + "; to keep it: printf '%s\\n' " + settings +
         " | sudo tee -a /etc/sysctl.d/60-weft.conf";
}

std::unique_ptr<lcm::LCM> connect(const LcmUrl& wanted) {
  LcmUrl url = wanted;
  if (url.is_udpm()) url.recv_buf_size = std::min(url.recv_buf_size, receive_buffer_limit());
  if (url.is_udpm() && !has_route(url)) {
    const std::string interface = url.ttl == 0 ? "lo" : "NAME (of the LAN's: ip -brief link)";
    throw Error("LCM cannot use " + url.to_string() +
                ": this machine has no route for multicast. Remedy: sudo ip link set lo up "
                "multicast on && sudo ip route add 224.0.0.0/4 dev " +
                interface);
  }
  const std::set<int> sockets_before = bound_sockets(url.port);
  auto lcm = std::make_unique<lcm::LCM>(url.to_lcm_string());
  if (!lcm->good())
    throw Error("LCM URL '" + url.to_string() +
                "' cannot be opened; check the address, or the path and provider");
  // Starts LCM's receive thread, which tests that a message of its own comes back.
  if (url.is_udpm() && lcm->getFileno() < 0) {
    throw Error("LCM sends to " + url.to_string() +
                " but receives nothing back. Check the route (ip route get " + url.group +
                "), that its interface has multicast on (ip link), and the firewall; for this "
                "machine alone: sudo ip route replace 224.0.0.0/4 dev lo");
  }
  if (url.is_udpm() && url.ttl == 0) {
    bool kept_out = false;
    for (const int fd : bound_sockets(url.port))
      if (!sockets_before.contains(fd)) kept_out = keep_other_hosts_out(fd);
    if (!kept_out) {
      spdlog::warn(
          "this kernel does not let messages of other hosts be kept out; to keep them out: sudo ip "
          "route replace {}/32 dev lo",
          url.group);
    }
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
