// What the planner said a block would do, held against what its lines do.
//
// The comment `work <mm> about X.. Y.. Z.. beads <mm3>` behind a block's own comment (FORMATS.md,
// "program.nc") states, from the toolpaths and in the part frame, how long the tool cuts or
// deposits, the centroid of that path, and the volume of the beads. Whatever became of the path on
// its way through post-processor, text and rig shows in one of them: a line lost or doubled, a
// wrong pivot or sign, a flow that is off. A program without such comments is a stranger's: nothing
// is compared. Part frame, mm.
// Limits: differences within what the program's three decimals explain are not seen; two
// faults in one block may cancel.
#pragma once

#include <optional>
#include <string>

#include "planner/verify/findings.h"

namespace reforge::verify {

struct Work {
  double length_mm = 0;
  Vec3 moment = Vec3::Zero();  // integral of the place along the path, mm^2
  double beads_mm3 = 0;
};

class PlannedWork {
 public:
  explicit PlannedWork(Findings& findings) : findings_(findings) {}

  // A comment line, in order.
  void comment(const std::string& text, std::size_t line);
  // The block with this number begins: the one before is judged.
  void begin(int block, std::size_t line);
  // The tool cuts or deposits from a to b.
  void add(const Vec3& a, const Vec3& b, double bead_mm3);
  // The spindle starts anew in the block's midst: a job that was interrupted and goes on, with a
  // way back into the material that nobody planned. The block is not compared.
  void restarted() {
    if (done_.length_mm > 0) planned_.reset();
  }
  void end(std::size_t line);

 private:
  Findings& findings_;
  int block_ = 0;
  std::size_t line_ = 0;  // of the statement
  std::optional<Work> planned_;
  // What rounding an end of a move does to length and moment, both squared and summed up: a
  // corner lengthens or shortens the path by what it turns, and shifts the moment by its place.
  void rounded(const Vec3& at, double turned, double length);

  Work done_;  // moment about the planned centroid
  Vec3 centre_ = Vec3::Zero();
  Vec3 last_ = Vec3::Zero(), last_way_ = Vec3::Zero();
  double length_noise_ = 0, moment_noise_ = 0;
  double turned_ = 0, turned_moment_ = 0;  // the same, as if all corners were off alike
};

}  // namespace reforge::verify
