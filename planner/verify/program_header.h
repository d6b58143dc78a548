// The program's own words about what it was made for (FORMATS.md, "program.nc"), held against what
// it is being verified with. A program without the header `reforge-program` is a stranger: nothing
// to compare.
#pragma once

#include <map>
#include <optional>
#include <string>

#include "planner/verify/findings.h"
#include "protocols/gcode/line.h"
#include "protocols/rig.h"

namespace reforge::verify {

class ProgramHeader {
 public:
  // Comment lines in order, until words begin.
  void take(const gcode::Line& line);
  bool ours() const { return values_.count("reforge-program") > 0; }
  std::optional<std::string> value(const std::string& key) const;
  // Adds a finding for each value that contradicts.
  void compare(const RigDescription& rig, Mode mode, const std::string& stock_sha256,
               Findings& findings) const;

 private:
  std::map<std::string, std::string> values_;
  std::string last_key_;
};

// `block 03 mill direction x y z` in a comment, if it is one; the direction may be missing.
struct BlockComment {
  int number;
  std::optional<Vec3> direction;
};
std::optional<BlockComment> block_comment(const std::string& comment);

}  // namespace reforge::verify
