#include "rgbd/depth_code.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdlib>
#include <cstring>

#include "base/error.hpp"

namespace weft::rgbd {
namespace {

void check_image(const cv::Mat& depth) {
  if (depth.type() != CV_16UC1 || depth.empty() || depth.rows > 8192 || depth.cols > 8192) {
    throw Error("depth codes take 16-bit images of 1x1 to 8192x8192 px, not type " +
                std::to_string(depth.type()) + " of " + std::to_string(depth.cols) + "x" +
                std::to_string(depth.rows));
  }
}

/// Bytes read one by one, never past their end.
class ByteReader {
 public:
  ByteReader(const std::uint8_t* data, std::size_t size, const std::string& where)
      : at_(data), end_(data + size), where_(where) {}
  [[noreturn]] void fail(const char* what) const {
    throw Error(where_ + ": damaged depth image: " + what);
  }
  std::uint32_t varint() {
    std::uint32_t value = 0;
    for (int shift = 0; shift < 28; shift += 7) {
      if (at_ == end_) fail("it ends too early");
      value |= static_cast<std::uint32_t>(*at_ & 127) << shift;
      if (*at_++ < 128) return value;
    }
    fail("a number is too large");
  }
  const std::uint8_t* take(std::size_t count) {
    if (static_cast<std::size_t>(end_ - at_) < count) fail("it ends too early");
    at_ += count;
    return at_ - count;
  }
  bool done() const { return at_ == end_; }

 private:
  const std::uint8_t* at_;
  const std::uint8_t* end_;
  const std::string& where_;
};

void put_varint(std::vector<std::uint8_t>& bytes, std::uint32_t value) {
  for (; value >= 128; value >>= 7) bytes.push_back(static_cast<std::uint8_t>(value | 128));
  bytes.push_back(static_cast<std::uint8_t>(value));
}

// ---- What encoder and decoder of the palette code share ----

// A symbol is "missing" (0) or 1 + the token of a prediction error: errors of small magnitude are
// tokens themselves, larger ones name their leading bits, and the rest follows as plain bits.
constexpr int kSymbols = 48;
constexpr int kScaleBits = 11;
constexpr std::uint32_t kScale = 1u << kScaleBits;
constexpr std::uint32_t kStateLow = 1u << 16;  // renormalised 16 bits at a time
// Differences between neighbours are told apart as 0, +-1, +-2..6 and beyond: 7^3 patterns, those
// of opposite sign mirrored into one. Before them come the patterns of missing neighbours.
constexpr int kLevels = 7;
constexpr int kMissingPatterns = 16;
constexpr int kContexts = kMissingPatterns + (kLevels * kLevels * kLevels + 1) / 2;
constexpr std::uint32_t kRare = 48;  // contexts seen less often share one table
// The image is cut into bands that are coded apart, so that a decoder can work on all at once.
constexpr int kBands = 4;
int band_begin(int band, int height) {
  return static_cast<int>(static_cast<std::int64_t>(band) * height / kBands);
}

struct Context {
  int index;
  int prediction;
  int sign;
};

/// The contexts' differences between neighbours by table: they are looked up three times a pixel.
class Levels {
 public:
  Levels() {
    for (int d = -kReach; d <= kReach; ++d) {
      const int magnitude = d < 0 ? -d : d;
      const int level = magnitude < 2 ? magnitude : magnitude < kReach ? 2 : 3;
      table_[d + kReach] = static_cast<std::int8_t>(d < 0 ? -level : level);
    }
  }
  int operator()(int difference) const {
    return table_[std::clamp(difference, -kReach, kReach) + kReach];
  }

