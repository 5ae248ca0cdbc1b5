#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "tools/weft/timing_report.hpp"

namespace weft {

/// A page of the program's own (demo.html, timing.html) with its style, scripts and data in it.
std::string make_page(const std::string& name, const nlohmann::json& data);

/// A report as the pages' scripts read it.
nlohmann::json page_timing(const TimingReport& report);

namespace internal {
const std::map<std::string, std::string>& page_files();
}
}  // namespace weft
