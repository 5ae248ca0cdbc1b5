#include "stage/net_namespace.hpp"

#include <arpa/inet.h>
#include <fcntl.h>
#include <net/if.h>
#include <net/route.h>
#include <netinet/in.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "stage/lcm_url.hpp"

namespace weft::stage {
namespace {

/// Closes a file descriptor at the end of its scope.
struct Descriptor {
  explicit Descriptor(int value) : fd(value) {}
  ~Descriptor() {
    if (fd >= 0) close(fd);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int fd;
};

bool fail(std::string& why_not, const std::string& what) {
  why_not = what + ": " + std::strerror(errno);
  return false;
}

bool write_text(const char* path, const std::string& text) {
  const Descriptor file(open(path, O_WRONLY | O_CLOEXEC));
  return file.fd >= 0 &&
         write(file.fd, text.data(), text.size()) == static_cast<ssize_t>(text.size());
}

bool leave_network(std::string& why_not) {
  if (unshare(CLONE_NEWNET) == 0) return true;
  const auto uid = std::to_string(geteuid());
  const auto gid = std::to_string(getegid());
  if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
    return fail(why_not,
                "neither a network namespace nor one within a user namespace is permitted");
  // Keeping the ids means that files still belong to the user.
  if (!write_text("/proc/self/setgroups", "deny") ||
      !write_text("/proc/self/uid_map", uid + " " + uid + " 1") ||
      !write_text("/proc/self/gid_map", gid + " " + gid + " 1"))
    return fail(why_not, "the user namespace cannot be given its ids");
  return true;
}

/// What `ip link set lo up multicast on` and `ip route add 224.0.0.0/4 dev lo` do.
bool set_up_loopback(std::string& why_not) {
  const Descriptor socket_fd(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (socket_fd.fd < 0) return fail(why_not, "cannot open an IPv4 socket");
  ifreq interface {};
  std::strcpy(interface.ifr_name, "lo");
  if (ioctl(socket_fd.fd, SIOCGIFFLAGS, &interface) != 0)
    return fail(why_not, "the namespace has no loopback");
  interface.ifr_flags = static_cast<short>(interface.ifr_flags | IFF_UP | IFF_MULTICAST);
  if (ioctl(socket_fd.fd, SIOCSIFFLAGS, &interface) != 0)
    return fail(why_not, "the loopback cannot be brought up");
  const auto address = [](sockaddr& where, std::uint32_t value) {
    auto& in = reinterpret_cast<sockaddr_in&>(where);
    in.sin_family = AF_INET;
    in.sin_addr.s_addr = htonl(value);
  };
  rtentry route{};
  char device[] = "lo";
  address(route.rt_dst, 0xe0000000u);
  address(route.rt_genmask, 0xf0000000u);
  route.rt_flags = RTF_UP;
  route.rt_dev = device;
  if (ioctl(socket_fd.fd, SIOCADDRT, &route) != 0 && errno != EEXIST)
    return fail(why_not, "the multicast route cannot be added");
  return true;
}

/// Runs in a child first: a process cannot go back when only half of it is permitted.
bool rehearse(std::string& why_not) {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return fail(why_not, "cannot make a pipe");
  const Descriptor read_end(ends[0]);
  const pid_t child = fork();
  if (child < 0) {
    close(ends[1]);
    return fail(why_not, "cannot fork");
  }
  if (child == 0) {
    std::string why;
    const bool good = leave_network(why) && set_up_loopback(why) && multicast_works(why);
    const bool told = write(ends[1], why.data(), why.size()) == static_cast<ssize_t>(why.size());
    _exit(good && told ? 0 : 1);
  }
  close(ends[1]);
  why_not.clear();
  char buffer[256];
  for (ssize_t count; (count = read(read_end.fd, buffer, sizeof buffer)) > 0;)
    why_not.append(buffer, static_cast<std::size_t>(count));
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  return WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

}  // namespace

bool multicast_works(std::string& why_not) {
  const Descriptor receiver(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  const Descriptor sender(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (receiver.fd < 0 || sender.fd < 0) return fail(why_not, "cannot open an IPv4 socket");
  sockaddr_in group{};
  group.sin_family = AF_INET;
  inet_pton(AF_INET, LcmUrl().group.c_str(), &group.sin_addr);
  socklen_t size = sizeof group;
  const ip_mreq membership{group.sin_addr, {htonl(INADDR_ANY)}};
  const unsigned char ttl = 0;
  if (bind(receiver.fd, reinterpret_cast<sockaddr*>(&group), sizeof group) != 0 ||
      getsockname(receiver.fd, reinterpret_cast<sockaddr*>(&group), &size) != 0)
    return fail(why_not, "cannot bind to the multicast group");
  if (setsockopt(receiver.fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0)
    return fail(why_not, "cannot join the multicast group (no route for multicast?)");
  if (setsockopt(sender.fd, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl) != 0 ||
      sendto(sender.fd, "weft", 4, 0, reinterpret_cast<sockaddr*>(&group), sizeof group) != 4)
    return fail(why_not, "cannot send to the multicast group (no route for multicast?)");
  pollfd ready{receiver.fd, POLLIN, 0};
  if (poll(&ready, 1, 500) == 1) return true;
  why_not = "a message to the multicast group does not come back (interface without multicast?)";
  return false;
}

bool enter_private_network(std::string& why_not) {
  return rehearse(why_not) && leave_network(why_not) && set_up_loopback(why_not);
}

}  // namespace weft::stage
