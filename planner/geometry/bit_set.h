// A set of small numbers as bits, for the sample points of a solid: volumes are counts, clipping is
// AND.
#pragma once

#include <bit>
#include <cassert>
#include <cstdint>
#include <vector>

namespace reforge {

struct BitSet {
  std::vector<std::uint64_t> words;

  BitSet() = default;
  explicit BitSet(std::size_t size) : words((size + 63) / 64, 0) {}

  void set(std::size_t i) { words[i / 64] |= std::uint64_t{1} << (i % 64); }
  void clear(std::size_t i) { words[i / 64] &= ~(std::uint64_t{1} << (i % 64)); }
  bool test(std::size_t i) const { return (words[i / 64] >> (i % 64)) & 1; }

  std::size_t count() const {
    std::size_t total = 0;
    for (const auto word : words) total += static_cast<std::size_t>(std::popcount(word));
    return total;
  }
  bool any() const {
    for (const auto word : words) {
      if (word) return true;
    }
    return false;
  }
  BitSet& operator|=(const BitSet& other) {
    assert(words.size() == other.words.size());
    for (std::size_t i = 0; i < words.size(); ++i) words[i] |= other.words[i];
    return *this;
  }
  BitSet& operator&=(const BitSet& other) {
    assert(words.size() == other.words.size());
    for (std::size_t i = 0; i < words.size(); ++i) words[i] &= other.words[i];
    return *this;
  }
  BitSet& subtract(const BitSet& other) {
    assert(words.size() == other.words.size());
    for (std::size_t i = 0; i < words.size(); ++i) words[i] &= ~other.words[i];
    return *this;
  }
  friend bool operator==(const BitSet&, const BitSet&) = default;
};

}  // namespace reforge
