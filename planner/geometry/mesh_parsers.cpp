#include "planner/geometry/mesh_parsers.h"

#include <bit>
#include <cctype>
#include <charconv>
#include <unordered_map>

namespace reforge::mesh_parsers {
namespace {

bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\v' || c == '\f' || c == '\0';
}

struct CornerKey {
  std::uint64_t x, y, z;
  friend bool operator==(const CornerKey&, const CornerKey&) = default;
};
struct CornerHash {
  std::size_t operator()(const CornerKey& key) const {
    std::uint64_t hash = key.x * 0x9E3779B97F4A7C15u;
    hash = (hash ^ (hash >> 29) ^ key.y) * 0xBF58476D1CE4E5B9u;
    hash = (hash ^ (hash >> 32) ^ key.z) * 0x94D049BB133111EBu;
    return static_cast<std::size_t>(hash ^ (hash >> 31));
  }
};

}  // namespace

Error malformed(const std::string& name, const std::string& what) {
  return {Code::kMalformed, name + ": " + what};
}

bool Scanner::next_line() {
  while (!rest_.empty()) {
    const auto end = rest_.find_first_of("\r\n");
    in_line_ = rest_.substr(0, end);
    if (end == std::string_view::npos) {
      rest_ = {};
    } else {
      const bool crlf = rest_[end] == '\r' && end + 1 < rest_.size() && rest_[end + 1] == '\n';
      rest_.remove_prefix(end + (crlf ? 2 : 1));
    }
    ++line_;
    if (comments_) in_line_ = in_line_.substr(0, in_line_.find('#'));
    while (!in_line_.empty() && is_blank(in_line_.front())) in_line_.remove_prefix(1);
    if (!in_line_.empty()) return true;
  }
  in_line_ = {};
  return false;
}

std::optional<std::string_view> Scanner::word() {
  while (!in_line_.empty() && is_blank(in_line_.front())) in_line_.remove_prefix(1);
  if (in_line_.empty()) return std::nullopt;
  std::size_t length = 0;
  while (length < in_line_.size() && !is_blank(in_line_[length])) ++length;
  const auto found = in_line_.substr(0, length);
  in_line_.remove_prefix(length);
  return found;
}

std::optional<std::string_view> Scanner::word_across_lines() {
  for (;;) {
    if (const auto found = word()) return found;
    if (!next_line()) return std::nullopt;
  }
}

std::optional<double> to_double(std::string_view word) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (end != word.data() + word.size() || word.empty()) return std::nullopt;
  if (error == std::errc::result_out_of_range) {
    // Too small is 0, too large is infinite; from_chars leaves the value alone in both cases.
    const bool tiny = word.find("e-") != word.npos || word.find("E-") != word.npos;
    return tiny ? 0.0 : std::numeric_limits<double>::infinity();
  }
  if (error != std::errc{}) return std::nullopt;
  return value;
}

std::optional<std::int64_t> to_integer(std::string_view word) {
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc{} || end != word.data() + word.size()) return std::nullopt;
  return value;
}

TriangleMesh index_corners(const std::vector<Vec3>& corners) {
  TriangleMesh mesh;
  mesh.triangles.reserve(corners.size() / 3);
  mesh.vertices.reserve(corners.size() / 6 + 8);
  std::unordered_map<CornerKey, std::uint32_t, CornerHash> index;
  index.reserve(corners.size() / 5 + 8);
  std::array<std::uint32_t, 3> triangle{};
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const Vec3 corner = corners[i] + Vec3::Zero();  // + 0 turns -0 into 0
    const CornerKey key{std::bit_cast<std::uint64_t>(corner.x()),
                        std::bit_cast<std::uint64_t>(corner.y()),
                        std::bit_cast<std::uint64_t>(corner.z())};
    const auto [entry, is_new] =
        index.try_emplace(key, static_cast<std::uint32_t>(mesh.vertices.size()));
    if (is_new) mesh.vertices.push_back(corner);
    triangle[i % 3] = entry->second;
    if (i % 3 == 2) mesh.triangles.push_back(triangle);
  }
  return mesh;
}

}  // namespace reforge::mesh_parsers