 private:
  static constexpr int kReach = 7;
  std::array<std::int8_t, 2 * kReach + 1> table_;
};

/// w, n, nw, ne: indices of the neighbours, 0 = missing.
[[gnu::always_inline]] inline Context context_of(int w, int n, int nw, int ne,
                                                 const Levels& levels) {
  if (w == 0 || n == 0 || nw == 0) {
    const int pattern = (w != 0) | (n != 0) << 1 | (nw != 0) << 2 | (ne != 0) << 3;
    return {pattern, w ? w : n ? n : ne ? ne : nw ? nw : 1, 1};
  }
  const int right = ne ? ne : n;
  const int prediction = std::clamp(w + n - nw, std::min(w, n), std::max(w, n));
  const int signed_index =
      (levels(w - nw) * kLevels + levels(nw - n)) * kLevels + levels(n - right);
  const int sign = signed_index >> 31 | 1;
  return {kMissingPatterns + sign * signed_index, prediction, sign};
}

struct Token {
  int symbol;
  int extra_bits;
  std::uint32_t extra;
};

Token token_of(int error) {
  const auto z = static_cast<std::uint32_t>(error >= 0 ? 2 * error : -2 * error - 1);
  if (z < 16) return {1 + static_cast<int>(z), 0, 0};
  const int bits = std::bit_width(z) - 1;  // z = 1 b xxx: b goes into the token
  return {1 + 16 + 2 * (bits - 4) + static_cast<int>(z >> (bits - 1) & 1), bits - 1,
          z & ((1u << (bits - 1)) - 1)};
}

/// Frequencies of the symbols of one context, adding up to kScale, every symbol that occurs at
/// least 1.
std::array<std::uint32_t, kSymbols> scaled(const std::array<std::uint32_t, kSymbols>& counts) {
  std::uint64_t total = 0;
  for (const std::uint32_t count : counts) total += count;
  std::array<std::uint32_t, kSymbols> result{};
  std::uint32_t sum = 0;
  for (int s = 0; s < kSymbols; ++s) {
    if (counts[s] == 0) continue;
    result[s] = std::max<std::uint32_t>(
        1, static_cast<std::uint32_t>((counts[s] * std::uint64_t{kScale} + total / 2) / total));
    sum += result[s];
  }
  while (sum != kScale) {
    auto& largest = *std::max_element(result.begin(), result.end());
    const std::uint32_t step = sum > kScale ? std::min(sum - kScale, largest / 2) : kScale - sum;
    sum > kScale ? (largest -= step, sum -= step) : (largest += step, sum += step);
  }
  return result;
}

}  // namespace

std::vector<std::uint8_t> encode_depth_palette(const cv::Mat& depth) {
  check_image(depth);
  const int width = depth.cols, height = depth.rows;
  std::vector<std::uint16_t> index(65536, 0);
  for (int v = 0; v < height; ++v) {
    const auto* in = depth.ptr<std::uint16_t>(v);
    for (int u = 0; u < width; ++u) index[in[u]] = 1;
  }
  std::vector<std::uint8_t> bytes;
  index[0] = 0;
  std::uint16_t colours = 0;
  for (int value = 1; value < 65536; ++value)
    if (index[value]) index[value] = ++colours;
  put_varint(bytes, colours);
  for (int value = 1, last = 0; value < 65536; ++value) {
    if (!index[value]) continue;
    put_varint(bytes, static_cast<std::uint32_t>(value - last));
    last = value;
  }

  // Contexts, symbols and plain bits in reading order.
  const Levels levels;
  struct Coded {
    std::uint16_t context;
    std::uint8_t symbol;
  };
  std::vector<Coded> coded(depth.total());
  std::vector<std::array<std::uint32_t, kSymbols>> counts(kContexts + 1);
  std::array<std::vector<std::uint8_t>, kBands> plain;
  for (int band = 0; band < kBands; ++band) {
    std::uint64_t pending = 0;
    int pending_bits = 0;
    std::vector<std::uint16_t> above(width + 2, 0), row(width + 2, 0);
    for (int v = band_begin(band, height); v < band_begin(band + 1, height); ++v) {
      const auto* in = depth.ptr<std::uint16_t>(v);
      Coded* out = coded.data() + static_cast<std::size_t>(v) * width;
      for (int u = 0; u < width; ++u) {
        const Context context = context_of(row[u], above[u + 1], above[u], above[u + 2], levels);
        const int x = index[in[u]];
        row[u + 1] = static_cast<std::uint16_t>(x);
        int symbol = 0;
        if (x != 0) {
          const Token token = token_of(context.sign * (x - context.prediction));
          symbol = token.symbol;
          pending |= std::uint64_t{token.extra} << pending_bits;
          for (pending_bits += token.extra_bits; pending_bits >= 8;
               pending_bits -= 8, pending >>= 8)
            plain[band].push_back(static_cast<std::uint8_t>(pending));
        }
        out[u] = {static_cast<std::uint16_t>(context.index), static_cast<std::uint8_t>(symbol)};
        ++counts[context.index][symbol];
      }
      above.swap(row);
    }
    if (pending_bits > 0) plain[band].push_back(static_cast<std::uint8_t>(pending));
  }

  // One table for each context seen often, and one, the last, for all others.
  std::vector<int> table_of(kContexts, kContexts);
  for (int c = 0; c < kContexts; ++c) {
    std::uint32_t total = 0;
    for (const std::uint32_t count : counts[c]) total += count;
    if (total >= kRare) {
      table_of[c] = c;
    } else {
      for (int s = 0; s < kSymbols; ++s) counts[kContexts][s] += counts[c][s];
    }
  }
  std::vector<std::array<std::uint32_t, kSymbols>> frequency(kContexts + 1), start(kContexts + 1);
  for (int c = 0; c <= kContexts; ++c) {
    int used = 0;
    if (c == kContexts || table_of[c] == c) {
      for (int s = 0; s < kSymbols; ++s)
        if (counts[c][s]) used = s + 1;
      if (used > 0) frequency[c] = scaled(counts[c]);
    }
    put_varint(bytes, static_cast<std::uint32_t>(used));
    std::uint32_t sum = 0;
    for (int s = 0; s < kSymbols; ++s) {
      if (s < used) put_varint(bytes, frequency[c][s]);
      start[c][s] = sum;
      sum += frequency[c][s];
    }
  }

  for (int band = 0; band < kBands; ++band) {
    // The coder works like a stack: last symbol in, first out.
    std::vector<std::uint16_t> words;
    std::uint32_t state = kStateLow;
    const Coded* const begin =
        coded.data() + static_cast<std::size_t>(band_begin(band, height)) * width;
    for (const Coded* at =
             coded.data() + static_cast<std::size_t>(band_begin(band + 1, height)) * width;
         at-- != begin;) {
      const int table = table_of[at->context];
      const std::uint32_t f = frequency[table][at->symbol];
      if (state >= std::uint64_t{f} << (32 - kScaleBits)) {
        words.push_back(static_cast<std::uint16_t>(state));
        state >>= 16;
      }
      state = ((state / f) << kScaleBits) + state % f + start[table][at->symbol];
    }
    words.push_back(static_cast<std::uint16_t>(state));
    words.push_back(static_cast<std::uint16_t>(state >> 16));
    put_varint(bytes, static_cast<std::uint32_t>(plain[band].size()));
    bytes.insert(bytes.end(), plain[band].begin(), plain[band].end());
    put_varint(bytes, static_cast<std::uint32_t>(words.size()));
    for (auto it = words.rbegin(); it != words.rend(); ++it) {
      bytes.push_back(static_cast<std::uint8_t>(*it));
      bytes.push_back(static_cast<std::uint8_t>(*it >> 8));
    }
  }
  return bytes;
}

namespace {

struct Tables {
  std::vector<std::uint16_t> palette;
  /// One for each context, or the shared one. Kept small: the cache holds few of large ones.
  struct Table {
    std::array<std::uint8_t, kScale> symbol;                  // of each code point
    std::array<std::uint32_t, kSymbols + 1> frequency_start;  // frequency << 16 | first code point
  };
  std::vector<Table> tables;
  std::array<std::uint16_t, kContexts> table_of;
  Levels levels;
};

/// Decodes one band, pixel by pixel. Kept small: several run side by side to hide the latency of
/// the chain from one pixel to the next.
class Lane {
 public:
  Lane(ByteReader& in, int width) : in_(&in), above_(width + 2, 0), row_(width + 2, 0) {
    const std::uint32_t plain_size = in.varint();
    plain_ = in.take(plain_size);
    plain_end_ = plain_ + plain_size;
    const std::uint32_t count = in.varint();
    const std::uint8_t* bytes = in.take(std::size_t{count} * 2);
    if (count < 2) in.fail("it ends too early");
    // Room for a row of reads past the end, so that they need a check for each row only.
    words_.assign(std::size_t{count} + static_cast<std::size_t>(width), 0);
    for (std::uint32_t i = 0; i < count; ++i)
      words_[i] = static_cast<std::uint16_t>(bytes[2 * i] | bytes[2 * i + 1] << 8);
    state_ = static_cast<std::uint32_t>(words_[0]) << 16 | words_[1];
    next_ = words_.data() + 2;
    end_ = words_.data() + count;
  }

