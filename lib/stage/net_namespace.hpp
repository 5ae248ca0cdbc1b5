#pragma once

#include <string>

namespace weft::stage {

/// Whether a multicast message sent on this machine comes back to it, as LCM needs. why_not: what
/// failed, for a person.
bool multicast_works(std::string& why_not);

/// Moves this process into a network namespace of its own with nothing but a loopback that carries
/// multicast; as root, else through a user namespace. Processes started afterwards are in it too.
/// Call it before any thread is started. When it returns false nothing has changed; why_not says
/// what is not permitted.
bool enter_private_network(std::string& why_not);

}  // namespace weft::stage
