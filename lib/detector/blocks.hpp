#pragma once

#include <span>
#include <string>
#include <vector>

#include "base/blob.hpp"
#include "bovw/histogram.hpp"
#include "bovw/word_grid.hpp"
#include "detector/types.hpp"
#include "detector/window_scorer.hpp"

/// What the refine and prior models have in common: the histogram blocks of their input.
namespace weft::detector {

/// Entries of the blocks' histograms, one after the other.
int total_entries(const std::vector<HistogramBlock>& blocks);

/// Counts a window of a grid: the block's words, then, with context, points inside the mask without
/// a word and points outside it, the part of the window that overhangs the grid included. counts:
/// block.entries(), overwritten. Returns the number of words.
int count_block(const HistogramBlock& block, const bovw::WordGrid& grid,
                const bovw::CellBox& window, std::span<std::int32_t> counts);

/// The same for all blocks, one histogram after the other.
std::vector<std::int32_t> count_blocks(const std::vector<HistogramBlock>& blocks,
                                       std::span<const bovw::WordGrid* const> grids,
                                       const bovw::CellBox& window);

/// Throws Error naming `where` for no block or a block without a descriptor or words.
void validate_blocks(const std::vector<HistogramBlock>& blocks, const std::string& where);

/// Throws Error naming `where` unless `part` is one of kParts.
void validate_part(const std::string& part, const std::string& where);

/// Throws Error unless there is one grid a block, of its descriptor and vocabulary, all over the
/// same points of the same view.
void check_grids(const std::vector<HistogramBlock>& blocks,
                 std::span<const bovw::WordGrid* const> grids, const std::string& where);

void write_blocks(BlobWriter& blob, const std::vector<HistogramBlock>& blocks);
std::vector<HistogramBlock> read_blocks(const BlobReader& blob);

}  // namespace weft::detector