  void begin_row(std::uint16_t* out) {
    out_ = out;
    w_ = 0;
    nw_ = 0;
    n_ = above_[1];
  }

  [[gnu::always_inline]] void pixel(int u, const Tables& tables) {
    const int ne = above_[u + 2];
    const Context context = context_of(w_, n_, nw_, ne, tables.levels);
    const Tables::Table& table = tables.tables[tables.table_of[context.index]];
    const std::uint32_t point = state_ & (kScale - 1);
    const std::uint32_t symbol = table.symbol[point];
    const std::uint32_t frequency_start = table.frequency_start[symbol];
    const std::uint32_t state =
        (frequency_start >> 16) * (state_ >> kScaleBits) + point - (frequency_start & 0xffff);
    const bool refill = state < kStateLow;
    state_ = refill ? state << 16 | *next_ : state;
    next_ += refill;
    int x = 0;
    if (symbol != 0) {
      std::uint32_t z = symbol - 1;
      if (z >= 16) z = with_plain_bits(z);
      const int error = static_cast<int>(z >> 1) ^ -static_cast<int>(z & 1);
      x = context.prediction + context.sign * error;
      if (static_cast<std::uint32_t>(x - 1) >= tables.palette.size() - 1)
        in_->fail("a value is not in its palette");
    }
    row_[u + 1] = static_cast<std::uint16_t>(x);
    out_[u] = tables.palette[x];
    w_ = x;
    nw_ = n_;
    n_ = ne;
  }

