#pragma once

#include "bovw/word_grid.hpp"
#include "weft/words_t.hpp"

/// WORDS_* to and from word grids.
namespace weft::messages {

/// Fills in everything but header and status.
void to_message(const bovw::WordGrid& grid, words_t& message);

/// Throws stage::InvalidInput for content no sender of ours makes: counts that do not agree, words
/// outside the vocabulary, a grid without a step or with more than 2^22 points.
bovw::WordGrid from_message(const words_t& message);

}  // namespace weft::messages
