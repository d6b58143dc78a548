// The readers behind mesh_io.h, one for each format, and the text scanner that three of them share.
// Private to planner/geometry.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "planner/geometry/mesh.h"
#include "protocols/result.h"

namespace reforge::mesh_parsers {

Result<TriangleMesh> parse_stl(std::string_view bytes, const std::string& name);
Result<TriangleMesh> parse_off(std::string_view text, const std::string& name);
Result<TriangleMesh> parse_obj(std::string_view text, const std::string& name);
Result<TriangleMesh> parse_ply(std::string_view bytes, const std::string& name);

// "<name>: <what>" as a kMalformed error.
Error malformed(const std::string& name, const std::string& what);

// Words of a text, line by line; `#` starts a comment when asked for. Lines end with \n, \r\n or
// \r.
class Scanner {
 public:
  Scanner(std::string_view text, bool comments) : rest_(text), comments_(comments) {}

  // Moves to the next line that holds a word; false at the end.
  bool next_line();
  // The next word of this line, if any.
  std::optional<std::string_view> word();
  // The next word, moving on to further lines when this one is used up.
  std::optional<std::string_view> word_across_lines();
  int line() const { return line_; }
  std::size_t bytes_left() const { return rest_.size() + in_line_.size(); }

 private:
  std::string_view rest_, in_line_;
  bool comments_;
  int line_ = 0;
};

// The whole word as a number. "nan" and "inf" are numbers here: mesh_check.h refuses them.
std::optional<double> to_double(std::string_view word);
std::optional<std::int64_t> to_integer(std::string_view word);

// Gives corners with equal coordinates one index (0 and -0 are equal).
TriangleMesh index_corners(const std::vector<Vec3>& corners);

}  // namespace reforge::mesh_parsers
