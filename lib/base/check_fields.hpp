#pragma once

#include <functional>
#include <string>

#include "base/options.hpp"

namespace weft::internal {

/// check_fields() with errors that begin with where(path of the option, as "group.name").
void check_fields_at(void (*visit)(void*, OptionVisitor&), void* options,
                     const std::function<std::string(const std::string&)>& where);

}  // namespace weft::internal
