#pragma once

#include <string>

namespace weft::synth {

/// What a finished data set holds, as a text: scenes of each type, state and split, usable
/// annotations of each part with the share of true boxes whose centre lies on the part (oracle
/// R@1), and what was rejected why. folder: with manifest.jsonl. Throws Error.
std::string summarise(const std::string& folder);

/// Writes contact-sheet.png: a row for each type, a column for each state, scenes with their
/// polygons (grey: ignored).
void write_contact_sheet(const std::string& folder);

}  // namespace weft::synth