  void end_row() {
    if (next_ > end_) in_->fail("it ends too early");
    above_.swap(row_);
  }

  void finish() const {
    if (state_ != kStateLow || next_ != end_ || plain_ != plain_end_)
      in_->fail("something is left over at its end");
  }

 private:
  [[gnu::noinline]] std::uint32_t with_plain_bits(std::uint32_t z) {
    const int bits = static_cast<int>(z - 16) / 2 + 3;
    for (; pending_bits_ < bits; pending_bits_ += 8) {
      if (plain_ == plain_end_) in_->fail("it ends too early");
      pending_ |= std::uint64_t{*plain_++} << pending_bits_;
    }
    z = (2 + (z & 1)) << bits | (static_cast<std::uint32_t>(pending_) & ((1u << bits) - 1));
    pending_ >>= bits;
    pending_bits_ -= bits;
    return z;
  }

  ByteReader* in_;
  std::vector<std::uint16_t> above_, row_;  // indices, with a missing pixel on either side
  std::vector<std::uint16_t> words_;
  const std::uint16_t* next_;
  const std::uint16_t* end_;
  const std::uint8_t* plain_;
  const std::uint8_t* plain_end_;
  std::uint64_t pending_ = 0;
  int pending_bits_ = 0;
  std::uint32_t state_;
  std::uint16_t* out_ = nullptr;
  int w_ = 0, nw_ = 0, n_ = 0;
};

Tables read_tables(ByteReader& in) {
  Tables tables;
  const std::uint32_t colours = in.varint();
  if (colours > 65535) in.fail("its palette is too long");
  tables.palette.assign(colours + 1, 0);
  for (std::uint32_t i = 1; i <= colours; ++i) {
    const std::uint32_t step = in.varint();
    if (step == 0 || step > 65535u - tables.palette[i - 1]) in.fail("its palette is not ascending");
    tables.palette[i] = static_cast<std::uint16_t>(tables.palette[i - 1] + step);
  }
  constexpr std::uint16_t kShared = kContexts;
  std::uint16_t shared = 0;
  for (int c = 0; c <= kContexts; ++c) {
    const std::uint32_t used = in.varint();
    if (used > kSymbols) in.fail("a frequency table is too long");
    if (used == 0 && c < kContexts) {
      tables.table_of[c] = kShared;
      continue;
    }
    (c < kContexts ? tables.table_of[c] : shared) =
        static_cast<std::uint16_t>(tables.tables.size());
    Tables::Table& table = tables.tables.emplace_back();
    std::uint32_t sum = 0;
    for (std::uint32_t s = 0; s < used; ++s) {
      const std::uint32_t f = in.varint();
      if (f > kScale - sum) in.fail("a frequency table does not add up");
      std::memset(table.symbol.data() + sum, static_cast<int>(s), f);
      table.frequency_start[s] = f << 16 | sum;
      sum += f;
    }
    if (used && sum != kScale) in.fail("a frequency table does not add up");
    // Without a shared table no pixel may need it: it gets one symbol, which no palette survives.
    if (used == 0) table.symbol.fill(kSymbols);
  }
  for (std::uint16_t& table : tables.table_of)
    if (table == kShared) table = shared;
  return tables;
}

}  // namespace

cv::Mat decode_depth_palette(const std::uint8_t* data, std::size_t size, int width, int height,
                             const std::string& where) {
  cv::Mat depth(height, width, CV_16UC1);
  check_image(depth);
  ByteReader in(data, size, where);
  const Tables tables = read_tables(in);
  std::vector<Lane> lanes;
  for (int band = 0; band < kBands; ++band) lanes.emplace_back(in, width);
  if (!in.done()) in.fail("something is left over at its end");

  const int common = height / kBands;
  for (int r = 0; r < common; ++r) {
    for (int band = 0; band < kBands; ++band)
      lanes[band].begin_row(depth.ptr<std::uint16_t>(band_begin(band, height) + r));
    for (int u = 0; u < width; ++u)
      for (int band = 0; band < kBands; ++band) lanes[band].pixel(u, tables);
    for (Lane& each : lanes) each.end_row();
  }
  for (int band = 0; band < kBands; ++band) {
    for (int v = band_begin(band, height) + common; v < band_begin(band + 1, height); ++v) {
      lanes[band].begin_row(depth.ptr<std::uint16_t>(v));
      for (int u = 0; u < width; ++u) lanes[band].pixel(u, tables);
      lanes[band].end_row();
    }
    lanes[band].finish();
  }
  return depth;
}

// ---- RVL ----

namespace {

/// Where the paper's coder puts half byte i: eight to a little-endian 32-bit word, the first
/// topmost.
constexpr std::size_t byte_of_nibble(std::size_t i) { return i / 8 * 4 + 3 - i % 8 / 2; }

class NibbleWriter {
 public:
  void number(std::uint32_t value) {
    do {
      const std::uint32_t rest = value >> 3;
      put(static_cast<std::uint8_t>((value & 7) | (rest ? 8 : 0)));
      value = rest;
    } while (value);
  }
  std::vector<std::uint8_t> take() { return std::move(bytes_); }

