#include "detector/blocks.hpp"

#include <algorithm>

#include "base/error.hpp"
#include "base/hash.hpp"

namespace weft::detector {
namespace {
constexpr int kMaxBlocks = 8;
}

int total_entries(const std::vector<HistogramBlock>& blocks) {
  int entries = 0;
  for (const auto& block : blocks) entries += block.entries();
  return entries;
}

int count_block(const HistogramBlock& block, const bovw::WordGrid& grid,
                const bovw::CellBox& window, std::span<std::int32_t> counts) {
  const auto words = static_cast<std::size_t>(block.words);
  const int total = bovw::count_words(grid, window, counts.first(words));
  if (block.context) {
    int inside = 0;
    const int column_end = std::min(grid.columns, window.column + window.columns);
    const int row_end = std::min(grid.rows, window.row + window.rows);
    for (int row = std::max(0, window.row); row < row_end; ++row) {
      for (int column = std::max(0, window.column); column < column_end; ++column) {
        inside += grid.at(column, row) != bovw::WordGrid::kOutsideMask;
      }
    }
    counts[words] = inside - total;
    counts[words + 1] = window.columns * window.rows - inside;
  }
  return total;
}

std::vector<std::int32_t> count_blocks(const std::vector<HistogramBlock>& blocks,
                                       std::span<const bovw::WordGrid* const> grids,
                                       const bovw::CellBox& window) {
  std::vector<std::int32_t> counts(static_cast<std::size_t>(total_entries(blocks)));
  std::size_t begin = 0;
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    const auto size = static_cast<std::size_t>(blocks[b].entries());
    count_block(blocks[b], *grids[b], window, std::span(counts).subspan(begin, size));
    begin += size;
  }
  return counts;
}

void validate_blocks(const std::vector<HistogramBlock>& blocks, const std::string& where) {
  if (blocks.empty() || blocks.size() > kMaxBlocks) {
    throw Error(where + ": " + std::to_string(blocks.size()) + " descriptors, 1 to " +
                std::to_string(kMaxBlocks) + " expected");
  }
  for (const auto& block : blocks) {
    if (block.descriptor.empty()) throw Error(where + ": a descriptor without a name");
    if (block.words < 1 || block.words > 32765) {
      throw Error(where + ": vocabulary of " + std::to_string(block.words) + " words");
    }
  }
}

void validate_part(const std::string& part, const std::string& where) {
  if (std::find(kParts.begin(), kParts.end(), part) == kParts.end()) {
    throw Error(where + ": unknown part '" + part + "'");
  }
}

void check_grids(const std::vector<HistogramBlock>& blocks,
                 std::span<const bovw::WordGrid* const> grids, const std::string& where) {
  if (grids.size() != blocks.size()) {
    throw Error(where + ": words of " + std::to_string(grids.size()) +
                " descriptors, but the model wants " + std::to_string(blocks.size()));
  }
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const auto& grid = *grids[i];
    const auto& first = *grids.front();
    if (grid.descriptor != blocks[i].descriptor || grid.vocabulary_size != blocks[i].words ||
        grid.vocabulary_hash != blocks[i].vocabulary_hash) {
      throw Error(where + ": got words of " + grid.descriptor + " from the vocabulary " +
                  to_hex(grid.vocabulary_hash) + ", but was trained with " + blocks[i].descriptor +
                  " and the vocabulary " + to_hex(blocks[i].vocabulary_hash) +
                  "; use models of one training run");
    }
    if (grid.columns != first.columns || grid.rows != first.rows ||
        grid.origin_x != first.origin_x || grid.origin_y != first.origin_y ||
        grid.step_px != first.step_px || grid.view.kind != first.view.kind ||
        grid.view.width != first.view.width || grid.view.height != first.view.height) {
      throw Error(where + ": the words of " + grid.descriptor + " and " + first.descriptor +
                  " lie on different grids; describe both with the same view and grid settings");
    }
  }
}

void write_blocks(BlobWriter& blob, const std::vector<HistogramBlock>& blocks) {
  blob.add_number("blocks", static_cast<std::int64_t>(blocks.size()));
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const std::string name = "block." + std::to_string(i) + ".";
    blob.add(name + "descriptor", blocks[i].descriptor);
    blob.add_number(name + "vocabulary_hash", static_cast<std::int64_t>(blocks[i].vocabulary_hash));
    blob.add_number(name + "words", static_cast<std::int64_t>(blocks[i].words));
    blob.add_number(name + "context", static_cast<std::int64_t>(blocks[i].context));
  }
}

std::vector<HistogramBlock> read_blocks(const BlobReader& blob) {
  std::vector<HistogramBlock> blocks(
      static_cast<std::size_t>(blob.integer("blocks", 1, kMaxBlocks)));
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const std::string name = "block." + std::to_string(i) + ".";
    blocks[i].descriptor = blob.text(name + "descriptor");
    blocks[i].vocabulary_hash =
        static_cast<std::uint64_t>(blob.integer(name + "vocabulary_hash", INT64_MIN, INT64_MAX));
    blocks[i].words = static_cast<int>(blob.integer(name + "words", 1, 32767));
    blocks[i].context = blob.integer(name + "context", 0, 1) != 0;
  }
  return blocks;
}

}  // namespace weft::detector
