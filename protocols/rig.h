// The rig file: what the shop knows about its machine, as plain data.
//
// Everything RIG.md does not mark [E] lives here and in config/rigs/*.json, never as a constant in
// code. Planner, verifier and daemon each compute from this data on their own: it holds no
// kinematics and no tool geometry beyond the numbers in the file.
//
// Units: millimetres, seconds, radians (degrees and mm/min only in the file). Lengths along a tool
// are measured from its tip upwards. Format: FORMATS.md, "Rig file".
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/result.h"
#include "protocols/units.h"

namespace reforge {

// Which set of obstacles counts (DESIGN.md, "Two constraint sets, one code").
enum class Mode { kPaper, kStrict };

// One piece of a tool's solid of revolution: radius r_from at height z_from to r_to at z_to.
// A radius may be +infinity ("infinitely wide above"), and so may the last z_to.
struct ToolSection {
  double z_from_mm;
  double z_to_mm;
  double r_from_mm;
  double r_to_mm;
};

struct CutterDescription {
  double diameter_mm;      // ball end; the tip is the ball's lowest point
  double flute_length_mm;  // what cuts; the sections above it must not touch material
  double stepdown_mm;
  double stepover_mm;
  double feed_mm_per_s;
  double ramp_feed_mm_per_s;
  double spindle_rpm;
  std::vector<ToolSection>
      holder;  // the non-cutting stack: shank, collet, spindle; from the ball on
};

struct NozzleDescription {
  double outlet_diameter_mm;
  std::vector<ToolSection> body;           // from the tip on
  Point<MachineFrame> parked_offset_mm;    // nozzle tip minus cutter tip, module closed (M71)
  Point<MachineFrame> deployed_offset_mm;  // nozzle tip minus cutter tip, module open (M70)
};

struct LinearAxis {
  double min_mm;
  double max_mm;
  double rapid_mm_per_s;
  double max_feed_mm_per_s;
  double acceleration_mm_per_s2;
};

struct RotaryAxis {
  Radians min;
  Radians max;
  double rapid_rad_per_s;
  double acceleration_rad_per_s2;
};

enum class RotaryTable { kBC, kAC };

struct Kinematics {
  RotaryTable table;
  int sign_tilt;  // +1 ISO, tool relative to work; or -1
  int sign_c;
  Point<MachineFrame> c_axis_point_mm;  // r: a point on the C axis, in G54
  Point<MachineFrame> tilt_offset_mm;   // D: from r to the tilt axis
  Point<MachineFrame>
      g54_in_machine_mm;  // machine position of G54's origin; limits apply to j + this
};

struct SpindleRange {
  double min_rpm;
  double max_rpm;
  double spin_up_s;
};

// Bodies that turn with the part: a disc under a pedestal. Heights in the part frame (z < 0).
struct TableDescription {
  double disc_radius_mm;
  double disc_thickness_mm;
};
struct PedestalDescription {
  double height_mm;         // from the disc's top to the part's foot
  double inset_mm;          // the pedestal stays this far inside the part's foot
  double minimum_width_mm;  // a foot leaving less than this cannot be held
};

enum class CncDialect { kGrbl, kMarlin, kFanuc };
enum class MCodeRoute { kRelay, kInStream };

struct CncLink {
  CncDialect dialect;
  int baud;
  int receive_buffer_bytes;
  int line_length_max;
  MCodeRoute m_codes;
};

struct Extrusion {
  double filament_diameter_mm;
  double bead_width_mm;
  double layer_height_mm;
  double feed_mm_per_s;  // tool speed while depositing
  double first_layer_feed_mm_per_s;
  double multiplier;  // calibration of what really comes out
  double infill;      // fraction
  double retract_mm;
  double retract_mm_per_s;
  double prime_dwell_s;
  double coast_mm;
  double travel_without_retract_mm;
  double steps_per_mm;  // of filament
  Celsius nozzle_temperature;
  Celsius minimum_temperature;
  Celsius maximum_temperature;
};

// Who measured signs, pivots and travels, and when. Without it only simulated or virtual ports run.
struct Commissioning {
  std::string by;
  std::string date;
  std::string note;
};

struct RigDescription {
  std::string name;
  std::string sha256;                    // of the file's bytes
  Point<MachineFrame> working_space_mm;  // extents a part must fit into
  double clear_height_mm;                // safe Z above the swept part for rotary moves and M70/M71
  LinearAxis x, y, z;
  RotaryAxis tilt, c;
  Kinematics kinematics;
  SpindleRange spindle;
  TableDescription table;
  PedestalDescription pedestal;
  CutterDescription cutter;
  NozzleDescription nozzle;
  Extrusion extrusion;
  CncLink cnc;
  double roughing_allowance_mm;
  double scallop_mm;
  std::optional<Commissioning> commissioned;
  std::vector<std::string> assumed;  // the keys whose values nobody has measured
};

// Reads and checks a rig file. Unknown keys, missing keys and numbers out of range are errors that
// name the file and the key.
Result<RigDescription> read_rig(const std::filesystem::path& file);
Result<RigDescription> parse_rig(std::string_view text, const std::string& name_for_errors);

// The tools of the paper's mode, as published (RIG.md, "Tools of the paper"): replace the rig's own
// when Mode is kPaper. Feeds, steps and offsets stay the rig's.
CutterDescription paper_cutter(const CutterDescription& rigs);
NozzleDescription paper_nozzle(const NozzleDescription& rigs);

}  // namespace reforge