 private:
  void put(std::uint8_t nibble) {
    if (count_ % 8 == 0) bytes_.resize(bytes_.size() + 4, 0);
    bytes_[byte_of_nibble(count_)] |= count_ % 2 ? nibble : nibble << 4;
    ++count_;
  }
  std::vector<std::uint8_t> bytes_;
  std::size_t count_ = 0;
};

class NibbleReader {
 public:
  NibbleReader(const std::uint8_t* data, std::size_t size, const std::string& where)
      : data_(data), count_(size / 4 * 8), where_(where) {
    if (size % 4 != 0) fail("its size is no multiple of four bytes");
  }
  std::uint32_t number() {
    std::uint32_t value = 0;
    for (int shift = 0; shift < 30; shift += 3) {
      if (at_ == count_) fail("it ends too early");
      const std::uint8_t byte = data_[byte_of_nibble(at_)];
      const std::uint32_t nibble = at_ % 2 ? byte & 15 : byte >> 4;
      ++at_;
      value |= (nibble & 7) << shift;
      if (nibble < 8) return value;
    }
    fail("a number is too large");
  }
  bool done() const { return (at_ + 7) / 8 == count_ / 8; }
  [[noreturn]] void fail(const char* what) const {
    throw Error(where_ + ": damaged depth image: " + what);
  }

