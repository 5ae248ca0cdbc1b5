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
  std::string text;  // of other providers

  /// "udpm://GROUP:PORT?ttl=N&recv_buf_size=N" with every piece optional. An empty text means
  /// $LCM_DEFAULT_URL, or else the defaults above. Throws Error naming the piece that is wrong.
  static LcmUrl parse(const std::string& text);
  bool is_udpm() const { return provider == "udpm"; }
  std::string to_string() const;
};

/// net.core.rmem_max of the running kernel, bytes: the largest receive buffer a socket may ask for.
int receive_buffer_limit();

/// What to tell a person when the kernel's limit is below what the URL asks for, with the exact
/// remedy; empty when all is well.
std::string receive_buffer_warning(const LcmUrl& url, int limit);

/// Connects, asking for as much receive buffer as allowed. Throws Error with the exact remedies
/// when LCM cannot start: no multicast route, or messages do not come back.
std::unique_ptr<lcm::LCM> connect(const LcmUrl& url);

/// The regular expression that subscribes to one channel literally.
std::string channel_regex(const std::string& channel);

}  // namespace weft::stage
