#pragma once

#include <memory>
#include <string>

namespace lcm {
class LCM;
}

namespace weft::stage {

/// The one place that builds an LCM URL.
struct LcmUrl {
  std::string provider = "udpm";  // or memq, file ...: passed to LCM as written, in `text`
  std::string group = "239.255.76.67";
  int port = 7667;
  int ttl = 0;  // 0: this host only; 1: the LAN
  /// Bytes of receive buffer to ask for: one second of VGA frames at 30 Hz; no more is asked for
  /// than the kernel allows.
  int recv_buf_size = 4 << 20;
  /// Tells robots apart that share a group and port: every channel CHANNEL is called PREFIX/CHANNEL
  /// on the wire, STAGE_STATUS and STAGE_TIMING included. Empty: none. Weft's own piece of the URL.
  std::string prefix;
  std::string text;  // of other providers

  /// "udpm://GROUP:PORT?ttl=N&recv_buf_size=N&prefix=NAME" with every piece optional. An empty text
  /// means $LCM_DEFAULT_URL, or else the defaults above. Throws Error naming the piece that is
  /// wrong.
  static LcmUrl parse(const std::string& text);
  bool is_udpm() const { return provider == "udpm"; }
  std::string to_string() const;      // what parse() reads
  std::string to_lcm_string() const;  // what LCM itself reads: without the prefix

  /// A channel as it is called on the wire, and back.
  std::string wire(const std::string& channel) const;
  std::string local(const std::string& wire_channel) const;
};

/// What is wrong with a prefix; empty when nothing is: it has 1 to 24 letters, digits, _ or -.
std::string prefix_fault(const std::string& prefix);

/// net.core.rmem_max of the running kernel, bytes: the largest receive buffer a socket may ask for.
int receive_buffer_limit();

/// What to tell a person when the kernel's limit is below what the URL asks for, with the exact
/// remedy; empty when all is well.
std::string receive_buffer_warning(const LcmUrl& url, int limit);

/// The kernel puts the packets of a message from another host together in a memory of bytes, and
/// keeps those of a message that lost one for time_s. When it is full, every message gets lost.
struct FragmentMemory {
  long long bytes = 0;
  long long time_s = 0;
  static FragmentMemory of_kernel();
};
/// Empty when the URL stays on this host, or the memory suffices for 2 MB of incomplete messages a
/// second: a third of VGA at 30 Hz.
std::string fragment_warning(const LcmUrl& url, const FragmentMemory& memory);

/// Connects, asking for as much receive buffer as allowed. With a TTL of 0 nothing that another
/// host sends is received either, wherever the multicast route leads. Throws Error with the exact
/// remedies when LCM cannot start: no multicast route, or messages do not come back.
std::unique_ptr<lcm::LCM> connect(const LcmUrl& url);

/// The regular expression that subscribes to one channel literally.
std::string channel_regex(const std::string& channel);

}  // namespace weft::stage