 private:
  const std::uint8_t* data_;
  std::size_t count_;
  std::size_t at_ = 0;
  const std::string& where_;
};

}  // namespace

std::vector<std::uint8_t> encode_depth_rvl(const cv::Mat& depth) {
  check_image(depth);
  const cv::Mat image = depth.isContinuous() ? depth : depth.clone();
  const auto* at = image.ptr<std::uint16_t>();
  const auto* const end = at + image.total();
  NibbleWriter out;
  int last = 0;
  while (at != end) {
    const auto* const valid = std::find_if(at, end, [](std::uint16_t d) { return d != 0; });
    const auto* const missing = std::find(valid, end, 0);
    out.number(static_cast<std::uint32_t>(valid - at));
    out.number(static_cast<std::uint32_t>(missing - valid));
    for (at = valid; at != missing; ++at) {
      const int difference = *at - last;
      out.number(
          static_cast<std::uint32_t>(difference >= 0 ? 2 * difference : -2 * difference - 1));
      last = *at;
    }
  }
  return out.take();
}

cv::Mat decode_depth_rvl(const std::uint8_t* data, std::size_t size, int width, int height,
                         const std::string& where) {
  cv::Mat depth(height, width, CV_16UC1);
  check_image(depth);
  NibbleReader in(data, size, where);
  auto* at = depth.ptr<std::uint16_t>();
  auto* const end = at + depth.total();
  int last = 0;
  while (at != end) {
    const std::uint32_t missing = in.number();
    if (missing > static_cast<std::size_t>(end - at)) in.fail("more pixels than the image has");
    std::memset(at, 0, missing * sizeof *at);
    at += missing;
    const std::uint32_t valid = in.number();
    if (valid > static_cast<std::size_t>(end - at)) in.fail("more pixels than the image has");
    // The last run alone may be empty; otherwise an endless row of nothing would be an image.
    if (missing + valid == 0) in.fail("an empty run");
    for (std::uint32_t i = 0; i < valid; ++i) {
      const std::uint32_t z = in.number();
      last += z & 1 ? -static_cast<int>(z / 2) - 1 : static_cast<int>(z / 2);
      if (last < 1 || last > 65535) in.fail("a depth out of range");
      *at++ = static_cast<std::uint16_t>(last);
    }
  }
  if (!in.done()) in.fail("something is left over at its end");
  return depth;
}

}  // namespace weft::rgbd
