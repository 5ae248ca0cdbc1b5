#pragma once

#include "foreground/foreground.hpp"
#include "weft/foreground_t.hpp"

/// FOREGROUND to and from its message.
namespace weft::messages {

/// Fills in everything but header and status.
void to_message(const foreground::Foreground& foreground, foreground_t& message);

/// Throws stage::InvalidInput for content no sender of ours makes: a size outside 1 to 8192 px a
/// side, run lengths that do not add up to it, a table that is no plane.
foreground::Foreground from_message(const foreground_t& message);

}  // namespace weft::messages
